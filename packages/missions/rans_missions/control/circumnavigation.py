"""Guidance of inspections: the cheapest flight that a search from natural circumnavigations finds.

Every start has a row in `_plans` and `_searched`; times are since the start of the episode, s, and positions in the
Hill frame, m.
"""

from __future__ import annotations

import itertools
import math
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rans.extend import Conditions, Spacecraft, Task, Timing, Vec2, Vec3, bounds, map_leaves
from rans.randomization.conditions import largest
from rans_missions.control.navigation_filter import NavigationFilter
from rans_missions.control.passively_safe import PassivelySafeGuidance
from rans_missions.control.velocity_guidance import closed_ellipse
from rans_missions.convex.inspecting import InspectionSearch
from rans_missions.orbits.reach import velocity_to_reach
from rans_missions.passive_safety import (
    PRECISION,
    Pieces,
    carried,
    joined,
    keep_away,
    single_coasts,
)
from rans_missions.tasks.inspect import Inspect
from rans_missions.vectors import motion_of

_WAITS = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5)
"""Times until the first burn, as shares of an orbit."""
_TRANSFERS = (0.04, 0.08, 0.12, 0.16, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.55, 0.65, 0.75)
"""Times between the burns, as shares of an orbit; at a whole orbit a transfer has no solution."""
_PHASES = (-0.6, -0.4, -0.2, 0.0, 0.2, 0.4, 0.6)
"""Phases of the craft on its orbit ahead of the sun, rad: from there half of what it sees is in light."""
_CLEAR = 3.0
"""Least distance from the keep-out ball and from the end of the zone in a plan, m, for errors of flying it."""
_WIDTHS = (0.0, 3.0, 7.0, 12.0, 18.0, 27.0)
"""Half widths of the orbit beyond the least one, m."""
_COASTS_CLEAR = 1.0
"""Least distance from the keep-out ball of coasts after thrusters shut, m, in a plan whose coasts are safe: flown
burns differ from impulses, by less than a metre in an orbit."""
_STEP = 60.0
"""Time between the instants at which a plan is judged, s; a craft goes 6 degrees around the target in it."""
_TOGETHER = 16
"""Number of plans that are judged at once, the cheapest first."""
_TRIM = 0.001
"""Error of velocity that is left alone, m/s: an orbit whose speed is off by it drifts by 18 m a turn."""
_DOUBT = 3.0
"""Standard deviations of an estimated velocity that are left alone."""
_DETOURS = 400
"""Number of changes of velocity at the start that are drawn where no plan of two burns is safe."""
_DEAR = 1.3
"""Price of a safe plan, in that of the cheapest unsafe one, beyond which a plan with a detour is searched."""
_DETOUR_SPEEDS = (0.005, 0.3)
"""Least and largest of them, m/s: on a coast that misses the ball by 100 m the last turns it by a right angle."""
_DETOURS_TOGETHER = 256
"""Number of plans with detours whose coasts are computed at once, the cheapest first."""
_MOST_DETOURS = 200 * _DETOURS_TOGETHER
"""Largest number of plans with detours that are tried."""
_BEGINNINGS = 5
"""Number of plans around the target from which a cheaper flight is searched, beside the flight without a burn."""
_HOPS = 8
"""Number of times that the search begins again: 30 lower the mean price of 12 starts by 2 %."""
_THOROUGH = 30, 150
"""Both numbers of a thorough search, which takes some ten seconds a start."""
_APART = 1000.0
"""Difference of the times of burns, s, by which plans that begin a search differ; or they differ by a radian."""
_ABOVE, _ABOVE_IN_DOUBT = 0.05, 1.0
"""Height above the horizon of a point from which it counts as seen in a search, m: for rounding, and for errors."""
_BESIDE = 0.2
"""Distance from the keep-out ball that a searched flight keeps, m, if nothing is in error."""
_BACK = 600.0
"""Time in which a craft returns to a searched flight, s: a tenth of an orbit, nearly straight."""
_AFTER = 10
"""Control periods after the second burn for which the flight of a plan is predicted."""
_LISTENING = 10
"""Control periods of noisy readings that are filtered before the first plan."""


