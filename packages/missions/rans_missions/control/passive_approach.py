"""Approach of a hold point that is passively safe: coasts keep out of the ball whenever the thrusters shut.

Plans are drawn with one seed, so that a start has the same plan in every batch; distances are in m in the Hill
frame.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from rans.extend import Vec3
from rans_missions.control.velocity_guidance import VelocityGuidance
from rans_missions.guidance.staying import circling
from rans_missions.orbits.linear import carried, pushed
from rans_missions.orbits.reach import velocity_to_reach
from rans_missions.passive_safety import (
    Pieces,
    coasts_of_flights,
    joined,
    keep_away,
    least_distances,
    single_coasts,
)
from rans_missions.tasks.hold import Hold
from rans_missions.vectors import motion_of

_LEGS = ((1, 24), (2, 6000), (3, 8000))
"""Numbers of coasts of plans, and how many of these are drawn first: one has only its time to choose."""
_MORE_LEGS = ((2, 6000), (3, 24_000), (4, 24_000))
"""Numbers of coasts and of plans of every further draw: near the deadline few plans of many coasts are safe."""
_DRAWS = 12
"""Largest number of draws for a start; four found a plan for every start of 1,024 that had none in the first."""
_CHECKED = 256
"""Number of plans whose coasts are computed at once, the cheapest first."""
_FIRST_BURN = 1.5
"""Instant of the first burn, control periods: half of a burn of three periods after the start."""
_IMPOSSIBLE = 1e3
"""Price of a plan whose burns overlap, m/s: more than any plan costs."""
_ARRIVED = 10.0
"""Control periods after the last burn's instant at which a craft has arrived."""
_SHORTEST = 0.08
"""Least part of the time of a plan that a coast takes."""
_EARLIEST = 0.4
"""Least part of the time to the deadline after which a plan arrives."""
_BEHIND = (60.0, 10.0, 160.0)
"""Sizes of the box from which the last coast to the hold point starts, m: half its height, and how far ahead of the
point and behind it it reaches."""
_AROUND = 120.0
"""Half size of the box around a part of the way from which an earlier coast starts, m."""
_TRIM = 5e-4
"""Error of velocity that is left alone, m/s: a craft whose speed is off by it drifts by 9 m an orbit."""
_EDGE = 0.8
"""Part of the position tolerance beyond which a craft that has arrived comes back."""
_PREDICTED = 8
"""Number of plans of each batch, safe if burns were impulses, whose flight is predicted."""
_CLEAR = 0.1
"""Least distance of the coasts of a predicted flight from the zone, m: for rounding to pulses."""


_MOST_LEGS = 4
"""Largest number of coasts of a plan."""


class _Plans(NamedTuple):
    """K plans, each with a row of up to four coasts: behind its last one the times are infinite."""

    price: np.ndarray
    """(K,) sum of the changes of velocity along the axes, m/s."""
    times: np.ndarray
    """(K, 5) instants of the burns, s: the middle of each."""
    begins: np.ndarray
    """(K, 5) instants at which the burns begin, s."""
    points: np.ndarray
    """(K, 4, 3) where each coast ends, m."""
    before: np.ndarray
    """(K, 5, 6) states before each burn, if burns are impulses; behind the last one at rest at the goal."""
    after: np.ndarray
    """(K, 5, 6) states after each burn."""

    def rows(self, numbers: Any) -> _Plans:
        """The plans with these numbers."""
        return _Plans(*(x[numbers] for x in self))

    @property
    def ends(self) -> np.ndarray:
        """(K,) instant of each plan's last burn, s."""
        return np.max(self.times, axis=1, where=np.isfinite(self.times), initial=0.0)


