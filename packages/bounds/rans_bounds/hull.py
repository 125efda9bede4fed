"""Bounds for every spacecraft, in the plane and in space, from the most that its thrusters can do.

A convex relaxation: on/off commands become their convex hull, every share between 0 and 1, held for a
period or not; translation and rotation are looked at one at a time, and either may use all thrusters in any
direction of B. So they are looser than those of `rans_bounds.certificate`, but hold for shared
thrust and any layout (docs/bounds/certificate.md proves them).
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np

from rans.extend import ConfigError, Spacecraft, State, check_certifiable, inertia, rotation_vector
from rans_bounds.goal_set import GoalSet
from rans_bounds.problem import check_finite
from rans_bounds.transfer import Corners, Transfer, Turning

_MOST_THRUSTERS = 16
"""Up to which all sets of open thrusters are looked at, 65,536 of them."""
_PARTS = 256
"""Intervals of the trapezoidal rule; more of them raise a bound by less than 1e-4 of itself."""
_LEVER = 1e-6
"""Arm that thrusters count as having at least, m: bounds of a craft that cannot turn stay finite."""
_ROUNDING = 1e-9
"""Relative, given away for the rounding of the computer: some thousand additions of numbers alike."""


class Health(NamedTuple):
    """Health of thrusters: share that is left of each, and what leaks, see `rans.model.body.Body`."""

    gain: tuple[float, ...]
    leak: tuple[float, ...]

    @classmethod
    def sound(cls, craft: Spacecraft) -> Health:
        """Health of thrusters as designed."""
        return cls((1.0,) * craft.thruster_count, (0.0,) * craft.thruster_count)


@dataclass(frozen=True)
class Reach:
    """Largest force and torque of the thrusters and wheels, whatever the attitude."""

    thrust: np.ndarray
    """(K,) sums of the open thrusters' forces, N."""
    force: np.ndarray
    """(K,) the greatest force on B at each of them, N."""
    torque: float
    """Greatest torque about any axis, N m."""
    arm: float
    """Torque per newton of thrust at most, m; infinite with wheels, which turn without thrust."""
    most: float
    """The greatest thrust, N: turning may need more than the greatest force on B does."""

    @classmethod
    @cache
    def of(cls, craft: Spacecraft, health: Health | None = None) -> Reach:
        """Reach of a spacecraft, with its thrusters as faults leave them from the start on.

        Upper bounds of force and torque: too large ones make bounds loose, too small ones wrong.
        """
        check_certifiable(craft, wheels=True)
        wheels = sum(wheel.max_torque for wheel in craft.wheels)
        gain, leak = np.array(health or Health.sound(craft))
        able = gain + leak > 0.0
        whole = np.array([t.force for t in craft.thrusters])
        torques = np.linalg.norm(craft.wrenches[:, craft.dimension :], axis=1)
        torques = np.maximum(torques, _LEVER * whole) * able
        forces = whole * able
        arm = math.inf if craft.wheels else float((torques / whole).max())
        strongest = float(forces.sum())
        if craft.thrust_sharing == "split":
            single = np.append(0.0, forces)
            return cls(single, single, float(torques.max()) + wheels, arm, float(forces.max()))
        if len(forces) > _MOST_THRUSTERS:  # no force exceeds the thrust
            ends = np.array([0.0, strongest])
            return cls(ends, ends, float(torques.sum()) + wheels, arm, strongest)
        sets = (np.arange(2 ** len(forces))[:, None] >> np.arange(len(forces))) & 1
        opened = sets * gain + leak
        total = opened @ craft.wrenches
        size = np.linalg.norm(total[:, : craft.dimension], axis=1)
        turning = float(np.linalg.norm(total[:, craft.dimension :], axis=1).max())
        turning = max(turning, _LEVER * strongest) + wheels
        return cls(*_frontier(opened @ whole, size), turning, arm, strongest)


