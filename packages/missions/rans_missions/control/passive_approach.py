"""Approach of a hold point that is passively safe: coasts keep out of the ball whenever the thrusters shut.

Plans are drawn with one seed, so that a start has the same plan in every batch; distances are in m in the Hill
frame.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from rans.extend import Vec3
from rans_missions.control.velocity_guidance import VelocityGuidance
from rans_missions.guidance.staying import circling
from rans_missions.orbits.reach import velocity_to_reach
from rans_missions.passive_safety import (
    Pieces,
    carried,
    coast_zone,
    joined,
    keep_away,
    least_distances,
    pieces_of_periods,
    pushed,
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


@dataclass
class _Plan:
    """Plan of one flight with L coasts."""

    times: np.ndarray
    """(L + 1,) instants of the burns, s: the middle of each."""
    begins: np.ndarray
    """(L + 1,) instants at which the burns begin, s."""
    points: np.ndarray
    """(L, 3) where each coast ends, m."""


class _Batch(NamedTuple):
    """K plans of one start with L coasts each."""

    price: np.ndarray
    """(K,) sum of the changes of velocity along the axes, m/s."""
    times: np.ndarray
    """(K, L + 1) instants of the burns, s."""
    points: np.ndarray
    """(K, L, 3) where each coast ends, m."""
    before: np.ndarray
    """(K, L + 1, 6) states before each burn."""
    after: np.ndarray
    """(K, L + 1, 6) states after each burn."""


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
    heeds_constraints: ClassVar[bool] = True
    mission = Hold
    purpose = "passive approach flies to hold points"
    _plans: Sequence[_Plan] = ()

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`; forgets plans."""
        super().reset(count)
        self._plans = ()

    def velocity_change(self, state: Any, goal: Any, now: float) -> tuple[np.ndarray, np.ndarray]:
        """Changes of velocity (N, 3), m/s, and which rows burn; see the base.

        All plans are made at the first call and stay in `_plans`. Craft that have arrived and drift to the edge of
        the tolerance come back.
        """
        states = motion_of(state)
        goals = np.stack(goal.p.columns(), axis=1)
        if not self._plans:
            deadlines = np.asarray(goal.notes.deadline)
            self._plans = [self._plan(*row) for row in zip(states, goals, deadlines, strict=True)]
        change = self._change_by_plans(self._plans, states, goals, now)
        staying = np.stack(self.task.staying(state, goal).columns(), axis=1)
        away = np.linalg.norm(states[:, :3] - goals, axis=1) > self.task.position_tolerance * _EDGE
        over = np.array([now > plan.times[-1] + _ARRIVED * self._period for plan in self._plans])
        change = np.where((over & away)[:, None], staying - states[:, 3:], change)
        burns: Any = change.any(axis=1)
        return change, burns

    def _change_by_plans(
        self, plans: Sequence[_Plan], states: np.ndarray, goals: np.ndarray, now: float
    ) -> np.ndarray:
        """(N, 3) change of velocity in W, m/s, that plans ask of this period; a burn acts in its middle.

        Burns keep their direction where a component exceeds what a period can give.
        """
        # Number of burns that have begun, of which the last one leads to the end of the present coast.
        begun = np.array([np.sum(now >= plan.begins - 1e-6) for plan in plans])
        coasts = np.array([len(plan.points) for plan in plans])
        present = np.clip(begun, 1, coasts) - 1
        target = np.stack([plan.points[k] for plan, k in zip(plans, present, strict=True)])
        end = np.array([plan.times[k + 1] for plan, k in zip(plans, present, strict=True)])
        to_target = self._change_to_coast(states, target, end, now)
        # After the last burn the craft stays on the closed ellipse around the hold point.
        n = self.task.mean_motion
        middle = carried(n, states, np.full(len(states), 0.5 * self._period))
        offset = middle[:, :3] - goals
        around = np.stack(circling(n, Vec3(*offset.T)).columns(), axis=1)
        coasting = (begun > 0) & (begun <= coasts)
        change = np.where(coasting[:, None], to_target, around - middle[:, 3:])
        # Weaker where a component is too large, and zero before the first burn and where little is missing.
        largest = np.abs(change).max(axis=1, keepdims=True)
        most = self.task.braking * self._period
        change = change * np.minimum(1.0, most / np.maximum(largest, 1e-12))
        return np.where((begun[:, None] > 0) & (largest > _TRIM), change, 0.0)

    def _plan(self, start: np.ndarray, goal: np.ndarray, deadline: float) -> _Plan:
        """The cheapest plan from a state (6,) whose coasts are safe; else the cheapest of all that were drawn.

        The order of draws decides which plan is flown; recorded flights and published rows have it.
        """
        is_unsafe_start = self._coast_distance(start) < self._radius
        cheapest, price = None, math.inf
        for draw in range(_DRAWS):
            batches = self._drawn(draw, start, goal, deadline)
            safe = self._safest(batches, start, goal, is_unsafe_start)
            if safe is not None:
                return safe
            for batch in batches:
                row = int(np.argmin(batch.price))
                if batch.price[row] < price:
                    cheapest, price = self._plan_of(batch, row), float(batch.price[row])
        assert cheapest is not None
        return cheapest

    def _drawn(
        self, draw: int, start: np.ndarray, goal: np.ndarray, deadline: float
    ) -> list[_Batch]:
        """Plans from a state (6,), of each number of coasts; other ones in every draw, the same for all starts."""
        random = np.random.default_rng(draw)
        sizes = _MORE_LEGS if draw else _LEGS
        return [self._sampled(random, legs, count, start, goal, deadline) for legs, count in sizes]

    def _safest(
        self, batches: list[_Batch], start: np.ndarray, goal: np.ndarray, is_unsafe_start: bool
    ) -> _Plan | None:
        """The cheapest plan of those drawn whose coasts are safe, as it is flown; None: there is none.

        Start and goal are rows (6,) and (3,), m and m/s.
        """
        # Plans have numbers across the batches, each of which has another number of coasts.
        batch_of = np.repeat(np.arange(len(batches)), [len(batch.price) for batch in batches])
        row_of = np.concatenate([np.arange(len(batch.price)) for batch in batches])

        def plans(numbers: np.ndarray) -> list[_Plan]:
            return [self._plan_of(batches[batch_of[i]], int(row_of[i])) for i in numbers]

        def safe_impulses(numbers: np.ndarray) -> np.ndarray:
            """Least distances (K,) (m) of coasts after impulses of the plans with these numbers.

            A quick look before they are flown.
            """
            pieces = []
            for k, batch in enumerate(batches):
                flight = np.flatnonzero(batch_of[numbers] == k)
                if len(flight):
                    rows = row_of[numbers[flight]]
                    pieces.extend(self._coasts_of_impulses(batch, rows, flight, is_unsafe_start))
            coasts = joined(pieces)
            return keep_away(self.task.mean_motion, coasts, len(numbers), self._radius)

        price = np.concatenate([batch.price for batch in batches])
        order = np.argsort(price, kind="stable")
        order = order[price[order] < _IMPOSSIBLE]
        for begin in range(0, len(order), _CHECKED):
            numbers = order[begin : begin + _CHECKED]
            some = plans(numbers[safe_impulses(numbers)][:_PREDICTED])
            if not some:
                continue
            distances = self._distance_of_flights(some, start, goal, is_unsafe_start)
            safe = np.flatnonzero(distances > self._radius + _CLEAR)
            if len(safe):
                return some[safe[0]]
        return None

    def _plan_of(self, batch: _Batch, row: int) -> _Plan:
        """One plan of a batch; its first burn begins at once, the others half of their duration earlier."""
        times = batch.times[row]
        begins = times - 0.5 * self._durations((batch.after[row] - batch.before[row])[:, 3:])
        begins[0] = 0.0
        return _Plan(times, begins, batch.points[row])

    def _coasts_of_impulses(
        self, batch: _Batch, rows: np.ndarray, flight: np.ndarray, is_unsafe_start: bool
    ) -> Iterator[Pieces]:
        """Families of coasts of plans if burns are impulses, for an orbit after thrusters shut.

        Args:
            batch: plans.
            rows: numbers (K,) of the plans in the batch.
            flight: numbers (K,) of their flights.
            is_unsafe_start: whether the coast from the start enters the ball; the first burn then does not count.
        """
        zero = np.zeros(len(rows))
        burns = batch.before.shape[1]
        for j in range(burns):
            before, after = batch.before[rows, j], batch.after[rows, j]
            if j > 0 or not is_unsafe_start:
                # Thrusters may shut after any part of a burn.
                yield Pieces(before, after, zero + self._orbit, zero, flight)
            if j + 1 < burns:
                lasting = self._orbit + batch.times[rows, j + 1] - batch.times[rows, j]
                yield single_coasts(after, lasting, flight)

    def _distance_of_flights(
        self, plans: list[_Plan], start: np.ndarray, goal: np.ndarray, is_unsafe_start: bool
    ) -> np.ndarray:
        """Distance (K,), m, that coasts of plans keep, with constant thrust in every control period.

        Where the coast from the start enters the zone itself, neither it nor coasts from within a burn in the first
        control period count.
        """
        n, period = self.task.mean_motion, self._period
        count = len(plans)
        goals = np.tile(goal, (count, 1))
        last = max(plan.times[-1] for plan in plans) + self.task.hold_seconds
        # Coasts since the last burn of each flight, and the instant at which they began.
        coasts = states = np.tile(start, (count, 1))
        since = np.zeros(count)
        pieces = []
        for step in range(math.ceil(last / period)):
            now = step * period
            change = self._change_by_plans(plans, states, goals, now)
            after = pushed(n, states, change / period, period)
            burn = np.flatnonzero(change.any(axis=1))
            if len(burn):
                if step or not is_unsafe_start:
                    # Thrusters may shut on the coast before this burn, and in the midst of it.
                    lasting = self._orbit + now - since[burn]
                    pieces.append(single_coasts(coasts[burn], lasting, burn))
                    family = pieces_of_periods(
                        n, states[burn], after[burn], period, self._orbit, self._radius, burn
                    )
                    pieces.append(family)
                since[burn] = now + period
                coasts = coasts.copy()
                coasts[burn] = after[burn]
            states = after
        pieces.append(single_coasts(coasts, self._orbit + last - since, np.arange(count)))
        return least_distances(n, joined(pieces), count)

    def _durations(self, burns: np.ndarray) -> np.ndarray:
        """Times (..., 1) that changes of velocity (..., 3) take, in whole control periods, s."""
        largest = np.abs(burns).max(axis=-1)
        periods = np.ceil(largest / (self.task.braking * self._period) - 1e-6)
        return np.maximum(periods, 1.0) * self._period

    def _sampled(
        self,
        random: np.random.Generator,
        legs: int,
        count: int,
        start: np.ndarray,
        goal: np.ndarray,
        deadline: float,
    ) -> _Batch:
        """Plans of a number of coasts from a state (6,) to a goal (3,), m, before a deadline, s.

        Times are drawn before points: both share one generator.
        """
        times = self._sampled_times(random, legs, count, deadline)
        points = _sampled_points(random, legs, count, start[:3], goal)
        n = self.task.mean_motion
        # Coasts between burns as impulses, and their price.
        state = carried(n, np.tile(start, (count, 1)), times[:, 0])
        price = np.zeros(count)
        before, after = [], []
        for j in range(legs):
            time = times[:, j + 1] - times[:, j]
            before.append(state)
            velocity = self._coast_velocity(state[:, :3], points[:, j], time)
            after.append(np.concatenate([state[:, :3], velocity], axis=1))
            price += np.abs(after[-1] - before[-1])[:, 3:].sum(axis=1)
            state = carried(n, after[-1], time)
        # The last burn leaves the craft at rest.
        before.append(state)
        after.append(np.concatenate([state[:, :3], np.zeros((count, 3))], axis=1))
        price += np.abs(state[:, 3:]).sum(axis=1)
        befores, afters = np.stack(before, axis=1), np.stack(after, axis=1)
        # Burns must not overlap, and the first one must not begin before the start.
        lasting = self._durations((afters - befores)[:, :, 3:])
        gap = np.diff(times, axis=1) - 0.5 * (lasting[:, 1:] + lasting[:, :-1])
        overlap = (gap < self._period).any(axis=1)
        early = lasting[:, 0] > 2.0 * _FIRST_BURN * self._period + 2.0 * self._period
        price = np.where(overlap | early, price + _IMPOSSIBLE, price)
        return _Batch(price, times, points, befores, afters)

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
    def _radius(self) -> float:
        """Radius of the zone, m."""
        zone = coast_zone(self.task)
        assert zone is not None
        return zone.radius

    @property
    def _orbit(self) -> float:
        """Length of an orbit, s."""
        return 2.0 * math.pi / self.task.mean_motion

    def _coast_distance(self, start: np.ndarray) -> float:
        """Distance that the coast of an orbit from a state (6,) keeps, m."""
        coast = single_coasts(start[None], np.array([self._orbit]), np.array([0]))
        return float(least_distances(self.task.mean_motion, coast, 1)[0])

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
        middle = carried(self.task.mean_motion, states, np.full(len(states), half))
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
