"""Coasts beside keep-out balls and below speed limits: where they are nearest, and how a velocity is changed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

from rans.extend import Ball, Drift, Field, SpeedLimit, at_least, map_leaves, where
from rans_missions.guidance.limits import Limits

COAST_POINTS = 7
"""Number of points of a coast whose distance from keep-out balls is computed: a coast of a third of an orbit turns
by 15 degrees between them, and a straight line through the nearest one gives the distance between."""
_LEAST_DISTANCE = 1e-3
"""Lower bound of a distance from a ball's centre in divisions, m: less than any ball's radius."""
_LEAST_SPEED = 1e-9
"""Lower bound of speeds, m/s, and of their squares in divisions."""


@dataclass(frozen=True)
class Coasts:
    """Coasts in a drift, and the reserves with which they keep limits.

    Args:
        drift: motion of a free point.
        speed_reserve: part of a speed limit by which speeds stay below it.
        keep_out_reserve: distance that coasts keep from balls, m.
        largest_speed: upper bound of every speed, m/s.
        shortest: least time of a coast, s.
        pushes: number of times that a coast is moved out of each ball: moved once, it is nearest elsewhere.
    """

    drift: Drift
    speed_reserve: float
    keep_out_reserve: float
    largest_speed: float
    shortest: float
    pushes: int = 1

    def allowed_speed(self, limit: SpeedLimit, p: Any, v: Any) -> Field:
        """Speed limit at a position less the reserve, m/s."""
        return limit.gap(p, v.scale(0.0)) * (1.0 - self.speed_reserve)

    def within(self, limits: Limits, state: Any, velocity: Any, time: Field) -> Any:
        """A velocity in W, m/s, for a coast of a time, s, changed so far that it keeps balls and speeds."""
        for ball in limits.balls:
            for _ in range(self.pushes):
                velocity = velocity + self._around(ball, state, velocity, time)
        return self.slowed(limits, state, velocity)

    def slowed(self, limits: Limits, state: Any, velocity: Any) -> Any:
        """A velocity in W, m/s, scaled down to the largest speed that is allowed where the craft is.

        The direction stays, as plans aim by it.
        """
        largest: Field = self.largest_speed
        for limit in limits.speeds:
            allowed = self.allowed_speed(limit, state.p, state.v)
            largest = where(allowed < largest, allowed, largest)
        speed = velocity.norm()
        factor = where(speed > largest, largest / at_least(speed, _LEAST_SPEED), 1.0)
        return velocity.scale(factor)

    def nearest(self, ball: Ball, state: Any, velocity: Any, time: Field) -> tuple[Any, Field]:
        """The nearest point of a coast to a ball's centre.

        Args:
            ball: ball.
            state: where the coast starts.
            velocity: of its start in W, m/s.
            time: of the coast, s.

        Returns:
            The point relative to the centre, in W, m, and when the craft is there, s.
        """
        # The nearest of a few points.
        nearest = state.p - ball.centre
        distance = nearest.norm()
        when = time
        for k in range(1, COAST_POINTS + 1):
            fraction = k / (COAST_POINTS + 1)
            p, _ = self.drift.carry(state.p, velocity, time * fraction)
            offset = p - ball.centre
            nearer = offset.norm() < distance
            nearest = map_leaves(partial(where, nearer), offset, nearest)
            distance = where(nearer, offset.norm(), distance)
            when = where(nearer, time * fraction, when)
        # The nearest point of a straight line through it, at most halfway to the points beside it.
        p, v = self.drift.carry(state.p, velocity, when)
        spacing = time * (0.5 / (COAST_POINTS + 1))
        earlier = (p - ball.centre).dot(v) / at_least(v.dot(v), _LEAST_SPEED)
        earlier = where(
            earlier > spacing, spacing, where(earlier < -spacing, 0.0 - spacing, earlier)
        )
        when = at_least(when - earlier, self.shortest)
        p, _ = self.drift.carry(state.p, velocity, when)
        return p - ball.centre, when

    def _around(self, ball: Ball, state: Any, velocity: Any, time: Field) -> Any:
        """Velocity change, m/s, that moves the nearest point of a coast out of a ball."""
        nearest, when = self.nearest(ball, state, velocity, time)
        distance = nearest.norm()
        inside = at_least(ball.radius + self.keep_out_reserve - distance, 0.0)
        return nearest.scale(inside / (at_least(distance, _LEAST_DISTANCE) * when))
