"""Base class of missions near a target on a circular orbit, with a deadline and a planned arrival."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial, reduce
from operator import add
from typing import Any, ClassVar

from rans.errors import ConfigError
from rans.model.drift import ClohessyWiltshire, Drift, velocity_to_reach
from rans.model.dynamics import State
from rans.model.fields import (
    Field,
    Vec3,
    Vector,
    absolute,
    at_least,
    floor,
    map_leaves,
    sin,
    where,
)
from rans.model.random import Random
from rans.tasks.base import SingleTask
from rans.tasks.observation_terms import (
    AdvisedVelocityChange,
    Dimension,
    Information,
    InformationInW,
    ObservationTerm,
    VectorInW,
)
from rans.tasks.rewards import Transition, is_used
from rans.tasks.shapes import Ball, Shape, SpeedLimit
from rans.tasks.transfers import Coast, Ends, KeepOut

PLANS = 24
"""Number of arrival times that are compared for the plan of an episode, evenly up to its deadline."""
COAST_POINTS = 7
"""Number of points of a coast that are checked against keep-out balls."""
LATER_BURNS = tuple(200.0 * k for k in range(8, 0, -1))
"""Times before the planned arrival to which a part of the burn may be postponed, s."""
_WORTH = 0.005
"""Least share of the velocity change that postponing a part of the burn must save."""
_SLOW = 0.9
"""Burns may be postponed while the speed at the arrival is below this share of the velocity tolerance."""
_AIMED = 0.65
"""Share of the position tolerance that transfers of missions that brake use in the orbital plane."""
_AIMED_ACROSS = 0.45
"""The same across the orbital plane."""
_LEFT = 0.95 / math.sqrt(3.0)
"""Share of the velocity tolerance that braking leaves along each axis."""
_SMALL = 0.015
"""Share of the price of the rest of a transfer below which nothing is burnt."""
_SOON = 6.0
"""Control periods before the arrival up to which such small corrections wait."""
_BESIDE = 4.0
"""Reserves of a keep-out ball up to which a coast passes beside it."""
_PASSED = 0.4
"""Share of the time to the arrival within which it has passed."""
_PUSHES = 3
"""Number of times that a coast is pushed out of a keep-out ball."""
_RESCUE = 4.0
"""Control periods in which a craft goes to the goal that has missed its arrival."""
_WELL_WITHIN = 0.8
"""Share of the tolerances within which a craft that stays coasts on: the rest is for what no coast foresees."""
_RETURN = 4.0
"""Time of its return to the goal, in those that the position tolerance takes at the speed tolerance: it returns at
a quarter of the speed tolerance, and leaves the rest for errors."""
_UNHURRIED = 10.0
"""Control periods that it takes at least: burns last for one and displace a craft by a twentieth of the way."""
_CENTRE = 0.2
"""Share of the position tolerance within which it stops its return: twice the way of a period at least."""
_STOPPED = 0.4
"""Speed above which it does, in position tolerances over the time of the return: half of what it returns with."""
_LATE = 0.05
"""Price of a plan whose braking ends after the deadline, m/s per second."""
_NOTHING = 1e-9
"""Added to determinants so that none is zero, m^2 per (m/s)^2."""
REFINEMENTS = 3
"""Number of times that the distance between the arrival times is halved around the best one."""
_PENALTY = 10.0
"""Price of a plan that violates a limit, m/s per unit of its margin."""
INSTANT = 1e-3
"""Time left that counts as none, s: rounding of deadlines after many periods in single precision."""


def last_check(deadline: float, interval: float) -> int:
    """Number of the last check, every interval (s) from the start, at which `OrbitalMission.done` counts a success.

    >>> last_check(99.9995, 10.0), last_check(99.9, 10.0)
    (10, 9)
    """
    return math.floor((deadline + INSTANT) / interval + 1e-9)


@dataclass(frozen=True)
class OrbitalMission(SingleTask):
    """Base class of missions to a position near a target on a circular orbit by a deadline.

    W is the Hill frame of the target: x radially outwards, y along the track, z across it. The craft follows the
    Clohessy-Wiltshire equations. Every episode draws a deadline and fails if the mission has not succeeded by it.

    Every episode has a plan, which is an arrival time: among `PLANS` times up to the deadline, the one that a
    single impulse at the start reaches at the least velocity change. Plans that violate a limit at the start, at
    the arrival, or after a third or two thirds of the time have a penalty. The velocity to gain is the velocity
    change now with which the craft coasts to the goal by the planned arrival (Battin, "An Introduction to the
    Mathematics and Methods of Astrodynamics", 1999, chapter 11). The ``notes`` of the goal are the time left until
    the deadline and until the planned arrival, s, and 1 after success.

    Observed task data: vector to the goal, velocity to gain, velocity at the arrival after gaining it, miss
    distance of a coast to the planned arrival (saturated at ten tolerances), both times, and the entries of every
    shape in `scenery`.

    Rewards measure wasted velocity change: impulse has a price, and a decrease of the velocity to gain is
    rewarded by the same price. An impulse to the goal at the start of an episode therefore earns zero.

    Raises:
        ConfigError: the deadline is so late that the velocity to gain has no solution.
    """

    mean_motion: float = 0.001027
    """Mean motion n of the target's orbit, rad/s."""
    deadline: tuple[float, float] = (600.0, 2000.0)
    """Range of the deadline, s."""
    position_tolerance: float = 0.5
    """Distance from the goal at which the mission succeeds, m."""
    velocity_tolerance: float = 0.2
    """Speed at which the mission succeeds, m/s."""
    shortest_aim: float = 1.0
    """Least coasting time of the velocity to gain, s."""
    impulse_weight: float = 0.1
    """Reward lost per newton-second of thruster impulse."""
    gain_weight: float = 1.2
    """Reward per m/s by which the velocity to gain decreases, summed over the axes; by default the price of 1 m/s
    for 12 kg."""
    most_gain: float = 1.0
    """Upper bound of the velocity to gain in rewards and observations, m/s."""
    fail_distance: float = 1000.0
    """Distance from the goal beyond which an episode fails, m."""
    thrust_weight: float = 0.0
    """Reward lost per step and open thruster; zero because impulse has a price."""

    symmetric = False
    dimensions: ClassVar[tuple[Dimension, ...]] = (3,)
    optimal_problem = "rendezvous"
    braking_time: float = 20.0
    """Time between the latest planned arrival and the deadline, s; only of missions that brake."""
    braking: float = 0.02
    """Acceleration along each axis with which the craft brakes, m/s^2; only of missions that brake."""
    speed_reserve: float = 0.03
    """Share of a speed limit that recommended velocities stay below it: the limit may fall within a period."""
    keep_out_reserve: float = 4.0
    """Distance that recommended velocities keep from keep-out balls, m: coasts are checked at a few points."""
    brakes: ClassVar[bool] = False
    """Whether plans and rewards include the velocity change of braking at the arrival, and guidance brakes."""
    keeps: ClassVar[tuple[type[Shape], ...]] = (Ball, SpeedLimit)
    """Classes of the limits that recommended velocities keep."""
    stays: ClassVar[bool] = False
    """Whether success asks for staying within the tolerances after the arrival."""
    few_burns: ClassVar[bool] = False
    """Whether recommendations are transfers of few burns (`rans.tasks.transfers`); only of missions that brake."""

    def __post_init__(self) -> None:
        super().__post_init__()
        latest = self.deadline[1]
        if isinstance(latest, int | float) and latest * self.mean_motion >= 0.95 * math.pi:
            raise ConfigError(
                f"deadline must be < {0.95 * math.pi / self.mean_motion:.0f} s, 0.475 of the orbit's period, got "
                f"{self.deadline!r}: after half a period the velocity to gain has no solution."
            )

    @property
    def drift(self) -> Drift:
        """Clohessy-Wiltshire equations of the target's orbit."""
        return ClohessyWiltshire(self.mean_motion)

    def planned(self, random: Random, start: State, goal: State) -> State:
        """Goal with a drawn deadline and the plan for a start in its notes."""
        return self.plan(start, goal, random.uniform(*self.deadline))

    def plan(self, start: State, goal: State, deadline: Field) -> State:
        """Goal with a deadline, s, and the plan for a start in its notes."""
        goal = replace(goal, notes=(deadline, deadline, deadline * 0.0))
        latest = self._whole(deadline - self.braking_time if self.brakes else deadline)
        arrival = latest
        cheapest = self._planned_price(start, goal, arrival, latest)
        plans = PLANS // 2 if self.few_burns else PLANS
        step = latest * (1.0 / plans)
        tried = [latest * (1.0 - k / plans) for k in range(1, plans)]
        for earlier in tried:
            arrival, cheapest = self._cheaper(start, goal, latest, earlier, arrival, cheapest)
        # Between the best of them and its neighbours.
        for k in range(1, REFINEMENTS + 1):
            width = step * 0.5**k
            middle = arrival
            for time in (middle - width, middle + width):
                near = where(time < latest, time, latest)
                arrival, cheapest = self._cheaper(start, goal, latest, near, arrival, cheapest)
        return replace(goal, notes=(deadline, arrival, deadline * 0.0))

    def _cheaper(
        self, start: State, goal: State, latest: Field, time: Field, arrival: Field, price: Field
    ) -> tuple[Field, Field]:
        """The cheaper of a new time of arrival and the best one so far, with its price."""
        whole = at_least(self._whole(time), self.timing.control_period)
        new = self._planned_price(start, goal, whole, latest)
        better = new < price
        return where(better, whole, arrival), where(better, new, price)

    def _whole(self, time: Field) -> Field:
        """A time rounded down to whole control periods, s, as commands change only there."""
        period = self.timing.control_period
        return floor(time * (1.0 / period) + 1e-3) * period

    def _planned_price(self, start: Any, goal: Any, time: Field, latest: Field) -> Field:
        """Velocity change for an arrival after a time, m/s, and a penalty if limits delay it beyond the latest."""
        if self.few_burns:
            found = self._coast(start, goal, time).at_once()
            late = at_least(time + self._braking_after(found.brake) - goal.notes[0], 0.0)
            return found.price + late * _LATE
        gain = self.velocity_to_gain(start, goal, time)
        begun = start.v + gain
        price = self._price(start, goal, time, gain)
        delay = time * 0.0
        braked = time * 0.0
        for k in range(COAST_POINTS + 1):
            share = (k + 0.5) / (COAST_POINTS + 1)
            p, v = self.drift.carry(start.p, begun, at_least(time, self.shortest_aim) * share)
            for limit in self.limits(goal).values():
                if isinstance(limit, SpeedLimit):
                    # This part of the way takes longer, and what is too fast is braked.
                    speed = v.norm()
                    allowed = self._allowed(limit, p, v)
                    over = at_least(speed - allowed, 0.0)
                    braked = where(over > braked, over, braked)
                    delay = delay + time * (over / (at_least(allowed, 1e-3) * (COAST_POINTS + 1)))
                else:
                    price = price + at_least(0.0 - limit.gap(p, v), 0.0) * _PENALTY
        late = at_least(time + delay - latest, 0.0)
        return price + braked + late * (_PENALTY / at_least(latest, self.shortest_aim))

    def _allowed(self, limit: SpeedLimit, p: Any, v: Any) -> Field:
        """Speed that is recommended at most at a position, m/s."""
        return limit.gap(p, v.scale(0.0)) * (1.0 - self.speed_reserve)

    def arrival(self, goal: State) -> Field:
        """Time until the planned arrival, s."""
        return goal.notes[1]

    def later(self, goal: State, time: Field) -> State:
        """Goal after a time (s), with less time left; its position is constant."""
        deadline, arrival, won = goal.notes
        return replace(goal, notes=(deadline - time, arrival - time, won))

    def remember(self, goal: State, state: State) -> State:
        """Goal whose notes record whether the mission has succeeded."""
        deadline, arrival, won = goal.notes
        return replace(goal, notes=(deadline, arrival, where(self.done(state, goal), 1.0, won)))

    def scenery(self, goal: State) -> tuple[Shape, ...]:
        """Shapes of the mission's limits."""
        return tuple(self.limits(goal).values())

    def limits(self, goal: State) -> dict[str, Shape]:
        """Shapes whose margins are the constraints of the mission, by name; by default none."""
        return {}

    def constraints(self, state: State, goal: State) -> dict[str, Field]:
        """Margins of the limits, in SI units."""
        return {
            name: shape.gap(state.p, state.v - goal.v) for name, shape in self.limits(goal).items()
        }

    def velocity_to_gain(self, state: Any, goal: Any, left: Field) -> Any:
        """Velocity change in W, m/s, with which the craft coasts to the goal in the time left (s)."""
        time = at_least(left, self.shortest_aim)
        return velocity_to_reach(self.drift, state.p, goal.p, time) - state.v

    def recommended(self, state: Any, goal: Any, left: Field) -> Any:
        """Velocity in W, m/s, with which to go to the goal in the time left, s, within the limits.

        Beside keep-out balls the point of the coast that is nearest to a ball's centre is moved out of it, as
        far as it takes. Speeds are at most `most_gain`, and below speed limits by `speed_reserve`.
        """
        if self.few_burns:
            return self._recommended_with_brake(state, goal, left)
        time = at_least(left, self.shortest_aim)
        velocity = velocity_to_reach(self.drift, state.p, goal.p, time)
        if not self.brakes and isinstance(velocity, Vec3):
            velocity = self._now_or_later(state, goal, velocity - state.v, time) + state.v
        return self._within_limits(state, goal, velocity, time)

    def staying(self, state: Any, goal: Any) -> Any:
        """Velocity in W, m/s, with which a craft that has arrived stays at the goal, however long.

        It is the craft's own while a coast of one control period keeps within 0.8 of both tolerances. Elsewhere it
        is that of a coast to the goal, at about a quarter of the velocity tolerance from the edge of the position
        tolerance, and in ten control periods at least. Near the goal the return is stopped.
        """
        period = self.timing.control_period
        time = at_least(
            _RETURN * self.position_tolerance / self.velocity_tolerance, _UNHURRIED * period
        )
        distance, speed = (goal.p - state.p).norm(), (goal.v - state.v).norm()
        coasts = (distance > self.position_tolerance * _CENTRE) | (
            speed < self.position_tolerance * _STOPPED / time
        )
        for after in (0.0, 0.5 * period, period):
            p, v = self.drift.carry(state.p, state.v, after)
            near = (goal.p - p).norm() < self.position_tolerance * _WELL_WITHIN
            slow = (goal.v - v).norm() < self.velocity_tolerance * _WELL_WITHIN
            coasts = coasts & near & slow
        back = velocity_to_reach(self.drift, state.p, goal.p, time + distance * 0.0)
        return map_leaves(partial(where, coasts), state.v, back)

    def _recommended_with_brake(self, state: Any, goal: Any, left: Field) -> Any:
        """See `recommended`, of missions that brake at the arrival."""
        period = self.timing.control_period
        time = at_least(left, self.shortest_aim)
        found = self._coast(state, goal, time).cheapest(self._keep_out(goal))
        aimed = state.v + found.burn
        velocity = self._within_limits(state, goal, aimed, time)
        # Small corrections wait, as do those on the way past a ball. After the arrival there are none.
        small = _sum_of_sizes(velocity - state.v) < found.price * _SMALL
        waits = (small & (left > _SOON * period)) | (left < 0.5 * period)
        for limit in self.limits(goal).values():
            if isinstance(limit, Ball):
                waits = waits | self._passes(limit, state, aimed, time)
        velocity = map_leaves(partial(where, waits), state.v, velocity)
        velocity = self._braked(state, goal, velocity, left)
        # Too late for the plan: go to the goal soon.
        away = (goal.p - state.p).norm() > self.position_tolerance
        late = (left < -period) & away
        soon = velocity_to_reach(self.drift, state.p, goal.p, _RESCUE * period + time * 0.0)
        return map_leaves(partial(where, late), soon, velocity)

    def _braked(self, state: Any, goal: Any, velocity: Any, left: Field) -> Any:
        """A velocity in W, m/s, of which the components are braked whose time has come.

        Half of the braking is done before the arrival, as late as possible, and half of it after.
        """
        period = self.timing.control_period
        least = self.velocity_tolerance * _LEFT
        components = []
        for now, wanted, target in zip(
            state.v.columns(), velocity.columns(), goal.v.columns(), strict=True
        ):
            excess = at_least(absolute(now - target) - least, 0.0)
            half = at_least(excess - 2.0 * self.braking * (left - period), 0.0) * 0.5
            brake = where(left < 0.5 * period, excess, half)
            # What the periods after this one cannot brake before the deadline.
            pressing = at_least(excess - self.braking * (goal.notes[0] - period), 0.0)
            brake = where(pressing > brake, pressing, brake)
            braked = where(now > target, now - brake, now + brake)
            components.append(where(brake > 0.0, braked, wanted))
        return type(velocity)(*components)

    def _passes(self, ball: Ball, state: Any, aimed: Any, time: Field) -> Field:
        """Whether a coast passes a ball at a small distance, while the ball blocks the way of a velocity."""
        coast, when = self._nearest(ball, state, state.v, time)
        blocked, _ = self._nearest(ball, state, aimed, time)
        reserve = self.keep_out_reserve
        beyond = coast.norm() - ball.radius
        clear = (beyond > 0.5 * reserve) & (beyond < _BESIDE * reserve)
        soon = when < time * _PASSED
        return clear & soon & (blocked.norm() < ball.radius + 0.5 * reserve)

    def _braking_after(self, brake: Field) -> Field:
        """How long after the arrival a brake (m/s) ends of which half is before it, s."""
        period = self.timing.control_period
        # Flown brakes are a little larger than those of impulses.
        return self._whole(brake * (0.55 / self.braking) + 0.95 * period)

    def _coast(self, state: Any, goal: Any, time: Field) -> Coast:
        """The coast from a state for a time, s, from which transfers are found."""
        ends = Ends(
            self.position_tolerance * _AIMED,
            self.position_tolerance * _AIMED_ACROSS,
            self.velocity_tolerance * _LEFT,
        )
        return Coast(self.mean_motion, state.p, state.v, goal.p, time, ends, self.braking)

    def _keep_out(self, goal: Any) -> KeepOut | None:
        """The first keep-out ball, with its reserve."""
        for limit in self.limits(goal).values():
            if isinstance(limit, Ball) and isinstance(limit.centre, Vec3):
                return KeepOut(limit.centre, limit.radius + self.keep_out_reserve)
        return None

    def _within_limits(self, state: Any, goal: Any, velocity: Any, time: Field) -> Any:
        """A velocity for a coast of this time, s, changed so far that it keeps the limits."""
        limits = self.limits(goal).values()
        for limit in limits:
            if isinstance(limit, Ball):
                # Pushed aside, a coast is nearest elsewhere.
                for _ in range(_PUSHES if self.few_burns else 1):
                    velocity = velocity + self._around(limit, state, velocity, time)
        most: Field = self.most_gain
        for limit in limits:
            if isinstance(limit, SpeedLimit):
                allowed = self._allowed(limit, state.p, state.v)
                most = where(allowed < most, allowed, most)
        speed = velocity.norm()
        return velocity.scale(where(speed > most, most / at_least(speed, 1e-9), 1.0))

    def _now_or_later(self, state: Any, goal: Any, gain: Vec3, time: Field) -> Vec3:
        """The part of the velocity to gain that is worth burning now, m/s.

        Thrusters along the axes pay for the sum of the components. Across the orbital plane a burn does most a
        quarter of an orbit before the arrival. In the plane, burns along one axis now and along one later, or
        along both later, are compared with all of it now; later ones are at `LATER_BURNS` before the arrival.
        """
        n = self.mean_motion
        missed = goal.p - self.drift.carry(state.p, state.v, time)[0]
        m = (missed.x, missed.y)
        now = _burn_effects(n, time)
        x, y = gain.x, gain.y
        cheapest = (absolute(x) + absolute(y)) * (1.0 - _WORTH)
        nothing = gain.x * 0.0
        for k, before in enumerate(LATER_BURNS):
            possible = time > before + INSTANT
            later = _burn_effects(n, before)
            for axis, first in enumerate(now):
                for second in later:
                    u, w = _solved(first, second, m)
                    price = absolute(u) + absolute(w)
                    better = possible & (price < cheapest)
                    cheapest = where(better, price, cheapest)
                    x = where(better, u if axis == 0 else nothing, x)
                    y = where(better, u if axis == 1 else nothing, y)
            others = [later, *(_burn_effects(n, other) for other in LATER_BURNS[k + 1 :])]
            for first in later:
                for other in others:
                    for second in other:
                        if second is first:
                            continue
                        u, w = _solved(first, second, m)
                        price = absolute(u) + absolute(w)
                        better = possible & (price < cheapest)
                        cheapest = where(better, price, cheapest)
                        x = where(better, nothing, x)
                        y = where(better, nothing, y)
        z = where(time > 0.5 * math.pi / n, nothing, gain.z)
        # A postponed burn makes the arrival faster, so it is allowed only while the arrival is slow enough.
        _, at_goal = self.drift.carry(state.p, state.v + gain, time)
        slow = at_goal.norm() < self.velocity_tolerance * _SLOW
        return map_leaves(partial(where, slow), Vec3(x, y, z), gain)

    def _around(self, ball: Ball, state: Any, velocity: Any, time: Field) -> Any:
        """Velocity change, m/s, with which the coast for this time passes beside a ball."""
        nearest, when = self._nearest(ball, state, velocity, time)
        distance = nearest.norm()
        short = at_least(ball.radius + self.keep_out_reserve - distance, 0.0)
        return nearest.scale(short / (at_least(distance, 1e-3) * when))

    def _nearest(self, ball: Ball, state: Any, velocity: Any, time: Field) -> tuple[Any, Field]:
        """Vector from a ball's centre to the nearest point of a coast for this time, m, and when it is there, s."""
        nearest = state.p - ball.centre
        distance = nearest.norm()
        when = time
        for k in range(1, COAST_POINTS + 1):
            share = k / (COAST_POINTS + 1)
            p, _ = self.drift.carry(state.p, velocity, time * share)
            way = p - ball.later(time * share).centre
            nearer = way.norm() < distance
            nearest = map_leaves(partial(where, nearer), way, nearest)
            distance = where(nearer, way.norm(), distance)
            when = where(nearer, time * share, when)
        # The nearest point of a straight line through it, at most halfway to the points beside it.
        p, v = self.drift.carry(state.p, velocity, when)
        v = v - ball.v
        spacing = time * (0.5 / (COAST_POINTS + 1))
        sooner = (p - ball.later(when).centre).dot(v) / at_least(v.dot(v), 1e-9)
        sooner = where(sooner > spacing, spacing, where(sooner < -spacing, 0.0 - spacing, sooner))
        when = at_least(when - sooner, self.shortest_aim)
        p, _ = self.drift.carry(state.p, velocity, when)
        return p - ball.later(when).centre, when

    def observation_terms(self, state: Any, goal: Any) -> tuple[ObservationTerm, ...]:
        """Vector to the goal, velocity to gain and of arrival, miss distance, times left, and entries of limits."""
        deadline, arrival = goal.notes[:2]
        gain = self.velocity_to_gain(state, goal, arrival)
        time = at_least(arrival, self.shortest_aim)
        _, at_goal = self.drift.carry(state.p, state.v + gain, time)
        missed = goal.p - self.drift.carry(state.p, state.v, time)[0]
        advised = self.recommended(state, goal, arrival) - state.v
        # The velocity to gain is unbounded just before an arrival that misses the goal.
        nearby = 0.1 / self.position_tolerance
        scale = 1.0 / at_least(gain.norm() * (1.0 / self.most_gain), 1.0)
        return (
            VectorInW("d", "m", goal.p - state.p),
            VectorInW(
                "gain_",
                "m/s",
                gain.scale(scale),
                meaning="velocity with which the craft coasts to the goal in the time to arrival, minus own, "
                f"divided by 1 or, if more, its length over {self.most_gain:g} m/s",
            ),
            InformationInW(
                "arrival_v_",
                "m/s",
                at_goal.scale(scale),
                meaning="velocity with which that coast arrives, divided by the same number",
            ),
            InformationInW(
                "miss_",
                "m",
                missed.scale(1.0 / (1.0 + missed.norm() * nearby)),
                meaning="position of the goal minus that of the craft after a coast of the time to arrival, "
                f"divided by 1 plus its length times {nearby:g} 1/m",
            ),
            Information("time left", "s", deadline, meaning="time until the mission must be over"),
            Information(
                "time to arrival",
                "s",
                arrival,
                meaning="time until the arrival that guidance plans",
            ),
            AdvisedVelocityChange(
                "advised_dv_",
                "m/s",
                advised,
                meaning="velocity that guidance recommends, minus own",
            ),
            *(
                entry
                for name, shape in self.limits(goal).items()
                for entry in shape.entries(name, state)
            ),
        )

    def errors(self, state: State, goal: State) -> dict[str, Field]:
        """Distance from the goal, m, and speed relative to it, m/s."""
        return {
            "position": (goal.p - state.p).norm(),
            "velocity": (goal.v - state.v).norm(),
        }

    def reward(self, transition: Transition) -> dict[str, Field]:
        """Decrease of the velocity to gain, less the price of impulse."""
        goal = transition.goal
        _, arrival, won = goal.notes[:3]
        terms = {}
        if is_used(self.impulse_weight):
            terms["impulse"] = transition.impulse * -self.impulse_weight
        if is_used(self.gain_weight):
            before = transition.state if transition.before is None else transition.before
            past = self._counted(before, goal, arrival + transition.period)
            now = self._counted(transition.state, goal, arrival)
            # After success nothing is left to gain, whatever happens in the rest of the period.
            terms["gain"] = (past - where(won > 0.5, 0.0, now)) * self.gain_weight
        return {**terms, **self.prices(transition)}

    def _counted(self, state: Any, goal: Any, left: Field) -> Field:
        """Velocity to gain as rewards count it, m/s."""
        time = at_least(left, self.shortest_aim)
        if self.few_burns:
            price = self._coast(state, goal, time).at_once().price
            return where(price < self.most_gain, price, self.most_gain)
        whole = velocity_to_reach(self.drift, state.p, goal.p, time)
        gain = self._within_limits(state, goal, whole, time) - state.v
        price = self._price(state, goal, left, gain)
        return where(price < self.most_gain, price, self.most_gain)

    def _price(self, state: Any, goal: Any, left: Field, gain: Any) -> Field:
        """Velocity change of gaining ``gain`` now, m/s, and of braking at the arrival if the mission brakes."""
        price = _sum_of_sizes(gain)
        if not self.brakes:
            return price
        time = at_least(left, self.shortest_aim)
        return price + _sum_of_sizes(self.drift.carry(state.p, state.v + gain, time)[1] - goal.v)

    def done(self, state: State, goal: State) -> Field:
        """Whether the state is within all tolerances before the deadline."""
        return self.reached(state, goal) & (goal.notes[0] > -INSTANT)

    def failed(self, state: State, goal: State) -> Field:
        """Whether the craft is too far away, or the deadline has passed."""
        distance = self.errors(state, goal)["position"]
        return (distance > self.fail_distance) | (goal.notes[0] < INSTANT)


def _burn_effects(n: float, time: Field) -> tuple[tuple[Field, Field], tuple[Field, Field]]:
    """Change of position in the orbital plane after a time, m, by 1 m/s along x and by 1 m/s along y."""
    s = sin(n * time)
    half = sin(0.5 * n * time)
    across = 4.0 * half * half / n
    return (s / n, 0.0 - across), (across, 4.0 * s / n - 3.0 * time)


def _solved(
    first: tuple[Field, Field], second: tuple[Field, Field], missed: tuple[Field, Field]
) -> tuple[Field, Field]:
    """Factors of two vectors in the plane whose sum is a third."""
    determinant = first[0] * second[1] - first[1] * second[0]
    # Vectors along one line solve nothing: factors are huge then.
    scale = 1.0 / (determinant + _NOTHING)
    return (
        (missed[0] * second[1] - missed[1] * second[0]) * scale,
        (first[0] * missed[1] - first[1] * missed[0]) * scale,
    )


def _sum_of_sizes(v: Vector) -> Field:
    """Sum of the absolute components: the velocity change of thrusters along the axes."""
    return reduce(add, map(absolute, v.columns()))
