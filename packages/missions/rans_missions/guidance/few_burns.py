"""Transfers of few burns near a circular orbit that end at rest, in closed form over fields.

The motion is linear (`rans.model.drift.ClohessyWiltshire`), so that position and velocity at the arrival are sums
of what every burn does. Across the orbital plane one burn reaches a position, and in the plane two burns along axes
do. What is left of the velocity is braked at the arrival. Thrusters are along the axes: burns cost the sum of their
components.

A burn in the plane is now, and one across it now or after one or more of `INTERVALS` equal intervals of the time.
The best transfer of this kind is within some percent of the optimum, which has few burns too, the largest of them
at both ends (T. N. Edelbaum, "How many impulses?", Astronautics & Aeronautics 5, 1967). All numbers are fields in
the Hill frame, so that mission steps are traced with it; the order of comparisons decides which of equal plans
flies.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

from rans.extend import ClohessyWiltshire, Field, Vec3, absolute, at_least, map_leaves, where
from rans_missions.guidance.impulses import (
    LEAST_SAVING,
    ImpulseResponse,
    larger,
    two_impulses,
)

INTERVALS = 8
"""Number of equal intervals of a transfer's time, between which burns across the plane are tried."""
_EDGE_POINTS = 8
"""Number of points on the edge of the position tolerance, in the orbital plane, at which transfers may end."""
_IMPOSSIBLE_PRICE = 1e6
"""Price of a coast that misses the tolerance without a burn, m/s: more than any transfer costs."""


@dataclass(frozen=True)
class ArrivalTolerance:
    """Largest distances and speed with which a transfer may end."""

    plane: float
    """Distance from the goal in the orbital plane, m."""
    across: float
    """Distance from the goal across it, m."""
    speed: float
    """Speed along each axis that is not braked, m/s."""
    deadband: float = 1.1
    """Factor of both distances within which a coast is not corrected, so that a craft that has aimed at their edge
    does not correct rounding errors."""


class Transfer(NamedTuple):
    """A transfer to the goal."""

    burn: Vec3
    """Velocity change of its burns that are now, in W, m/s."""
    price: Field
    """Velocity change of all burns, m/s."""
    brake: Field
    """Largest component of the velocity change at the arrival, m/s."""


def cheapest_transfer(
    n: float, p: Vec3, v: Vec3, goal: Vec3, time: Field, tolerance: ArrivalTolerance
) -> Transfer:
    """The cheapest transfer from a state to a goal, of which at most the burn across the plane is postponed.

    Earlier ones win ties, so that a rounding does not change the plan from one period to the next.

    Args:
        n: mean motion of the orbit, rad/s.
        p: position in W, the target's Hill frame, m.
        v: velocity in W, m/s.
        goal: position in W, m.
        time: until the arrival, > 0, s.
        tolerance: distances from the goal and speed with which transfers may end.
    """
    arrived, at_goal = ClohessyWiltshire(n).carry(p, v, time)
    missed = goal - arrived
    across, price, brake = _across(n, missed.z, at_goal.z, time, tolerance)
    in_plane, other, u, w = _in_plane(n, missed, at_goal, time, tolerance)
    return Transfer(Vec3(u, w, across), in_plane + price, larger(other, brake))


def _across(
    n: float, missed: Field, at_goal: Field, time: Field, tolerance: ArrivalTolerance
) -> tuple[Field, Field, Field]:
    """The cheapest burn across the plane: the part that is now, price with brake, and brake, m/s.

    Without a burn a coast misses the goal by ``missed``, m, at the speed ``at_goal``, m/s.
    """
    # Without a burn, where the coast is near enough.
    brake = _braking(at_goal, tolerance)
    near = absolute(missed) < tolerance.across * tolerance.deadband
    zero = time * 0.0
    price = where(near, brake, zero + _IMPOSSIBLE_PRICE)
    now = zero
    # With a burn after each interval, to either edge of the tolerance.
    for j in range(INTERVALS):
        rest = ImpulseResponse.after(n, time * (1.0 - j / INTERVALS))
        for edge in (tolerance.across, -tolerance.across):
            burn = (missed + edge) * n / rest.sine
            braked = _braking(at_goal + burn * (1.0 - rest.versine), tolerance)
            total = absolute(burn) + braked
            better = total < (price * (1.0 - LEAST_SAVING) if j else price)
            price = where(better, total, price)
            brake = where(better, braked, brake)
            now = where(better, zero if j else burn, now)
    return now, price, brake


def _in_plane(
    n: float, missed: Vec3, at_goal: Vec3, time: Field, tolerance: ArrivalTolerance
) -> tuple[Field, Field, Field, Field]:
    """The cheapest burns now in the plane: price with the brake, its larger component, and both burns, m/s.

    Without a burn a coast misses the goal by ``missed``, m, at the velocity ``at_goal``, m/s.
    """
    zero = time * 0.0
    response = ImpulseResponse.after(n, time)
    displacements = response.displacement(n, 0), response.displacement(n, 1)
    first, second = response.velocity_change(0), response.velocity_change(1)

    def braked(u: Field, w: Field) -> tuple[Field, Field, Field, Field]:
        """Price of two burns with the brake, its larger component, and the burns."""
        x = _braking(at_goal.x + u * first[0] + w * second[0], tolerance)
        y = _braking(at_goal.y + u * first[1] + w * second[1], tolerance)
        return absolute(u) + absolute(w) + x + y, larger(x, y), u, w

    # Without a burn, where the coast is near enough.
    radius = tolerance.plane * tolerance.deadband
    near = missed.x * missed.x + missed.y * missed.y < radius**2
    price, *others = braked(zero, zero)
    best = (where(near, price, zero + _IMPOSSIBLE_PRICE), *others)
    # To points on the edge of the tolerance.
    for k in range(_EDGE_POINTS):
        angle = 2.0 * math.pi * k / _EDGE_POINTS
        end = (
            missed.x + tolerance.plane * math.cos(angle),
            missed.y + tolerance.plane * math.sin(angle),
        )
        other = braked(*two_impulses(*displacements, end))
        best = map_leaves(partial(where, other[0] < best[0]), other, best)
    return best


def _braking(speed: Field, tolerance: ArrivalTolerance) -> Field:
    """Velocity change that brakes a speed along an axis to the tolerance, m/s."""
    return at_least(absolute(speed) - tolerance.speed, 0.0)