def _frontier(thrust: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sets of thrusters that no other set beats with less thrust or as much force."""
    order = np.lexsort((-force, thrust))
    thrust = thrust[order]
    force = force[order]
    best = np.maximum.accumulate(np.append(-1.0, force))[:-1]
    return thrust[force > best], force[force > best]


def least_time(
    craft: Spacecraft,
    aims: Collection[str],
    start: State,
    goal: State,
    goal_set: GoalSet,
    health: Health | None = None,
) -> float:
    """A time before which nothing can have arrived, s; infinite where nothing ever does.

    Start and goal are of floats. What must be in the goal set is named by the aims, see
    `rans.tasks.goal_set.aims`. Thrusters are sound by default; what fails later than at
    the start can have arrived no sooner than a sound craft.

    Raises:
        ConfigError: the start or the goal is not finite.
    """
    reach = Reach.of(craft, health)
    times = [_least_time(*_rotation(craft, aims, start, goal, goal_set), reach.torque)]
    # Motion along an axis is a double integrator: along the way, along the change of velocity, and along the
    # velocity at the start, both ways.
    push = float(reach.force.max()) / craft.mass
    displacement, before, after = (
        np.array(x.columns()) for x in (goal.p - start.p, start.v, goal.v)
    )
    margin = goal_set.velocity if "velocity" in aims else math.inf
    vectors = [
        v / np.linalg.norm(v)
        for v in (displacement, after - before, before)
        if np.linalg.norm(v) > 0
    ]
    for axis in (sign * v for v in vectors for sign in (1.0, -1.0)):
        far = displacement @ axis - goal_set.position if "position" in aims else -math.inf
        change = max(0.0, abs(float((after - before) @ axis)) - margin)
        speeds = float(before @ axis), float(after @ axis) + margin
        times.append(_least_time(float(far), *speeds, change, push))
    return max(times) * (1.0 - _ROUNDING)


def settling_set(
    craft: Spacecraft, tolerance: float, angle: float, period: float, health: Health | None = None
) -> GoalSet:
    """Set that contains everyone who stays this near the goal's pose (m, rad) for good, seen once a period (s).

    Who stays in a ball of radius r with accelerations up to a is no faster than 2 sqrt(a r + (a h / 4)^2): it
    goes on along its velocity by at least v^2 / (2 a), of which it is short by a (h / 2)^2 / 2 at most when
    looked at next to the farthest point, and has no more than the diameter. The spin's bound so found, with
    angles for ways, is that of the plane, where nobody counts as staying who makes whole turns unseen.

    Raises:
        ConfigError: a tolerance is negative or not finite, the period negative or not finite.
    """
    if not (math.isfinite(period) and period >= 0):
        raise ConfigError(
            f"a bound of settling needs a finite period >= 0 s between looks, got {period!r}."
        )
    near = GoalSet(tolerance, 0.0, angle, 0.0)
    reach = Reach.of(craft, health)
    push = float(reach.force.max()) / craft.mass
    turn = reach.torque / craft.inertia[2][2]
    speed, spin = (
        2.0 * math.sqrt(a * r + (a * period / 4.0) ** 2)
        for a, r in ((push, tolerance), (turn, angle))
    )
    return replace(near, velocity=speed, spin=spin)


def staying_time(
    craft: Spacecraft, within: GoalSet, period: float, health: Health | None = None
) -> float:
    """Time after which every flight that starts outside the set has been seen to leave it, s.

    Infinite where no thruster is left: who is as slow as you like leaves as late.
    The farthest point of the proof of `settling_set` is v / a ahead, and the next look half a period later.
    """
    reach = Reach.of(craft, health)
    if reach.most == 0:
        return math.inf
    braking = within.velocity * craft.mass / float(reach.force.max())
    return max(braking, within.spin * craft.inertia[2][2] / reach.torque) + 0.5 * period


def _least_time(
    displacement: float, before: float, after: float, change: float, push: float
) -> float:
    """Least T with push T >= change and way <= integral of min(before + push t, after + push (T - t)).

    Infinite where there is none, which takes a push of zero.
    """
    if push == 0:
        return _drifting_time(displacement, min(before, after), change)
    first = change / push
    if not math.isfinite(displacement):
        return first
    # while push T <= after - before the first line is the lower one throughout
    early = _roots(0.5 * push, before, -displacement)
    late = (
        _roots(
            0.25 * push, 0.5 * (before + after), -displacement - 0.25 * (before - after) ** 2 / push
        )
        if math.isfinite(after)
        else []
    )
    for time in sorted(t for t in (first, *early, *late) if t >= first):
        if _covered(time, before, after, push) >= displacement - 1e-9 * abs(displacement):
            return time
    return first  # pragma: no cover - the last root always covers the way


def _drifting_time(displacement: float, speed: float, change: float) -> float:
    """`_least_time` of those whom nothing pushes: they keep their speed."""
    if change > 0 or (displacement > 0 and speed <= 0):
        return math.inf
    return displacement / speed if displacement > 0 else 0.0


def _roots(a: float, b: float, c: float) -> list[float]:
    discriminant = b * b - 4.0 * a * c
    return (
        []
        if discriminant < 0
        else [(-b + sign * math.sqrt(discriminant)) / (2.0 * a) for sign in (-1, 1)]
    )


def _covered(time: float, before: float, after: float, push: float) -> float:
    switch = min(time, max(0.0, 0.5 * (time + (after - before) / push)))
    rest = time - switch
    braking = after * rest + 0.5 * push * rest**2 if rest > 0 else 0.0
    return before * switch + 0.5 * push * switch**2 + braking


def least_fuel(
    craft: Spacecraft,
    aims: Collection[str],
    start: State,
    goal: State,
    horizon: float,
    goal_set: GoalSet,
) -> float:
    """Impulse below which nothing is in the goal set at the horizon (s), N s; infinite if nothing can.

    Raises:
        ConfigError: the horizon is not positive, or the start or the goal not finite.
    """
    if not (math.isfinite(horizon) and horizon > 0):
        raise ConfigError(f"a bound of impulse needs a finite horizon > 0 s, got {horizon}.")
    # Rotation. With the angular impulse S in all, the angular momentum is never above before + s nor after + S - s,
    # where s has been given already: in the mean it is at most (before + after + S) / 2, and must turn the craft.
    (turn, before, after, change) = _rotation(craft, aims, start, goal, goal_set)
    reach = Reach.of(craft)
    angular_impulse = max(2.0 * turn / horizon - before - after, change) - _ROUNDING * before
    turning = angular_impulse / reach.arm if angular_impulse > 0 else 0.0
    # Translation: the force at each thrust in any direction, as no tube limits the attitude.
    displacement, first, last = (
        np.array(x.columns(), float) for x in (goal.p - start.p, start.v, goal.v)
    )
    count = len(first)
    translation = Transfer(
        Corners(reach.force[:, None] * np.eye(count)[0], 0.0 * reach.force, reach.thrust),
        craft.mass,
        horizon,
        displacement - first * horizon,
        last - first,
        (
            goal_set.velocity if "velocity" in aims else math.inf,
            goal_set.position if "position" in aims else math.inf,
        ),
        Turning.none(_PARTS),
        np.broadcast_to(np.eye(count), (_PARTS, count, count)),
        np.full(_PARTS, math.pi),
    )
    moving = translation.bound(1.0)
    bound = max(turning, moving, 0.0) * (1.0 - _ROUNDING)
    return bound if bound <= horizon * reach.most else math.inf


def _rotation(
    craft: Spacecraft, aims: Collection[str], start: State, goal: State, goal_set: GoalSet
) -> tuple[float, float, float, float]:
    """Change of angular momentum that arriving takes.

    The angle to turn times the least moment of inertia, kg m^2; its size at the start, at most at the end,
    and by how much that changes at least, kg m^2/s. In space with wheels nothing is claimed: their momentum
    turns that of the body, and gyroscopic torques may then raise it.
    """
    check_finite(start, goal)
    if craft.wheels and craft.dimension == 3:
        return -math.inf, 0.0, math.inf, 0.0
    tensor = inertia(craft)
    moments = np.linalg.eigvalsh(tensor)
    angle = (
        float(np.linalg.norm(rotation_vector(start.attitude.to(goal.attitude)))) - goal_set.heading
    )
    before, after = (float(np.linalg.norm(tensor @ np.array(x.spin()))) for x in (start, goal))
    slack = float(moments[-1]) * goal_set.spin if "spin" in aims else math.inf
    moment = angle * float(moments[0]) if "attitude" in aims else -math.inf
    return moment, before, after + slack, max(0.0, abs(after - before) - slack)