@dataclass
class _Plans:
    """Plans of N flights: arrays (N,)."""

    first: np.ndarray
    """Time of the first burn, s."""
    second: np.ndarray
    """Time of the second burn, s."""
    x: np.ndarray
    y: np.ndarray
    """Where the second burn is, m."""
    finish: np.ndarray
    """Time at which enough has been seen, s."""
    detours: np.ndarray
    """Whether a burn at once leads to where the first burn is."""
    via_x: np.ndarray
    via_y: np.ndarray
    via_z: np.ndarray
    """Where that is, m."""


@dataclass
class _Searched:
    """Searched flights of N craft."""

    flying: np.ndarray
    """Whether the craft flies one, (N,)."""
    changes: np.ndarray
    """Changes of velocity in W of all control periods still to come, (N, periods, 3) m/s."""
    middle: np.ndarray
    """State expected in the middle of this control period before its burn, (N, 6)."""


class Circumnavigation(PassivelySafeGuidance[Inspect]):
    """Inspects a target for little impulse, and then stays on a closed orbit around it.

    >>> rans.Circumnavigation("afrl-deputy", "inspect")
    <circumnavigation: Inspect for afrl-deputy>

    An ellipse around the target in the orbit's plane, twice as long as wide, on which v = (n y / 2, -2 n x), is a
    natural motion: it needs no thrust, and turns in the Hill frame once an orbit, as the sun does. A craft that is
    near the sun's direction on it sees the lit side of the target all the time. A plan has a time for a first burn,
    a time for the second one onto the ellipse, its width, and the phase ahead of the sun. All of a fixed grid are
    priced in closed form. The motion across the plane is left alone.

    The cheapest of these plans begin a search for a cheaper flight, by linear programs over burns in any direction
    (`rans_missions.convex.inspecting`), about a second of a core. Where it finds none, with safe coasts, and where
    points are visible from less than their horizon, the craft flies the cheapest of the plans that sees enough in
    time and keeps clear of the ball and of the end of the zone, by prediction.

    Errors of more than 1 mm/s are corrected on the way. If a plan has ended and too little was seen, the next one
    is made. Once enough has been seen, the craft goes onto a closed ellipse, and stays there without thrust,
    outside of the ball. With known errors of its sensors it estimates position and velocity by a Kalman filter,
    and begins to plan after ten periods.

    Source of the motion: W. H. Clohessy and R. S. Wiltshire, "Terminal guidance system for satellite rendezvous",
    Journal of the Aerospace Sciences 27(9), 1960.

    Args:
        craft: by name, TOML file or as such.
        task: an `rans_missions.tasks.inspect.Inspect`, or its name.
        timing: control period, and length of the episode; None: the task's.
        safe_coasts: whether plans are passively safe: if all thrusters shut at any instant, also in the midst of a
            burn, the coast of the next orbit does not enter the keep-out ball. Where no plan is, one more burn at
            once is drawn at random, in any direction; without a safe plan an unsafe one is flown.
        within: time within which the inspection should end, s, None: the length of the episode. Shorter
            times need more impulse; without a plan in time, the plan that sees the most is flown.

    Raises:
        ConfigError: the task is no inspection.
    """

    name = "circumnavigation"
    slow: ClassVar[bool] = True
    heeds_constraints: ClassVar[bool] = True
    mission = Inspect
    purpose = "circumnavigation flies inspections"

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None = None,
        within: float | None = None,
        safe_coasts: bool = False,
    ) -> None:
        super().__init__(craft, task, timing)
        length = self._period * self._timing.episode_steps
        self._within = length if within is None else within
        self._safe_coasts = safe_coasts
        self._filter: NavigationFilter | None = None
        self._plans: _Plans | None = None
        self._searched: _Searched | None = None
        self._effort = _BEGINNINGS, _HOPS
        # What the search sees is what is above its horizon.
        self._searches = not safe_coasts and self.task.view_degrees == 90.0

    @classmethod
    def thorough(cls, craft: Spacecraft, task: Task, timing: Timing) -> Circumnavigation:
        """Guidance whose search takes ten times as long, for flights that are to be the cheapest known."""
        result = cls(craft, task, timing)
        result._effort = _THOROUGH
        return result

    def expecting(self, conditions: Conditions | None) -> Circumnavigation:
        """Copy of this guidance that expects the errors of these conditions; None: a perfect world."""
        result = copy(self)
        result._filter = None
        if conditions is not None:
            position = conditions.sensors.position
            velocity = conditions.sensors.velocity
            noise = largest(position.noise), largest(velocity.noise)
            weakest, strongest = bounds(conditions.thrusters.thrust)
            # The standard deviation of a uniform distribution, and that of every period.
            inexact = math.hypot(
                (strongest - weakest) / math.sqrt(12.0), largest(conditions.thrusters.noise)
            )
            if max(*noise, inexact) > 0.0:
                result._filter = NavigationFilter(self.task.drift, 3, self._period, *noise, inexact)
        result.reset(0)
        return result

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`; forgets plans and estimates."""
        super().reset(count)
        self._plans = None
        self._searched = None
        if self._filter is not None:
            self._filter.reset()

    def velocity_change(self, state: Any, goal: Any, now: float) -> tuple[np.ndarray, np.ndarray]:
        """Changes of velocity (N, 3), m/s, and which rows burn; see the base.

        What errors of the estimate explain is left alone. Plans when it first sees a start, and again where a plan
        is over and too little is inspected; `_plans` and `_searched` remember.
        """
        size = len(state.p.x)
        # Estimate, with standard deviations of position and velocity; noisy readings are filtered for a while.
        listens = False
        position_deviation: Any = 0.0
        velocity_deviation: Any = 0.0
        if self._filter is not None:
            state, position_deviation, velocity_deviation = self._estimated(self._filter, state)
            listens = now < _LISTENING * self._period
        if self._plans is None:
            unplanned, nothing = np.full(size, -1.0), np.zeros(size)
            # Each array is one of its own, since plans are set row by row.
            self._plans = _Plans(
                first=unplanned,
                second=unplanned.copy(),
                x=unplanned.copy(),
                y=unplanned.copy(),
                finish=unplanned.copy(),
                detours=np.zeros(size, bool),
                via_x=nothing,
                via_y=nothing.copy(),
                via_z=nothing.copy(),
            )
            self._searched = _Searched(
                flying=np.zeros(size, bool),
                changes=np.zeros((size, math.ceil(self._within / self._period) + 1, 3)),
                middle=np.zeros((size, 6)),
            )
        assert self._searched is not None

        # Plan where no plan has been made, and where one has ended too soon; stay where enough has been seen.
        enough = self.task.unseen(goal) < self.task.unseen_tolerance
        over = (now > self._plans.finish) & ~enough
        for row in np.flatnonzero(over & (not listens)):
            if not self._search(int(row), state, goal, now):
                self._plan(int(row), state, goal, now)
        for row in np.flatnonzero(enough & self._searched.flying):
            self._plan(int(row), state, goal, now, stays=True)

        # Burn where more is missing than errors of the estimate explain. An error of the position is one of the
        # velocity to the second burn; on the closed ellipse it is one of its speed, 2 n x.
        change = self._change_by_plan(state, now, self._plans)
        left = np.maximum(self._plans.second - now, self._period)
        by_position = np.where(
            self._plans.second > now,
            position_deviation / left,
            2.0 * self.task.mean_motion * position_deviation,
        )
        least = np.maximum(_TRIM, _DOUBT * np.hypot(velocity_deviation, by_position))
        burns = (np.linalg.norm(change, axis=0) > least) & (not listens)
        change = np.where(burns, change, 0.0)
        flying = self._searched.flying
        if flying.any():
            errors = np.hypot(velocity_deviation, position_deviation / _BACK)
            searched = self._change_by_search(state, self._searched, errors)
            change = np.where(flying, searched, change)
            burns = np.where(flying, searched.any(axis=0), burns)
        change = change.T
        if self._filter is not None:
            self._filter.burn(change)
        return change, burns

    def _change_by_search(self, state: Any, searched: _Searched, errors: Any) -> np.ndarray:
        """(3, N) change of velocity in W, m/s, of craft that fly what a search has found; the next period follows.

        Args:
            state: states of arrays (N,).
            searched: what they fly.
            errors: standard deviation of the change of velocity that returns to it, m/s.
        """
        p, v = self.task.drift.carry(state.p, state.v, 0.5 * self._period)
        planned = searched.changes[:, 0]
        expected = searched.middle
        away = motion_of(replace(state, p=p, v=v)).T - expected.T
        back = velocity_to_reach(self.task.drift, Vec3(*away[:3]), Vec3(0.0, 0.0, 0.0), _BACK)
        missing = np.array(back.columns()) - away[3:]
        corrects = np.linalg.norm(missing, axis=0) > np.maximum(_TRIM, _DOUBT * errors)
        searched.changes = np.roll(searched.changes, -1, axis=1)
        searched.changes[:, -1] = 0.0
        burnt = expected + np.pad(planned, ((0, 0), (3, 0)))
        after = np.full(len(burnt), self._period)
        searched.middle = carried(self.task.mean_motion, burnt, after)
        return planned.T + np.where(corrects, missing, 0.0)

    def _search(self, row: int, state: Any, goal: Any, now: float) -> bool:
        """Set the cheapest flight that a search finds as the plan of one craft; whether it has found one.

        It replaces the row's entries of `_plans` and `_searched`; where it finds none, the row no longer flies a
        searched one.
        """
        assert self._plans is not None
        assert self._searched is not None
        self._searched.flying[row] = False
        left = self._within - now
        if not self._searches or left <= self._period:
            return False
        state_now, target_now = map_leaves(lambda x: float(x[row]), (state, goal))
        start = motion_of(state_now)
        perfect = self._filter is None
        search = InspectionSearch(
            self.task,
            self._timing,
            start,
            target_now.notes.sun,
            self._inspected(target_now),
            left,
            self._most,
            _ABOVE if perfect else _ABOVE_IN_DOUBT,
            _BESIDE if perfect else _CLEAR,
        )
        burns = search.best(self._beginnings(search, state_now, target_now, left), self._effort[1])
        if burns is None:
            return False
        self._plans.finish[row] = now + burns.finish
        self._searched.flying[row] = True
        self._searched.changes[row] = 0.0
        self._searched.changes[row, burns.periods] = burns.changes
        half = np.array([0.5 * self._period])
        self._searched.middle[row] = carried(self.task.mean_motion, start[None], half)[0]
        return True

    def _beginnings(
        self, search: InspectionSearch, state_now: Any, target_now: Any, left: float
    ) -> list[np.ndarray]:
        """Paths (T, 3), m, from which a search begins.

        That without a burn, and those of cheap plans that differ.
        """
        first, second, target, price = self._priced(state_now, target_now)
        paths = [search.path([], np.zeros((0, 3)))]
        chosen: set[tuple[int, int, int]] = set()
        for k in np.argsort(price, kind="stable"):
            begun, ended = float(first[k]), float(second[k])
            phase = math.atan2(target[1, k], target[0, k])
            kind = round(begun / _APART), round(ended / _APART), round(phase)
            if ended >= left or kind in chosen:
                continue
            chosen.add(kind)
            p, v = self.task.drift.carry(state_now.p, state_now.v, begun)
            begin = velocity_to_reach(
                self.task.drift, Vec2(p.x, p.y), Vec2(*target[:, k]), ended - begun
            )
            _, arrival = self.task.drift.carry(Vec2(p.x, p.y), begin, ended - begun)
            around = closed_ellipse(self.task.mean_motion, *target[:, k])
            changes = np.array(
                [
                    [begin.x - v.x, begin.y - v.y, 0.0],
                    [around[0] - arrival.x, around[1] - arrival.y, 0.0],
                ]
            )
            paths.append(search.path([x / self._period - 0.5 for x in (begun, ended)], changes))
            if len(chosen) == self._effort[0]:
                break
        return paths

    def _inspected(self, target_now: Any) -> np.ndarray:
        """Which points the goal of one flight has as seen, (points,)."""
        return np.array([bool(x) for word in self.task._known(target_now) for x in word])

    def _estimated(self, navigation: NavigationFilter, state: Any) -> tuple[Any, Any, Any]:
        """Estimated state after a reading, and standard deviations (N,) of a component of position and velocity."""
        reading = motion_of(state)
        mean, covariance = navigation.read(reading)
        variance = np.diagonal(covariance, axis1=1, axis2=2)
        deviations = np.sqrt(variance[:, :3].max(axis=1)), np.sqrt(variance[:, 3:].max(axis=1))
        return replace(state, p=Vec3(*mean[:, :3].T), v=Vec3(*mean[:, 3:].T)), *deviations

    def _change_by_plan(self, state: Any, now: float, plans: _Plans) -> np.ndarray:
        """(3, N) change of velocity in W, m/s, that this period's burn is to give.

        A burn over a period acts as an impulse in its middle.
        """
        half = 0.5 * self._period
        in_space, speed = self.task.drift.carry(state.p, state.v, half)
        p, v = Vec2(in_space.x, in_space.y), Vec2(speed.x, speed.y)
        left = plans.second - now
        transfer = left > half
        time = np.where(transfer, left, self._period)
        to_reach = velocity_to_reach(self.task.drift, p, Vec2(plans.x, plans.y), time)
        waits = now < plans.first - half
        around = closed_ellipse(self.task.mean_motion, p.x, p.y)
        x = np.where(transfer, to_reach.x, around[0]) - v.x
        y = np.where(transfer, to_reach.y, around[1]) - v.y
        change = np.where(waits, 0.0, np.array([x, y, 0.0 * x]))
        # On a detour the craft aims at the point of the first burn, but for the last periods before it.
        until = plans.first - now - half
        detours = plans.detours & (until > 2.0 * self._period)
        via = Vec3(plans.via_x, plans.via_y, plans.via_z)
        time = np.where(detours, until, self._period)
        aimed = velocity_to_reach(self.task.drift, in_space, via, time) - speed
        return np.where(detours, np.array(aimed.columns()), change)

    def _plan(self, row: int, state: Any, goal: Any, now: float, stays: bool = False) -> None:
        """Set the plan around the target of one flight.

        Args:
            row: number of the flight.
            state: states of arrays (N,).
            goal: goals of arrays (N,).
            now: time, s.
            stays: whether enough has been seen, and the craft only goes to stay.
        """
        assert self._plans is not None
        assert self._searched is not None
        self._searched.flying[row] = False
        state_now, target_now = map_leaves(lambda x: float(x[row]), (state, goal))
        left = self._within - now
        if left <= 0.0:
            left = self._within
        if stays:
            left = 2.0 * self._orbit
        first, second, target, price = self._priced(state_now, target_now)
        order = np.argsort(price, kind="stable")
        order = order[second[order] < left]
        most_points = -1
        best = 0
        end = now + left
        is_enough = False
        unsafe_price = math.inf
        """Price of the cheapest plan that sees enough, safe or not, m/s."""
        for begin in range(0, len(order), _TOGETHER):
            some = order[begin : begin + _TOGETHER]
            inspected, finish = self._judged(
                state_now, target_now, first[some], second[some], target[:, some], left, stays
            )
            if self._safe_coasts and np.isfinite(finish).any():
                unsafe_price = min(unsafe_price, float(price[some[np.isfinite(finish)][0]]))
                safe = self._coasts_safely(
                    state_now, now, first[some], second[some], target[:, some]
                )
                safe &= np.isfinite(finish)
                safe[safe] = self._flown_safely(
                    state_now, now, first[some[safe]], second[some[safe]], target[:, some[safe]]
                )
                inspected, finish = np.where(safe, inspected, -1), np.where(safe, finish, math.inf)
            # The cheapest that sees enough, or else the one that sees the most.
            k = int(np.argmax(np.where(np.isfinite(finish), math.inf, inspected)))
            if inspected[k] > most_points:
                most_points = inspected[k]
                best = some[k]
                end = now + min(finish[k], left)
            is_enough = bool(np.isfinite(finish[k]))
            if is_enough:
                break
        if self._safe_coasts:
            safe_price = float(price[best]) if is_enough else math.inf
            is_dear = not is_enough or safe_price > _DEAR * unsafe_price
            if is_dear and self._plan_detour(row, state_now, target_now, now, left, safe_price):
                return
        if most_points < 0:
            # Nothing keeps clear: the closed orbit through this position.
            self._set(row, now, now, state_now.p.x, state_now.p.y, now + left)
            return
        x, y = map(float, target[:, best])
        self._set(row, now + first[best], now + second[best], x, y, end)

    def _plan_detour(
        self, row: int, state_now: Any, target_now: Any, now: float, left: float, dearest: float
    ) -> bool:
        """Set the cheapest plan of one flight that begins with a burn at once and is safe.

        Burns are the same ones in every call, with a seed of their own: direction first, then size.

        Returns:
            Whether there is one that costs less than a price, m/s; else nothing is set.
        """
        n, half = self.task.mean_motion, 0.5 * self._period
        start = motion_of(state_now)
        # Changes of velocity in the middle of this period, and coasts through it afterwards, as states of now.
        random = np.random.default_rng(0)
        direction = random.normal(size=(_DETOURS, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        least, largest_speed = map(math.log, _DETOUR_SPEEDS)
        size = np.exp(random.uniform(least, largest_speed, (_DETOURS, 1)))
        burn = np.concatenate([np.zeros((_DETOURS, 3)), direction * size], axis=1)
        middle = carried(n, start[None], np.array([half])) + burn
        states = carried(n, middle, np.full(_DETOURS, -half))
        # Those whose coasts are safe after any part of the burn.
        every = np.arange(_DETOURS)
        before = np.tile(start, (_DETOURS, 1))
        if now == 0.0 and self._coast_distance(start) < self.task.keep_out:
            before = states
        time = np.full(_DETOURS, self._orbit + self._period)
        coasts = Pieces(before, states, time, np.zeros(_DETOURS), every)
        safe = keep_away(n, coasts, _DETOURS, self._clear_of(start))
        states, burn = states[safe], np.abs(burn[safe]).sum(axis=1)

        # Prices of all plans from there; the detour must last some periods.
        priced = [self._priced(_moved(state_now, state), target_now) for state in states]
        if not priced:
            return False
        first, second, target, _ = priced[0]
        price = np.array([paid for *_, paid in priced]) + burn[:, None]
        fits = (second < left) & (first > 4.0 * self._period)
        which, plan = np.nonzero(fits & (price < dearest))
        order = np.argsort(price[which, plan], kind="stable")[:_MOST_DETOURS]
        for some in np.split(order, range(_DETOURS_TOGETHER, len(order), _DETOURS_TOGETHER)):
            k, j = which[some], plan[some]
            safe = self._coasts_safely(
                _moved(state_now, states[k]), math.inf, first[j], second[j], target[:, j]
            )
            k, j = k[safe], j[safe]
            if not len(k):
                continue
            begun = _moved(state_now, states[k])
            _, finish = self._judged(begun, target_now, first[j], second[j], target[:, j], left)
            enough = np.isfinite(finish)
            k, j, finish = k[enough], j[enough], finish[enough]
            if not len(k):
                continue
            via = carried(n, states[k], first[j])[:, :3]
            flown = self._flown_safely(state_now, now, first[j], second[j], target[:, j], via)
            if flown.any():
                chosen = int(np.argmax(flown))
                i = j[chosen]
                x, y = map(float, target[:, i])
                end = now + float(finish[chosen])
                begin, arrival = now + float(first[i]), now + float(second[i])
                self._set(row, begin, arrival, x, y, end, via[chosen])
                return True
        return False

    def _set(
        self,
        row: int,
        first: float,
        second: float,
        x: float,
        y: float,
        finish: float,
        via: np.ndarray | None = None,
    ) -> None:
        """Write the plan of one craft into `_plans`.

        Instants of both burns (s), where it passes (x, y and via, m), and its end (s).
        """
        assert self._plans is not None
        self._plans.detours[row] = via is not None
        if via is not None:
            self._plans.via_x[row], self._plans.via_y[row], self._plans.via_z[row] = via
        self._plans.first[row] = first
        self._plans.second[row] = second
        self._plans.x[row] = x
        self._plans.y[row] = y
        self._plans.finish[row] = finish

    def _priced(
        self, state_now: Any, target_now: Any
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Times of both burns (K,), position of the second (2, K), and velocity change (K,) of all plans.

        For one craft; plans are in the order of the product of waits, transfers, phases and widths.
        """
        n = self.task.mean_motion
        orbit = self._orbit
        least = self.task.keep_out + _CLEAR
        grid = np.array(list(itertools.product(_WAITS, _TRANSFERS, _PHASES, _WIDTHS))).T
        # Burns are in the middle of control periods.
        period = self._period
        first = np.round(grid[0] * orbit / period) * period + 0.5 * period
        second = first + np.maximum(np.round(grid[1] * orbit / period), 1.0) * period
        phase = target_now.notes.sun - n * second + grid[2]
        width = least + grid[3]
        target = np.array([width * np.cos(phase), 2.0 * width * np.sin(phase)])
        p, v = self.task.drift.carry(state_now.p, state_now.v, first)
        p, v = Vec2(p.x, p.y), Vec2(v.x, v.y)
        begin = velocity_to_reach(self.task.drift, p, Vec2(target[0], target[1]), second - first)
        _, arrival = self.task.drift.carry(p, begin, second - first)
        around = closed_ellipse(n, *target)
        changes = (begin.x - v.x, begin.y - v.y, around[0] - arrival.x, around[1] - arrival.y)
        return first, second, target, np.sum(np.abs(changes), axis=0)

    def _judged(
        self,
        state_now: Any,
        target_now: Any,
        first: np.ndarray,
        second: np.ndarray,
        target: np.ndarray,
        left: float,
        stays: bool = False,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Number of points (K,) that plans see, -1 if one comes too near, and when it is enough, s, else inf.

        With `stays` it must not come too near later either.
        """
        task = self.task
        n = task.mean_motion
        times = np.arange(0.0, left + 1e-9, _STEP)[:, None]
        # The path in three parts: coast to the first burn, transfer to the second, closed ellipse about
        # the target after it.
        before = self._coasted(state_now.p, state_now.v, times)
        at_first = task.drift.carry(state_now.p, state_now.v, first)
        begin = velocity_to_reach(
            task.drift,
            Vec2(at_first[0].x, at_first[0].y),
            Vec2(target[0], target[1]),
            second - first,
        )
        transfer = self._coasted(at_first[0], Vec3(begin.x, begin.y, at_first[1].z), times - first)
        z = task.drift.carry(state_now.p, state_now.v, second)
        closed = self._coasted(
            Vec3(target[0], target[1], z[0].z),
            Vec3(*closed_ellipse(n, *target), z[1].z),
            times - second,
        )
        p = Vec3(
            *(
                np.where(times < first, a, np.where(times < second, b, c))
                for a, b, c in zip(
                    before.columns(), transfer.columns(), closed.columns(), strict=True
                )
            )
        )
        # Clear of the ball and of the outer limit, with a margin, until the inspection is done or for good.
        clear = _nearest(p) > task.keep_out + 0.9 * _CLEAR
        clear &= p.norm() < task.fail_distance - _CLEAR
        # Points inspected so far at each time; the sun turns backwards in the Hill frame.
        notes = replace(target_now.notes, sun=target_now.notes.sun - n * times)
        coasting = replace(state_now, p=p)
        inspected = np.array(task.visible(replace(target_now, notes=notes), coasting))
        inspected_before = self._inspected(target_now)
        inspected = np.logical_or.accumulate(inspected, axis=1) | inspected_before[:, None, None]
        count = inspected.sum(axis=0)
        enough = 1.0 - count / task.points < task.unseen_tolerance - 1e-9
        finish = np.where(enough.any(axis=0), times[np.argmax(enough, axis=0), 0], math.inf)
        safe = (clear | ((times > finish) & (not stays))).all(axis=0)
        return np.where(safe, count[-1], -1), np.where(safe, finish, math.inf)

    def _coasts_safely(
        self, state_now: Any, now: float, first: np.ndarray, second: np.ndarray, target: np.ndarray
    ) -> np.ndarray:
        """Whether the coasts of plans (K,) stay outside the ball for an orbit, whenever the thrusters shut.

        They begin at one state, or each at its own of K.
        A coast from the start of the flight that enters the ball is left as it is by no plan, only by a burn in
        the first control period.
        """
        n = self.task.mean_motion
        orbit = self._orbit
        count = len(first)
        waits = first > self._period
        columns = (*state_now.p.columns(), *state_now.v.columns())
        start = np.stack([np.broadcast_to(x, count) for x in columns], axis=1)
        at_first = carried(n, start, first)
        begin = velocity_to_reach(
            self.task.drift, Vec2(*at_first[:, :2].T), Vec2(*target), second - first
        )
        transfer = at_first.copy()
        transfer[:, 3:5] = np.stack([begin.x, begin.y], axis=1)
        at_second = carried(n, transfer, second - first)
        closed = at_second.copy()
        closed[:, 3:5] = np.stack(closed_ellipse(n, *target), axis=1)
        every = np.arange(count)
        nothing = np.zeros(count)
        # Burns give any part of a velocity change: coasts between those before and after it.
        pieces = [
            single_coasts(start[waits], orbit + first[waits], every[waits]),
            Pieces(transfer, transfer, orbit + second - first, nothing, every),
            Pieces(at_second, closed, nothing + orbit, nothing, every),
        ]
        if now > 0.0 or self._coast_distance(start[0]) >= self.task.keep_out:
            pieces.append(Pieces(at_first, transfer, nothing + orbit, nothing, every))
        return keep_away(n, joined(pieces), count, self._clear_of(start[0]))

    def _clear_of(self, start: np.ndarray) -> float:
        """Distance from the target, m, that coasts of plans from a state (6,) keep if burns are impulses."""
        # A safe start whose own coast is nearer than the clearance asks for no more than it has itself.
        distance = self._coast_distance(start) - 2.0 * PRECISION
        usual = self.task.keep_out + _COASTS_CLEAR
        return distance if self._is_safe(distance) and distance < usual else usual

    def _flown_safely(
        self,
        state_now: Any,
        now: float,
        first: np.ndarray,
        second: np.ndarray,
        target: np.ndarray,
        via: np.ndarray | None = None,
    ) -> np.ndarray:
        """Whether coasts of plans (K,) stay outside the ball with burns as they are flown; see `_coasts_safely`.

        Args:
            state_now: state at which all begin.
            now: its time, s.
            first: times of the first burns from then on, s.
            second: those of the second burns.
            target: (2, K) where the second burns are, m.
            via: (K, 3) where the first burns are if another one leads there, m.
        """
        count = len(first)
        if not count:
            return np.zeros(0, bool)
        start = motion_of(state_now)
        where = np.zeros((count, 3)) if via is None else via
        plans = _Plans(
            first=first,
            second=second,
            x=target[0],
            y=target[1],
            finish=np.zeros(count),
            detours=np.full(count, via is not None),
            via_x=where[:, 0],
            via_y=where[:, 1],
            via_z=where[:, 2],
        )

        def law(states: np.ndarray, time: float) -> np.ndarray:
            change = self._change_by_plan(_moved(state_now, states), time, plans).T
            return np.where(np.linalg.norm(change, axis=1, keepdims=True) > _TRIM, change, 0.0)

        # As far as the last burn and an orbit beyond it, by the law that flies.
        last = float(second.max()) + _AFTER * self._period
        is_unsafe_start = now == 0.0 and self._coast_distance(start) < self.task.keep_out
        distance = self._predicted_distance(
            np.tile(start, (count, 1)),
            law,
            math.ceil(last / self._period),
            self._orbit + last,
            is_unsafe_start,
        )
        return self._is_safe(distance)

    def _coasted(self, p: Any, v: Any, times: np.ndarray) -> Vec3:
        positions, _ = self.task.drift.carry(p, v, times)
        shape = np.broadcast_shapes(*(np.shape(x) for x in positions.columns()))
        return Vec3(*(np.broadcast_to(x, shape) for x in positions.columns()))


def _moved(state: Any, states: np.ndarray) -> Any:
    """A state with the positions and velocities of states (6,) or (K, 6)."""
    return replace(state, p=Vec3(*states.T[:3]), v=Vec3(*states.T[3:]))


def _nearest(p: Vec3) -> np.ndarray:
    """Least distance (T, K) from the origin on the line from every instant to the next one, m."""
    points = np.array(p.columns())
    steps = np.diff(points, axis=1, append=points[:, -1:])
    fraction = -(points * steps).sum(axis=0) / np.maximum((steps * steps).sum(axis=0), 1e-12)
    return np.linalg.norm(points + steps * np.clip(fraction, 0.0, 1.0), axis=0)
