"""Guidance to a position near a circular orbit by a planned arrival: by single impulses, or by few burns.

The equations of motion are linear (`rans.model.drift.ClohessyWiltshire`), thrusters are along the axes of W, the
Hill frame of the target, and a burn is an impulse at the start of a control period. Missions observe, reward and
fly what it recommends: a change alters trained agents' observations and recorded flights.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

from rans.extend import (
    Ball,
    Drift,
    Field,
    Shape,
    SpeedLimit,
    Vec3,
    absolute,
    at_least,
    map_leaves,
    where,
)
from rans_missions.guidance.arrival import PLANS, best_arrival, whole_periods
from rans_missions.guidance.few_burns import ArrivalTolerance, Transfer, cheapest_transfer
from rans_missions.guidance.impulses import axis_price
from rans_missions.orbits.reach import velocity_to_reach

_COAST_POINTS = 7
"""Number of points of a coast whose distance from keep-out balls is computed: a coast of a third of an orbit turns
by 15 degrees between them, and a straight line through the nearest one gives the distance between."""
_LEAST_DISTANCE = 1e-3
"""Lower bound of a distance from a ball's centre in divisions, m: less than any ball's radius."""
_LEAST_SPEED = 1e-9
"""Lower bound of speeds, m/s, and of their squares in divisions."""
_SLOW_ARRIVAL = 0.9
"""Part of the velocity tolerance below which the arrival must be for a burn across the plane to be postponed, which
makes it faster."""
_LIMIT_PRICE = 10.0
"""Price of a plan that violates a limit, m/s per unit of its margin: more than any transfer costs at a margin of
1."""
_LEAST_ALLOWED_SPEED = 1e-3
"""Lower bound of allowed speeds in divisions, m/s."""
_LATE_PRICE = 0.05
"""Price of a plan whose braking ends after the deadline, m/s per second: a control period late costs more than any
earlier arrival."""
_AIM_IN_PLANE = 0.65
"""Part of the position tolerance at which transfers of few burns aim in the orbital plane; with the part across it
is 0.79 of the tolerance, and the rest is for errors."""
_AIM_ACROSS = 0.45
"""Part of the position tolerance at which transfers of few burns aim across the orbital plane."""
_SPEED_LEFT = 0.95 / math.sqrt(3.0)
"""Part of the velocity tolerance that braking leaves along each axis: all three axes together have 0.95 of it."""
_RESCUE_PERIODS = 4.0
"""Control periods in which a craft goes to the goal that has missed its arrival."""
_FLOWN_BRAKE = 0.55
"""Part of the braking that is after the arrival: half, and a tenth of it because flown brakes are larger than those
of impulses."""
_BRAKE_ROUNDING = 0.95
"""Control periods added before the end of a brake is rounded down to whole ones: it is rounded up but for a rest of
a twentieth, which the last period brakes too."""


@dataclass(frozen=True)
class OrbitalGuidance(ABC):
    """Base class of guidance to a position near a circular orbit.

    States and goals have a position `p` and a velocity `v` in W; times are in seconds.

    Args:
        mission: an `rans_missions.tasks.orbital.OrbitalMission`: its tolerances, brake and reserves, period,
            and largest speed.
        drift: motion of a free point on the orbit.
        limits: limits of the mission at rest in W: coasts go around balls, velocities are scaled below speed
            limits, whose margin at rest is the allowed speed, and plans have a price for violating others.
    """

    mission: Any
    drift: Drift
    limits: tuple[Shape, ...]
    pushes: ClassVar[int] = 1
    """Number of times that a coast is moved out of each ball: moved once, it is nearest elsewhere."""

    def arrival(self, start: Any, goal: Any, deadline: Field) -> Field:
        """The time of arrival with the least price among whole control periods up to the deadline, s.

        Drawn goals have it in their notes: another price makes other episodes of the same seed.
        """
        period = self.mission.timing.control_period
        end = deadline - self.mission.braking_time if self.mission.brakes else deadline
        latest = whole_periods(end, period)
        return best_arrival(
            lambda time: self._planned_price(start, goal, time, latest, deadline),
            latest,
            period,
            self._plans,
        )

    @abstractmethod
    def velocity(self, state: Any, goal: Any, time_left: Field, deadline: Field) -> Any:
        """Velocity in W, m/s, with which to go to the goal within the limits.

        Args:
            state: state.
            goal: goal.
            time_left: time until the planned arrival, s.
            deadline: time until the deadline, s.
        """

    @abstractmethod
    def price(self, state: Any, goal: Any, time_left: Field) -> Field:
        """Velocity change of going to the goal with a burn now, m/s, and of braking if the craft brakes."""

    @abstractmethod
    def _planned_price(
        self, start: Any, goal: Any, time: Field, latest: Field, deadline: Field
    ) -> Field:
        """Velocity change for an arrival after a time, m/s, and a penalty if limits delay it beyond the latest."""

    @property
    def _plans(self) -> int:
        """Number of arrival times that are compared."""
        return PLANS

    def _coasting_velocity(self, p: Any, goal: Any, time: Field) -> Any:
        """Velocity, m/s, with which a craft coasts from a position to the goal in a time, s."""
        return velocity_to_reach(self.drift, p, goal.p, time)

    def _bounded(self, time: Field) -> Field:
        """A time, s, and the least time of a coast if it is less."""
        return at_least(time, self.mission.shortest_aim)

    @property
    def _speed_limits(self) -> tuple[SpeedLimit, ...]:
        return tuple(limit for limit in self.limits if isinstance(limit, SpeedLimit))

    def allowed_speed(self, limit: SpeedLimit, p: Any, v: Any) -> Field:
        """Speed limit at a position less the reserve, m/s."""
        return limit.gap(p, v.scale(0.0)) * (1.0 - self.mission.speed_reserve)

    def within(self, state: Any, velocity: Any, time: Field) -> Any:
        """A velocity in W, m/s, for a coast of a time, s, changed so far that it keeps balls and speeds."""
        for ball in self.limits:
            for _ in range(self.pushes if isinstance(ball, Ball) else 0):
                velocity = velocity + self._around(ball, state, velocity, time)
        return self.slowed(state, velocity)

    def slowed(self, state: Any, velocity: Any) -> Any:
        """A velocity in W, m/s, scaled down to the largest speed that is allowed where the craft is.

        The direction stays, as plans aim by it.
        """
        largest: Field = self.mission.most_gain
        for limit in self._speed_limits:
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
        for k in range(1, _COAST_POINTS + 1):
            fraction = k / (_COAST_POINTS + 1)
            p, _ = self.drift.carry(state.p, velocity, time * fraction)
            offset = p - ball.centre
            nearer = offset.norm() < distance
            nearest = map_leaves(partial(where, nearer), offset, nearest)
            distance = where(nearer, offset.norm(), distance)
            when = where(nearer, time * fraction, when)
        # The nearest point of a straight line through it, at most halfway to the points beside it.
        p, v = self.drift.carry(state.p, velocity, when)
        spacing = time * (0.5 / (_COAST_POINTS + 1))
        earlier = (p - ball.centre).dot(v) / at_least(v.dot(v), _LEAST_SPEED)
        earlier = where(
            earlier > spacing, spacing, where(earlier < -spacing, 0.0 - spacing, earlier)
        )
        when = at_least(when - earlier, self.mission.shortest_aim)
        p, _ = self.drift.carry(state.p, velocity, when)
        return p - ball.centre, when

    def _around(self, ball: Any, state: Any, velocity: Any, time: Field) -> Any:
        """Velocity change, m/s, that moves the nearest point of a coast out of a ball."""
        nearest, when = self.nearest(ball, state, velocity, time)
        distance = nearest.norm()
        inside = at_least(ball.radius + self.mission.keep_out_reserve - distance, 0.0)
        return nearest.scale(inside / (at_least(distance, _LEAST_DISTANCE) * when))


@dataclass(frozen=True)
class SingleImpulse(OrbitalGuidance):
    """Guidance by the velocity to gain: one impulse now, or its part across the plane later where that is cheaper.

    The velocity to gain is the velocity change now with which the craft coasts to the goal by the planned arrival
    (R. H. Battin, "An Introduction to the Mathematics and Methods of Astrodynamics", 1999, chapter 11). Beside
    keep-out balls the point of the coast that is nearest to a ball's centre is moved out of it.
    """

    def velocity(self, state: Any, goal: Any, time_left: Field, deadline: Field) -> Any:
        """See `OrbitalGuidance.velocity`; the part of the impulse across the plane may wait."""
        time = self._bounded(time_left)
        velocity = self._coasting_velocity(state.p, goal, time)
        # The node is that of a circular orbit.
        if not self.mission.brakes and isinstance(velocity, Vec3) and self.drift.steady:
            velocity = self._in_plane(state, velocity - state.v, time) + state.v
        return self.within(state, velocity, time)

    def price(self, state: Any, goal: Any, time_left: Field) -> Field:
        """See `OrbitalGuidance.price`."""
        time = self._bounded(time_left)
        velocity = self._coasting_velocity(state.p, goal, time)
        gain = self.within(state, velocity, time) - state.v
        return self._gain_price(state, goal, time_left, gain)

    def _gain_price(self, state: Any, goal: Any, time_left: Field, gain: Any) -> Field:
        """Velocity change of a gain now, m/s, and of braking at the arrival if the craft brakes."""
        price = axis_price(gain)
        if not self.mission.brakes:
            return price
        time = self._bounded(time_left)
        _, at_goal = self.drift.carry(state.p, state.v + gain, time)
        return price + axis_price(at_goal - goal.v)

    def _planned_price(
        self, start: Any, goal: Any, time: Field, latest: Field, deadline: Field
    ) -> Field:
        """Price, m/s, of an arrival after a time (s), with what limits and the deadline `latest` would cost.

        Fields.
        """
        gain = self._coasting_velocity(start.p, goal, self._bounded(time)) - start.v
        velocity = start.v + gain
        price = self._gain_price(start, goal, time, gain)
        delay = time * 0.0
        braked = time * 0.0
        # In the middle of equal parts of the coast.
        for k in range(_COAST_POINTS + 1):
            fraction = (k + 0.5) / (_COAST_POINTS + 1)
            p, v = self.drift.carry(start.p, velocity, self._bounded(time) * fraction)
            for limit in self._speed_limits:
                # This part of the way takes longer, and the excess speed is braked.
                speed = v.norm()
                allowed = self.allowed_speed(limit, p, v)
                excess = at_least(speed - allowed, 0.0)
                braked = where(excess > braked, excess, braked)
                slowest = at_least(allowed, _LEAST_ALLOWED_SPEED)
                delay = delay + time * (excess / (slowest * (_COAST_POINTS + 1)))
            for limit in self.limits:
                if isinstance(limit, SpeedLimit):
                    continue
                price = price + at_least(0.0 - limit.gap(p, v), 0.0) * _LIMIT_PRICE
        late = at_least(time + delay - latest, 0.0)
        return price + braked + late * (_LIMIT_PRICE / self._bounded(latest))

    def _in_plane(self, state: Any, gain: Vec3, time: Field) -> Vec3:
        """The part of the velocity to gain that is worth burning now, m/s: that across the plane may wait.

        Across the orbital plane a burn does most a quarter of an orbit before the arrival. In the plane burns that
        are postponed save 1 % by 2,000 s, and nothing by 1,000 s.
        """
        # A postponed burn makes the arrival faster, so it is allowed only while the arrival is slow enough.
        _, at_goal = self.drift.carry(state.p, state.v + gain, time)
        waits = at_goal.norm() < self.mission.velocity_tolerance * _SLOW_ARRIVAL
        waits = waits & (time > 0.5 * math.pi / self.mission.mean_motion)
        return replace(gain, z=where(waits, gain.z * 0.0, gain.z))


@dataclass(frozen=True)
class FewBurns(OrbitalGuidance):
    """Guidance by transfers of few burns (`rans_missions.guidance.few_burns`), with a brake around the arrival.

    A coast is moved out of all balls as by `SingleImpulse`, repeatedly.
    """

    pushes: ClassVar[int] = 3

    def velocity(self, state: Any, goal: Any, time_left: Field, deadline: Field) -> Any:
        """Velocity in W, m/s, by few burns with a brake around the arrival; see `OrbitalGuidance.velocity`."""
        period = self.mission.timing.control_period
        time = self._bounded(time_left)
        transfer = self._transfer(state, goal, time)
        # Too late for the plan: go to the goal within a few periods, within the limits as on any other coast.
        away = (goal.p - state.p).norm() > self.mission.position_tolerance
        late = (time_left < -period) & away
        rescue = _RESCUE_PERIODS * period + time * 0.0
        aimed = map_leaves(
            partial(where, late),
            self._coasting_velocity(state.p, goal, rescue),
            state.v + transfer.burn,
        )
        velocity = self.within(state, aimed, where(late, rescue, time))
        # After the arrival there are no corrections: the craft keeps its velocity below speed limits.
        waits = time_left < 0.5 * period
        waiting = self.slowed(state, state.v) if self._speed_limits else state.v
        coasting = map_leaves(partial(where, waits), waiting, velocity)
        braked = self._braked(state, goal, coasting, time_left, deadline)
        return map_leaves(partial(where, late), velocity, braked)

    def price(self, state: Any, goal: Any, time_left: Field) -> Field:
        """See `OrbitalGuidance.price`; `limits` are ignored."""
        return self._transfer(state, goal, self._bounded(time_left)).price

    def _planned_price(
        self, start: Any, goal: Any, time: Field, latest: Field, deadline: Field
    ) -> Field:
        transfer = self._transfer(start, goal, time)
        late = at_least(time + self._braking_after(transfer.brake) - deadline, 0.0)
        return transfer.price + late * _LATE_PRICE

    @property
    def _plans(self) -> int:
        """Half of those of single impulses, as each transfer takes many times the arithmetic."""
        return PLANS // 2

    def _braked(
        self, state: Any, goal: Any, velocity: Any, time_left: Field, deadline: Field
    ) -> Any:
        """A velocity in W, m/s, of which the components are braked whose time has come.

        Half of the braking is done before the arrival, as late as possible, and half of it after. Fields; times in
        s.
        """
        period = self.mission.timing.control_period
        speed_left = self.mission.velocity_tolerance * _SPEED_LEFT
        components = []
        for now, coasting, target in zip(
            state.v.columns(), velocity.columns(), goal.v.columns(), strict=True
        ):
            excess = at_least(absolute(now - target) - speed_left, 0.0)
            half = at_least(excess - 2.0 * self.mission.braking * (time_left - period), 0.0) * 0.5
            brake = where(time_left < 0.5 * period, excess, half)
            # The part that the periods after this one cannot brake before the deadline.
            pressing = at_least(excess - self.mission.braking * (deadline - period), 0.0)
            brake = where(pressing > brake, pressing, brake)
            braked = where(now > target, now - brake, now + brake)
            components.append(where(brake > 0.0, braked, coasting))
        return type(velocity)(*components)

    def _braking_after(self, brake: Field) -> Field:
        """Time after the arrival at which a brake (m/s) ends of which half is before it, s."""
        period = self.mission.timing.control_period
        duration = brake * (_FLOWN_BRAKE / self.mission.braking) + _BRAKE_ROUNDING * period
        return whole_periods(duration, period)

    def _transfer(self, state: Any, goal: Any, time: Field) -> Transfer:
        """The cheapest transfer from a state in a time, s."""
        tolerance = ArrivalTolerance(
            self.mission.position_tolerance * _AIM_IN_PLANE,
            self.mission.position_tolerance * _AIM_ACROSS,
            self.mission.velocity_tolerance * _SPEED_LEFT,
        )
        return cheapest_transfer(
            self.mission.mean_motion, state.p, state.v, goal.p, time, tolerance
        )