class PassiveApproach(VelocityGuidance[Hold]):
    """Flies to a hold point so that if all thrusters shut, a coast of an orbit never enters the keep-out ball.

    >>> rans.PassiveApproach("vbar-chaser", "hold")
    <passive: Hold for vbar-chaser>

    A plan has one to four coasts and a burn before and after each. Plans are drawn at random, with the same random
    numbers for every start, and again where none of them is safe. In the order of their prices all their coasts
    are computed (`rans_missions.passive_safety`): those of the plan, and those after any part of a burn, first of
    impulses and then of burns as they are flown. The cheapest plan whose coasts keep out of the ball is flown,
    without one the cheapest of all. Burns of several control periods are centred on their
    instants and keep their direction. At the hold point the craft stays on a closed ellipse, which drifts nowhere.

    It knows the state exactly, and expects no errors of sensors and thrusters.

    Args:
        craft: by name, TOML file or as such.
        task: a `rans.Hold`, or its name.
        timing: control period, and length of the episode; None: the task's.

    Raises:
        ConfigError: the task is not hold.
    """

    name = "passive"
    mission = Hold
    purpose = "passive approach flies to hold points"
    _plans: _Plans | None = None

    def reset(self, count: int) -> None:
        """See `rans.episode.flight.Controller`; forgets plans."""
        super().reset(count)
        self._plans = None

    def velocity_change(self, state: Any, goal: Any, now: float) -> tuple[np.ndarray, np.ndarray]:
        """Changes of velocity (N, 3), m/s, and which rows burn; see the base.

        All plans are made at the first call and stay in `_plans`. Craft that have arrived and drift to the edge of
        the tolerance come back.
        """
        states = motion_of(state)
        goals = np.stack(goal.p.columns(), axis=1)
        if self._plans is None:
            deadlines = np.asarray(goal.notes.deadline)
            rows = zip(states, goals, deadlines, strict=True)
            self._plans = joined([self._plan(*row) for row in rows])
        change = self._change_by_plans(self._plans, states, goals, now)
        staying = np.stack(self.task.staying(state, goal).columns(), axis=1)
        away = np.linalg.norm(states[:, :3] - goals, axis=1) > self.task.position_tolerance * _EDGE
        over = now > self._plans.ends + _ARRIVED * self._period
        change = np.where((over & away)[:, None], staying - states[:, 3:], change)
        burns: Any = change.any(axis=1)
        return change, burns

    def _change_by_plans(
        self, plans: _Plans, states: np.ndarray, goals: np.ndarray, now: float
    ) -> np.ndarray:
        """(N, 3) change of velocity in W, m/s, that plans ask of this period; a burn acts in its middle.

        Burns keep their direction where a component exceeds what a period can give.
        """
        # Number of burns that have begun, of which the last one leads to the end of the present coast.
        begun = (now >= plans.begins - 1e-6).sum(axis=1)
        coasts = np.isfinite(plans.times).sum(axis=1) - 1
        present = np.clip(begun, 1, coasts) - 1
        every = np.arange(len(states))
        target = plans.points[every, present]
        end = plans.times[every, present + 1]
        to_target = self._change_to_coast(states, target, end, now)
        # After the last burn the craft stays on the closed ellipse around the hold point.
        n = self.task.mean_motion
        middle = carried(self.task.drift, states, 0.5 * self._period)
        offset = middle[:, :3] - goals
        around = np.stack(circling(n, Vec3(*offset.T)).columns(), axis=1)
        coasting = (begun > 0) & (begun <= coasts)
        change = np.where(coasting[:, None], to_target, around - middle[:, 3:])
        # Weaker where a component is too large, and zero before the first burn and where little is missing.
        largest = np.abs(change).max(axis=1, keepdims=True)
        most = self.task.braking * self._period
        change = change * np.minimum(1.0, most / np.maximum(largest, 1e-12))
        return np.where((begun[:, None] > 0) & (largest > _TRIM), change, 0.0)

    def _plan(self, start: np.ndarray, goal: np.ndarray, deadline: float) -> _Plans:
        """The cheapest plan from a state (6,) whose coasts are safe; else the cheapest of all that were drawn.

        The order of draws decides which plan is flown; recorded flights and published rows have it.
        """
        n, zone = self.task.mean_motion, self.task.keep_out
        coast = single_coasts(start[None], np.array([self._orbit]), np.array([0]))
        is_safe_start = least_distances(n, coast, 1) >= zone
        cheapest: list[_Plans] = []
        for draw in range(_DRAWS):
            random = np.random.default_rng(draw)
            sizes = _MORE_LEGS if draw else _LEGS
            plans = joined([self._sampled(random, *size, start, goal, deadline) for size in sizes])
            order = np.argsort(plans.price, kind="stable")
            cheapest.append(plans.rows(order[:1]))
            order = order[plans.price[order] < _IMPOSSIBLE]
            for begin in range(0, len(order), _CHECKED):
                some = plans.rows(order[begin : begin + _CHECKED])
                impulses = self._coasts_of_impulses(some, is_safe_start)
                kept = keep_away(n, impulses, len(some.price), zone)
                some = some.rows(np.flatnonzero(kept)[:_PREDICTED])
                if not len(some.price):
                    continue
                flown = self._coasts_of_flights(some, start, goal, is_safe_start)
                safe = np.flatnonzero(least_distances(n, flown, len(some.price)) > zone + _CLEAR)
                if len(safe):
                    return some.rows(safe[:1])
        drawn = joined(cheapest)
        return drawn.rows([np.argmin(drawn.price)])

    def _coasts_of_impulses(self, plans: _Plans, is_safe_start: np.ndarray) -> Pieces:
        """Coasts of K plans if burns are impulses, for an orbit after thrusters shut after any part of one.

        Where the coast from the start enters the ball, the first burn does not count.
        """
        counted = np.ones(plans.times.shape, bool)
        counted[:, 0] = is_safe_start
        who, burn = np.nonzero(counted)
        zero = np.zeros(len(who))
        midst = Pieces(
            plans.before[who, burn], plans.after[who, burn], zero + self._orbit, zero, who
        )
        who, burn = np.nonzero(np.isfinite(plans.times[:, 1:]))
        lasting = plans.times[who, burn + 1] - plans.times[who, burn]
        return joined([midst, single_coasts(plans.after[who, burn], lasting + self._orbit, who)])

    def _coasts_of_flights(
        self, plans: _Plans, start: np.ndarray, goal: np.ndarray, is_safe_start: np.ndarray
    ) -> Pieces:
        """Coasts of K plans as they are flown from a state (6,), with constant thrust in every control period."""
        n, period = self.task.mean_motion, self._period
        count = len(plans.price)
        goals = np.tile(goal, (count, 1))
        steps = math.ceil((plans.ends.max() + self.task.hold_seconds) / period)
        states = [np.tile(start, (count, 1))]
        changes = []
        for step in range(steps):
            changes.append(self._change_by_plans(plans, states[-1], goals, step * period))
            states.append(pushed(self.task.drift, states[-1], changes[-1] / period, period))
        return coasts_of_flights(
            n,
            np.array(states),
            np.array([change.any(axis=1) for change in changes]),
            np.full(count, steps),
            period,
            self._orbit,
            self.task.keep_out,
            np.repeat(is_safe_start, count),
        )

    def _sampled(
        self,
        random: np.random.Generator,
        legs: int,
        count: int,
        start: np.ndarray,
        goal: np.ndarray,
        deadline: float,
    ) -> _Plans:
        """Plans of a number of coasts from a state (6,) to a goal (3,), m, before a deadline, s.

        Times are drawn before points: both share one generator.
        """
        times = self._sampled_times(random, legs, count, deadline)
        points = _sampled_points(random, legs, count, start[:3], goal)
        drift = self.task.drift
        # Coasts between burns as impulses; the last burn leaves the craft at rest.
        before = np.tile([*goal, 0.0, 0.0, 0.0], (count, _MOST_LEGS + 1, 1))
        after = before.copy()
        state = carried(drift, np.tile(start, (count, 1)), times[:, 0])
        for j in range(legs):
            time = times[:, j + 1] - times[:, j]
            velocity = self._coast_velocity(state[:, :3], points[:, j], time)
            before[:, j] = state
            after[:, j] = np.concatenate([state[:, :3], velocity], axis=1)
            state = carried(drift, after[:, j], time)
        before[:, legs] = state
        after[:, legs, :3] = state[:, :3]
        burns = np.abs(after - before)[:, : legs + 1, 3:]
        # Burns must not overlap, and the first one must not begin before the start.
        periods = np.ceil(burns.max(axis=-1) / (self.task.braking * self._period) - 1e-6)
        lasting = np.maximum(periods, 1.0) * self._period
        gap = np.diff(times, axis=1) - 0.5 * (lasting[:, 1:] + lasting[:, :-1])
        overlap = (gap < self._period).any(axis=1)
        early = lasting[:, 0] > 2.0 * _FIRST_BURN * self._period + 2.0 * self._period
        price = burns.sum(axis=(1, 2)) + np.where(overlap | early, _IMPOSSIBLE, 0.0)
        # The first burn begins at once, the others half of their duration before their instants.
        begins = times - 0.5 * lasting
        begins[:, 0] = 0.0
        rest = _MOST_LEGS - legs
        never = ((0, 0), (0, rest))
        return _Plans(
            price,
            np.pad(times, never, constant_values=np.inf),
            np.pad(begins, never, constant_values=np.inf),
            np.pad(points, (*never, (0, 0))),
            before,
            after,
        )

    def _sampled_times(
        self, random: np.random.Generator, legs: int, count: int, deadline: float
    ) -> np.ndarray:
        """Instants (K, L + 1) of the burns, s, in the last of which a plan arrives before the deadline.

        Fractions are drawn before the total; published plans have this order.
        """
        fractions = np.maximum(random.dirichlet(np.full(legs, 1.5), count), _SHORTEST)
        fractions /= fractions.sum(axis=1, keepdims=True)
        first = _FIRST_BURN * self._period
        latest = deadline - 4.0 * self._period
        total = random.uniform(_EARLIEST, 1.0, (count, 1)) * (latest - first)
        if legs == 1:
            # A single coast has only its time to choose: evenly.
            total = np.linspace(_EARLIEST, 1.0, count)[:, None] * (latest - first)
        times = first + np.concatenate(
            [np.zeros((count, 1)), np.cumsum(fractions * total, axis=1)], axis=1
        )
        # Burns begin with control periods: their middles are multiples of half a period.
        return first + np.round((times - first) / self._period) * self._period

    @property
    def _orbit(self) -> float:
        """Length of an orbit, s."""
        return 2.0 * math.pi / self.task.mean_motion

    def _change_to_coast(
        self, states: np.ndarray, points: np.ndarray, ends: np.ndarray, now: float
    ) -> np.ndarray:
        """Change of velocity in W, (N, 3) m/s, with which coasts lead from states (N, 6) to points (N, 3) in time.

        A burn over this control period acts as an impulse in its middle.

        Args:
            states: states at the beginning of the period.
            points: where the coasts end, m.
            ends: when they end, (N,) s.
            now: beginning of the period, s.
        """
        half = 0.5 * self._period
        middle = carried(self.task.drift, states, half)
        left = np.maximum(ends - now - half, self._period)
        return self._coast_velocity(middle[:, :3], points, left) - middle[:, 3:]

    def _coast_velocity(self, p: np.ndarray, target: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Velocities (K, 3) with which coasts lead from positions (K, 3) to others in times (K,)."""
        v = velocity_to_reach(self.task.drift, Vec3(*p.T), Vec3(*target.T), time)
        return np.stack(v.columns(), axis=1)


def _sampled_points(
    random: np.random.Generator, legs: int, count: int, start: np.ndarray, goal: np.ndarray
) -> np.ndarray:
    """Ends (K, L, 3) of coasts, m: the last at the goal, that before in a box around it, others near the way.

    Coasts are drawn from the first to the last but one; published plans have this order.
    """
    points = np.tile(goal, (count, legs, 1))
    for j in range(legs - 1):
        if j == legs - 2:
            height, ahead, behind = _BEHIND
            box = random.uniform([-height, -behind, -height], [height, ahead, height], (count, 3))
            points[:, j] = goal + box
        else:
            on_the_way = goal + (start - goal) * random.uniform(0.2, 1.0, (count, 1))
            points[:, j] = on_the_way + random.uniform(-_AROUND, _AROUND, (count, 3))
    return points
