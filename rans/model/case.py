"""What one episode drew from its conditions, and what that does to it, written over fields.

A part that the conditions leave out is None: it is in no memory and in no kernel.
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce

from rans.model.body import Body
from rans.model.dynamics import Wrench
from rans.model.fields import Field, map_leaves, sin, where
from rans.model.sensors import Sensors
from rans.model.valves import Lag


@dataclass(frozen=True)
class Fault:
    """The thrusters' health from a moment on."""

    begins: Field
    """s from the start of the episode."""
    gain: tuple[Field, ...]
    leak: tuple[Field, ...]


@dataclass(frozen=True)
class Hold:
    """How long on/off valves stay as they are, at least."""

    on: Field
    """s."""
    off: Field
    """s."""

    def obeyed(self, command: Sequence[Field], before: Sequence[Sequence[Field]],
               period: float) -> tuple[Field, ...]:
        """What valves do of a command: one that has just moved stays for as long as it must.

        The commands before, the newest first, were each held for the period, s.
        """
        result = []
        for told, *last in zip(command, *before, strict=True):
            opened, shut = _age(last), _age([1.0 - x for x in last])
            must_open = (opened > 0.0) & (opened * period < self.on - 1e-6)
            # One that was shut for as long as is remembered may have been so forever.
            must_shut = (shut > 0.0) & (shut < float(len(last))) & (shut * period < self.off - 1e-6)
            result.append(where(must_open, told * 0.0 + 1.0, where(must_shut, told * 0.0, told)))
        return tuple(result)


def _age(open_before: Sequence[Field]) -> Field:
    """For how many control periods a valve has been open until now, as far as is remembered."""
    still: Field = 1.0
    age: Field = 0.0
    for was_open in open_before:
        still = still * was_open
        age = age + still
    return age


@dataclass(frozen=True)
class Swing:
    """A wrench in W that goes to and fro: amplitude times sin(rate t + phase)."""

    amplitude: Wrench
    rate: Field
    """rad/s."""
    phase: Field
    """rad."""


@dataclass(frozen=True)
class Kick:
    """A sudden push, spread over the control period it falls in."""

    step: Field
    """Which control period, a whole number."""
    impulse: Wrench
    """In W, N s and N m s."""


@dataclass(frozen=True)
class Influences:
    """What moves a spacecraft in one control period."""

    body: Body
    commands: tuple[tuple[Field, ...], ...]
    """This period's, and earlier ones that may still be felt, the newest first."""
    lag: Lag | None = None
    """None: valves obey at once."""
    disturbance: Wrench | None = None
    """Constant in W."""


@dataclass(frozen=True)
class Case:
    """What one episode drew, or N did."""

    number: Field
    """Of the episode."""
    body: Body
    """What flies."""
    fault: Fault | None
    lag: Lag | None
    hold: Hold | None
    push: Wrench | None
    """Steady, in W."""
    swing: Swing | None
    kicks: tuple[Kick, ...]
    sensors: Sensors | None

    def body_at(self, time: Field) -> Body:
        """What flies so long after the start (s)."""
        if self.fault is None:
            return self.body
        failed = time >= self.fault.begins
        choose = lambda broken, sound: where(failed, broken, sound)  # noqa: E731
        return replace(self.body, gain=tuple(map(choose, self.fault.gain, self.body.gain)),
                       leak=tuple(map(choose, self.fault.leak, self.body.leak)))

    def disturbance(self, step: Field, period: float) -> Wrench | None:
        """What pushes in this control period beside the thrusters, constant in W; None: nothing ever.

        What swings has its value in the middle of the period.
        """
        parts = [] if self.push is None else [self.push]
        if self.swing is not None:
            s = sin(self.swing.rate * ((step + 0.5) * period) + self.swing.phase)
            parts.append(map_leaves(lambda x: x * s, self.swing.amplitude))
        for kick in self.kicks:
            now = where(kick.step == step, kick.step * 0.0 + 1.0 / period, kick.step * 0.0)
            parts.append(map_leaves(lambda x, now=now: x * now, kick.impulse))
        return reduce(lambda a, b: map_leaves(operator.add, a, b), parts) if parts else None
