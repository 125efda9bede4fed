"""Certified bounds, and events that are bounded.

A bound must stay below every control that is found, and of another event it says nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

from rans.base.errors import ConfigError, positive
from rans.model.spacecraft import Spacecraft, check_rigid
from rans.model.timing import MOST_STEPS

Kind = Literal["arrival", "settling"]
"""Kinds of events with a bound of their own."""

_TEXTS: dict[Kind, str] = {"arrival": "first time in the goal set", "settling": "settling time"}
"""Words of the times of events, as tables of scores have them."""


class Event(NamedTuple):
    """Event whose time or impulse is measured; numbers of different events are not compared."""

    kind: Kind = "arrival"
    """arrival: first in the goal set, which asks for rest (`rans.tasks.goal_set`); settling: within the task's
    tolerances to the end."""
    horizon: float | None = None
    """None: the time of the event, s, is measured; else the impulse, N s, with which it has happened at this
    time, s."""

    @property
    def text(self) -> str:
        """Heading of the event, without units."""
        if self.horizon is not None:
            return f"impulse by {self.horizon:g} s"
        return _TEXTS[self.kind]


@dataclass(frozen=True)
class Bound:
    """Bounds for one start, in N s or s."""

    start: int
    horizon: float | None
    """See `Event`."""
    hull: float
    """Lower bound for all commands between 0 and 1, on/off or not."""
    lower: float | None = None
    """Lower bound for on/off controllers at the control rate; None if there is no certificate."""
    upper: float = math.inf
    """Amount with ``commands``, which were replayed into the goal set; infinite if there are none."""
    commands: list[list[int]] | None = None
    """On/off commands (T, thrusters), zeros and ones, that reach the goal set."""
    seconds: float = 0.0
    """Wall time of the certificate."""
    unit: float = 0.0
    """Unit of amounts of on/off commands, a period or a pulse; 0: there is none."""
    kind: Kind = "arrival"
    """Kind of event; settling has no commands, because being in the set once is not sufficient for it."""
    tube: float | None = None
    """Lower bound for all commands between 0 and 1 from the attitudes that torque can reach; None: not computed."""

    def __repr__(self) -> str:
        result = f", {self.upper:g} found" if math.isfinite(self.upper) else ""
        return f"<Bound of the {self.event.text} from start {self.start}: {self.best:g}{result}>"

    @property
    def event(self) -> Event:
        """Event that is bounded."""
        return Event(self.kind, self.horizon)

    @property
    def best(self) -> float:
        """Largest lower bound for controllers at the control rate."""
        loose = max(self.hull, self.tube or 0.0)
        loose = rounded_up(loose, self.unit) if self.unit else loose
        return loose if self.lower is None else max(loose, self.lower)


def count_of_periods(horizon: float, period: float) -> int:
    """Number of control periods of a horizon.

    Raises:
        ConfigError: the horizon is no whole number of them.
    """
    check_period(period)
    count = round(horizon / period) if math.isfinite(horizon / period) else 0
    if 1 <= count <= MOST_STEPS and abs(count * period - horizon) <= 1e-9 * horizon:
        return count
    raise ConfigError(
        f"a bound of impulse needs a horizon of 1 to {MOST_STEPS:,} whole control "
        f"periods of {period:g} s, got {horizon:g} s."
    )


def rounded_up(value: float, unit: float) -> float:
    """The least whole multiple of a unit that is not below a value by more than rounding."""
    return max(0, math.ceil(value / unit * (1.0 - 1e-12))) * unit if math.isfinite(value) else value


def check_period(period: float) -> None:
    """Refuse (`ConfigError`) a time for which no command can be held."""
    positive("the control period of a bound, s,", period)


def check_certifiable(craft: Spacecraft, wheels: bool = False) -> None:
    """Refuse a craft that a bound does not cover.

    Args:
        craft: spacecraft.
        wheels: whether the bound covers reaction wheels.

    Raises:
        ConfigError: it has no thrusters, effectors of other kinds or reaction wheels, or uses propellant.
    """
    if not craft.thrusters:
        raise ConfigError(
            f"spacecraft {craft.name!r}: certified bounds are those of thrusters, and it has none."
        )
    if craft.acting_effectors:
        raise ConfigError(
            f"spacecraft {craft.name!r}: certified bounds are those of thrusters, and it has effectors of other "
            "kinds."
        )
    check_rigid(craft, "certified bounds")
    if craft.propellant is not None or (craft.wheels and not wheels):
        covered = "thrusters, wheels" if wheels else "thrusters"
        raise ConfigError(
            f"spacecraft {craft.name!r}: certified bounds are those of {covered} and a constant mass; it has "
            f"{'reaction wheels' if craft.wheels and not wheels else 'propellant'}."
        )
