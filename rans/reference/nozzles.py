"""What each nozzle of the judge's plant gives over time, of what its valve was told.

Followed nozzle by nozzle, with faults, the supply and slow valves. Like the plant it takes nothing of RANS
but descriptions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple, Self

import numpy as np

from rans.model.actuators import Actuators, Pulsed
from rans.model.body import Body
from rans.model.spacecraft import Spacecraft


class Segment(NamedTuple):
    """A time in which the thrust of every nozzle grows or falls steadily."""

    end: float
    """s from the start of the control period."""
    thrust: np.ndarray
    """(N, thrusters) at its beginning, as shares of full force."""
    rate: np.ndarray
    """(N, thrusters) 1/s."""


@dataclass(frozen=True)
class Nozzles:
    """What becomes of commands to N spacecraft of t thrusters."""

    gain: np.ndarray
    """(N, t): share of what it is told that each gives."""
    leak: np.ndarray
    """(N, t): share of its force that it gives besides."""
    droop: np.ndarray
    """(N, 1): n thrusters' worth of open valves have 1 / (1 + droop (n - 1)) of their force each."""
    latency: np.ndarray
    """(N, 1): from a command until valves begin to move, s."""
    rise: np.ndarray
    """(N, 1): from then until a thrust that grows is there, s."""
    fall: np.ndarray
    """(N, 1): the same of one that shrinks."""

    @classmethod
    def of(cls, craft: Spacecraft, body: Body, count: int, latency: Any = 0.0, rise: Any = 0.0,
           fall: Any = 0.0) -> Self:
        """Of so many spacecraft with this body; each value is one number or (N,)."""
        def columns(values: Sequence[Any]) -> np.ndarray:
            return np.column_stack([np.broadcast_to(np.asarray(x, dtype=float).ravel(), count)
                                    for x in values])

        usual = 1.0 if craft.thrust_sharing == "split" else 0.0
        return cls(columns(body.gain or (1.0,) * len(craft.thrusters)),
                   columns(body.leak or (0.0,) * len(craft.thrusters)),
                   *(columns([x]) for x in (usual if body.droop is None else body.droop,
                                            latency, rise, fall)))

    def given(self, opened: np.ndarray) -> np.ndarray:
        """Share of its force that each thruster gives once valves (N, t) are so far open."""
        flowing = self.gain * opened + self.leak
        return flowing / (1.0 + self.droop * np.maximum(flowing.sum(axis=1, keepdims=True) - 1.0, 0.0))

    def segments(self, actuators: Actuators, commands: Sequence[np.ndarray],
                 duration: float) -> Iterator[Segment]:
        """The thrust in a control period: a new segment where any nozzle's begins or ends to change.

        The commands, (N, t) of 0 to 1 each, are this period's and those of the periods before, the newest
        first; the oldest one's beginning is felt in full when the period starts.
        """
        patterns = [(begin - age * duration, self.given(opened))
                    for age, command in reversed(list(enumerate(commands)))
                    for begin, opened in told(actuators, command, duration)]
        first = patterns[0][1]
        changes = [self._change(time, old, new) for (_, old), (time, new) in pairwise(patterns)]
        row, column, size, start, ramp = map(np.concatenate, zip(_nothing(), *changes, strict=True))
        kinks = np.concatenate([start, start + ramp])
        ends = np.unique(np.append(kinks[(kinks > 0.0) & (kinks < duration)], duration))
        for begin, end in pairwise([0.0, *ends]):
            # In the middle, as nothing begins or ends there.
            gone = 0.5 * (begin + end) - start
            moving = (gone > 0.0) & (gone < ramp)
            thrust, rate, slope = first.copy(), np.zeros_like(first), np.zeros_like(size)
            np.divide(size, ramp, out=slope, where=moving)
            np.add.at(thrust, (row, column), np.where(moving, slope * (begin - start), size * (gone >= ramp)))
            np.add.at(rate, (row, column), slope)
            yield Segment(end, thrust, rate)

    def _change(self, time: float, old: np.ndarray, new: np.ndarray) -> tuple[np.ndarray, ...]:
        """Of each nozzle whose thrust changes: row, column, by how much, from when on, for how long (s)."""
        row, column = np.nonzero(new - old)
        size = (new - old)[row, column]
        ramp = np.where(size > 0.0, self.rise[row, 0], self.fall[row, 0])
        return row, column, size, time + self.latency[row, 0], ramp


def told(actuators: Actuators, commands: np.ndarray, duration: float) -> list[tuple[float, np.ndarray]]:
    """From when on (s) which valves are told to be how far open: anew where any of any spacecraft shuts.

    The commands, (N, thrusters), are 0 to 1 and held for the duration, s.
    """
    if not isinstance(actuators, Pulsed):
        return [(0.0, commands)]
    counts = np.floor(commands * actuators.counts + 0.5)
    shut_at = np.where(counts < actuators.least, 0.0, counts / actuators.counts) * duration
    begins = np.unique(np.append(0.0, shut_at[shut_at < duration]))
    return [(begin, (shut_at > begin).astype(float)) for begin in begins]


def _nothing() -> tuple[np.ndarray, ...]:
    whole, real = np.zeros(0, dtype=int), np.zeros(0)
    return whole, whole, real, real, real
