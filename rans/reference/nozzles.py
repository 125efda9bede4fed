"""Thrust of each nozzle of the reference plant over time, from the commands to its valve.

Followed nozzle by nozzle, with faults, the supply and slow valves. Like the plant it takes nothing of RANS
but descriptions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple, Self

import numpy as np

from rans.model.actuators import Actuators, Pulsed, Throttle
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
    """Share of its command that each thruster gives, (N, t)."""
    leak: np.ndarray
    """(N, t): share of its force that it gives besides."""
    droop: np.ndarray
    """(N, 1): of n thrusters' worth of open valves of a supply each has 1 / (1 + droop (n - 1)) of its force."""
    latency: np.ndarray
    """(N, 1): from a command until valves begin to move, s."""
    rise: np.ndarray
    """(N, 1): from then until a thrust has changed, s."""
    same_supply: np.ndarray
    """(t, t): 1 where one supply feeds both nozzles, otherwise 0."""

    @classmethod
    def of(
        cls,
        craft: Spacecraft,
        body: Body,
        count: int,
        latency: Any = 0.0,
        rise: Any = 0.0,
    ) -> Self:
        """Nozzles of so many spacecraft with this body; each value is one number or (N,)."""

        def columns(values: Sequence[Any]) -> np.ndarray:
            table = np.empty((count, len(values)))  # without a column for craft of wheels alone
            for column, value in zip(table.T, values, strict=True):
                column[:] = np.asarray(value, dtype=float).ravel()
            return table

        usual = 1.0 if craft.thrust_sharing == "split" else 0.0
        supply = np.array([nozzle.supply for nozzle in craft.thrusters])
        return cls(
            columns(body.gain or (1.0,) * craft.thruster_count),
            columns(body.leak or (0.0,) * craft.thruster_count),
            *(columns([x]) for x in (usual if body.droop is None else body.droop, latency, rise)),
            same_supply=(supply[:, None] == supply).astype(float),
        )

    def force_shares(self, opened: np.ndarray) -> np.ndarray:
        """Share of its force that each thruster gives once valves (N, t) are so far open."""
        flowing = self.gain * opened + self.leak
        of_supply = flowing @ self.same_supply
        return flowing / (1.0 + self.droop * np.maximum(of_supply - 1.0, 0.0))

    def segments(
        self,
        actuators: Actuators,
        commands: Sequence[np.ndarray],
        duration: float,
        failure: Failure | None = None,
    ) -> Iterator[Segment]:
        """The thrust in a control period: a new segment where any nozzle's begins or ends to change.

        The commands, (N, t) of 0 to 1 each, are this period's and those of the periods before, the newest
        first; the oldest one's beginning is felt in full when the period starts. A failure, if there is one,
        is at once in every nozzle's thrust.
        """
        sound = self._flow(actuators, commands, duration)
        failed = None if failure is None else failure.nozzles._flow(actuators, commands, duration)
        kinks = sound.kinks()
        if failure is not None and failed is not None:
            kinks = np.concatenate([kinks, failed.kinks(), failure.instant.ravel()])
        ends = np.unique(np.append(kinks[(kinks > 0.0) & (kinks < duration)], duration))
        for begin, end in pairwise([0.0, *ends]):
            thrust, rate = sound.within(begin, end)
            if failure is not None and failed is not None:
                broken = failure.instant <= begin
                other_thrust, other_rate = failed.within(begin, end)
                thrust = np.where(broken, other_thrust, thrust)
                rate = np.where(broken, other_rate, rate)
            yield Segment(end, thrust, rate)

    def _flow(self, actuators: Actuators, commands: Sequence[np.ndarray], duration: float) -> _Flow:
        """Flow through the valves over the control period (s) by commands (N, n), the newest first.

        Commands before the newest still act where valves are slow; times are from the begin of this period.
        """
        patterns = [
            (begin - age * duration, self.force_shares(opened))
            for age, command in reversed(list(enumerate(commands)))
            for begin, opened in valve_commands(actuators, command, duration)
        ]
        first = patterns[0][1]
        changes = [self._change(time, old, new) for (_, old), (time, new) in pairwise(patterns)]
        return _Flow(first, *map(np.concatenate, zip(_nothing(), *changes, strict=True)))

    def _change(self, time: float, old: np.ndarray, new: np.ndarray) -> tuple[np.ndarray, ...]:
        """Changes of thrust of the nozzles: row, column, amount, begin and duration (s)."""
        row, column = np.nonzero(new - old)
        size = (new - old)[row, column]
        return row, column, size, time + self.latency[row, 0], self.rise[row, 0]


@dataclass(frozen=True)
class Failure:
    """Thrusters that fail while a command is held."""

    instant: np.ndarray
    """(N, 1): when, s from the start of the control period; not after zero: all of it; not before its end:
    none of it."""
    nozzles: Nozzles
    """From then on."""


@dataclass(frozen=True)
class _Flow:
    """The thrust of every nozzle over a control period: what it is at first, and every change of it."""

    first: np.ndarray
    """(N, thrusters), as shares of full force."""
    row: np.ndarray
    """Number of the spacecraft whose thrust changes, (changes,) like all that follow."""
    column: np.ndarray
    """Number of the nozzle."""
    size: np.ndarray
    """By which share of full force."""
    start: np.ndarray
    """From when on, s from the start of the control period."""
    ramp: np.ndarray
    """For how long, s."""

    def kinks(self) -> np.ndarray:
        """When any thrust begins or ends to change, s."""
        return np.concatenate([self.start, self.start + self.ramp])

    def within(self, begin: float, end: float) -> tuple[np.ndarray, np.ndarray]:
        """The thrust at the beginning of a time without kinks, s, and its rate, 1/s: (N, thrusters) each.

        No change may begin or end between both times, since the thrust is a line there.
        """
        # In the middle, as nothing begins or ends there.
        gone = 0.5 * (begin + end) - self.start
        moving = (gone > 0.0) & (gone < self.ramp)
        thrust = self.first.copy()
        rate = np.zeros_like(self.first)
        slope = np.zeros_like(self.size)
        np.divide(self.size, self.ramp, out=slope, where=moving)
        level = np.where(moving, slope * (begin - self.start), self.size * (gone >= self.ramp))
        np.add.at(thrust, (self.row, self.column), level)
        np.add.at(rate, (self.row, self.column), slope)
        return thrust, rate


def valve_commands(
    actuators: Actuators, commands: np.ndarray, duration: float
) -> list[tuple[float, np.ndarray]]:
    """Openings of all valves and the instants (s) from which they hold.

    The commands, (N, thrusters), are 0 to 1 and held for the duration, s. A throttle that may be shut gives
    nothing below half of its least level, and at least that level otherwise.
    """
    if isinstance(actuators, Throttle) and actuators.least > 0.0 and not actuators.always_lit:
        lit = commands >= 0.5 * actuators.least
        commands = np.where(lit, np.maximum(commands, actuators.least), 0.0)
    if not isinstance(actuators, Pulsed):
        return [(0.0, commands)]
    counts = np.floor(commands * actuators.counts + 0.5)
    shut_at = np.where(counts < actuators.least, 0.0, counts / actuators.counts) * duration
    begins = np.unique(np.append(0.0, shut_at[shut_at < duration]))
    return [(begin, (shut_at > begin).astype(float)) for begin in begins]


def _nothing() -> tuple[np.ndarray, ...]:
    whole = np.zeros(0, dtype=int)
    real = np.zeros(0)
    return whole, whole, real, real, real
