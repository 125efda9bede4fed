"""Limits that guidance on orbits keeps: keep-out balls and speed limits.

They are protocols, which the shapes of tasks (`rans.tasks.shapes`) fulfil.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

from rans.extend import Field, Vector


class Margin(Protocol):
    """A limit of positions, or of positions and velocities."""

    def gap(self, position: Any, velocity: Any = None) -> Field:
        """Margin of a point in W, in SI units; it is negative where the point is not allowed."""
        ...


class KeepOutBall(Margin, Protocol):
    """A disc in the plane or a ball in space that craft stay out of; it may move at a constant velocity."""

    @property
    def centre(self) -> Vector:
        """Centre in W, m."""
        ...

    @property
    def v(self) -> Vector:
        """Velocity of the centre in W, m/s."""
        ...

    @property
    def radius(self) -> Field:
        """Radius, m."""
        ...

    def later(self, time: Field) -> KeepOutBall:
        """The ball after a time, s."""
        ...


class Limits(NamedTuple):
    """Limits of a mission, by what guidance does about them."""

    balls: tuple[KeepOutBall, ...] = ()
    """Keep-out balls: coasts go around them."""
    speeds: tuple[Margin, ...] = ()
    """Speed limits, whose margin at rest is the allowed speed, m/s: velocities are scaled below it."""
    others: tuple[Margin, ...] = ()
    """Limits of other kinds: plans of arrivals have a price for violating them."""
