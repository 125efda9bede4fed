"""A drift and an effector: what moves a craft without its thrusters, and what turns it beside them."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from rans.extend import (
    Action,
    AnyVector,
    Begun,
    CommandRange,
    Drift,
    Effector,
    Field,
    Store,
    Vec3,
    absolute,
    cosine,
    sine,
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
        c = cosine(f * t)
        s = sine(f * t)
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
        return _Turning(self, within(command, -most, most), charge)


class _Turning(Action):
    """A constant share of a torquer's torque, which empties its charge."""

    def __init__(self, torquer: Torquer, share: Field, charge: Field) -> None:
        self._torquer = torquer
        self._share = share
        self._charge = charge

    def pushes(self, pushes: Iterable[Any]) -> Iterator[Any]:
        """Every part of the period with the torque added: a number in the plane, a vector in space."""
        x, y, z = self._torquer.axis
        amount = self._share * self._torquer.torque
        for push in pushes:
            in_space = isinstance(push.first.torque, Vec3)
            turn = Vec3(amount * x, amount * y, amount * z) if in_space else amount * z
            # Loads are those of the craft with a full tank; an axis of B does not turn with the rest.
            yield replace(push, first=replace(push.first, torque=push.first.torque + turn))

    def stores(self, time: Field) -> tuple[Field, ...]:
        """Charge a time (s) after the period began."""
        return (self._charge - absolute(self._share) * time,)
