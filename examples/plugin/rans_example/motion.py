"""A drift and an effector: what moves a craft without its thrusters, and what turns it beside them."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import ClassVar

from rans.extend import (
    Action,
    AnyVector,
    Begun,
    CommandRange,
    Drift,
    Effector,
    Field,
    Push,
    Store,
    Vec3,
    Wrench,
    absolute,
    cos,
    sin,
    within,
)


@dataclass(frozen=True)
class Bowl(Drift):
    """A table that sags: what lies on it swings about the origin of W."""

    frequency: float
    """Angular frequency of the swing about the origin, rad/s, above 0."""
    name: ClassVar[str] = "bowl"
    in_straight_lines: ClassVar[bool] = False

    def carry(self, p: AnyVector, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """Position (m) and velocity (m/s) of p'' = -f^2 p after a time t (s), in closed form."""
        f = self.frequency
        c = cos(f * t)
        s = sin(f * t)
        return p.scale(c) + v.scale(s / f), v.scale(c) - p.scale(f * s)


@dataclass(frozen=True)
class Torquer(Effector):
    """Turns the craft about an axis of B, the harder the more of its charge a control period takes."""

    axis: tuple[float, float, float]
    torque: float
    """For the command 1, N m."""
    charge: float
    """Full, as seconds of full torque; without charge it gives nothing."""

    @property
    def commands(self) -> tuple[CommandRange, ...]:
        """One, to either side."""
        return (CommandRange("torquer", "torque", -1.0, 1.0),)

    @property
    def stores(self) -> tuple[Store, ...]:
        """What is left of the charge, full at the start."""
        return (Store("charge", "s", self.charge, 0.0, self.charge),)

    @property
    def largest_torque(self) -> float:
        """Torque of the command 1, N m."""
        return self.torque

    def begin(self, begun: Begun) -> Action:
        """The commanded share of the torque, but no more than the charge that is left."""
        (command,) = begun.command
        (charge,) = begun.stores
        most = charge * (1.0 / begun.period)
        share = within(command, -most, most)
        amount = share * self.torque
        turn = begun.wrench(Vec3(*(amount * x for x in self.axis)))
        return _Turning(turn, share, charge)


class _Turning(Action):
    """A constant torque, the share of a torquer's largest, which empties its charge."""

    def __init__(self, turn: Wrench, share: Field, charge: Field) -> None:
        self._turn = turn
        self._share = share
        self._charge = charge

    def pushes(self, pushes: Iterable[Push]) -> Iterator[Push]:
        """Every part of the period with the torque added."""
        for push in pushes:
            yield push.plus(self._turn)

    def stores(self, time: Field) -> tuple[Field, ...]:
        """Charge a time (s) after the period began."""
        return (self._charge - absolute(self._share) * time,)
