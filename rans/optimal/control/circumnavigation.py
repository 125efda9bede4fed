"""Guidance of inspections by natural motion circumnavigation: two burns onto a closed orbit around the target."""

from __future__ import annotations

import itertools
import math
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rans.model.drift import velocity_to_reach
from rans.model.fields import Vec2, Vec3, map_leaves
from rans.model.passive_safety import Pieces, carried, joined, keep_away, single_coasts
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.optimal.control.navigation_filter import NavigationFilter
from rans.optimal.control.velocity_guidance import PassivelySafeGuidance, closed_ellipse
from rans.randomization.conditions import Conditions, bounds, largest
from rans.tasks.base import Task
from rans.tasks.inspect import Inspect

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


class Circumnavigation(PassivelySafeGuidance[Inspect]):
    """Inspects a target from a closed orbit around it that keeps pace with the sun, after two burns.

    >>> rans.Circumnavigation("afrl-deputy", "inspect")
    <circumnavigation: Inspect for afrl-deputy>

    An ellipse around the target in the orbit's plane, twice as long as wide, on which v = (n y / 2, -2 n x), is a
    natural motion: it needs no thrust, and turns in the Hill frame once an orbit, as the sun does. A craft that is
    near the sun's direction on it sees the lit side of the target all the time. The motion across the plane is
    left alone.

    With known errors of its sensors it estimates position and velocity by a Kalman filter, and begins to plan
    after ten periods.

    A plan has a time for a first burn, a time for the second one onto the ellipse, its width, and the phase ahead
    of the sun. All of a fixed grid are priced in closed form. From the cheapest on they are judged by prediction,
    until one sees enough in time and keeps clear of the ball and of the end of the zone. Errors of more than
    1 mm/s are corrected on the way. If a plan has ended and too little was seen, the next one is made. The last
    orbit is not left: the craft stays on it without thrust, outside of the ball.

    Source of the motion: W. H. Clohessy and R. S. Wiltshire, "Terminal guidance system for satellite rendezvous",
    Journal of the Aerospace Sciences 27(9), 1960.

    Args:
        craft: by name, TOML file or as such.
        task: an `rans.tasks.inspect.Inspect`, or its name.
        timing: control period, and length of the episode; None: the task's.
        safe_coasts: whether plans are passively safe: if all thrusters shut at any instant, also in the midst of a
            burn, the coast of the next orbit does not enter the keep-out ball. Where no plan is, one is flown that
            is not.
        within: time within which the inspection should end, s, None: the length of the episode. Shorter
            times need more impulse; without a plan in time, the plan that sees the most is flown.

    Raises:
        ConfigError: the task is no inspection.
    """

    name = "circumnavigation"
    heeds_constraints: ClassVar[bool] = True

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None = None,
        within: float | None = None,
        safe_coasts: bool = False,
    ) -> None:
        super().__init__(craft, task, timing, Inspect, "circumnavigation flies inspections")
        length = self._period * self._timing.episode_steps
        self._within = length if within is None else within
        self._safe_coasts = safe_coasts
        self._filter: NavigationFilter | None = None
        self._plans: _Plans | None = None

    def expecting(self, conditions: Conditions | None) -> Circumnavigation:
        """Copy of this guidance that expects the errors of these conditions; None: a perfect world."""
        result = copy(self)
        result._filter = None
        if conditions is not None:
            position = conditions.sensors.position
            velocity = conditions.sensors.velocity
            noise = largest(position.noise), largest(velocity.noise)
            growth = largest(position.noise_per_m), largest(velocity.noise_per_m)
            weakest, strongest = bounds(conditions.thrusters.thrust)
            # The standard deviation of a uniform distribution, and that of every period.
            inexact = math.hypot(
                (strongest - weakest) / math.sqrt(12.0), largest(conditions.thrusters.noise)
            )
            if max(*noise, *growth, inexact) > 0.0:
                result._filter = NavigationFilter(
                    self.task.drift, 3, self._period, *noise, inexact, *growth
                )
        result.reset(0)
        return result

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`; forgets plans and estimates."""
        super().reset(count)
        self._plans = None
        if self._filter is not None:
            self._filter.reset()

    def velocity_change(self, state: Any, goal: Any, now: float) -> tuple[np.ndarray, np.ndarray]:
        """See the base; what errors of the estimate explain is left alone."""
        size = len(state.p.x)
        # Estimate, with standard deviations of position and velocity; noisy readings are filtered for a while.
        listens = False
        position_deviation: Any = 0.0
        velocity_deviation: Any = 0.0
        if self._filter is not None:
            state, position_deviation, velocity_deviation = self._estimated(self._filter, state)
            listens = now < _LISTENING * self._period
        if self._plans is None:
            self._plans = _Plans(*(np.full(size, -1.0) for _ in range(5)))

        # Plan where no plan has been made, and where one has ended too soon.
        over = (now > self._plans.finish) & (self.task.unseen(goal) >= self.task.unseen_tolerance)
        for row in np.flatnonzero(over & (not listens)):
            self._plan(int(row), state, goal, now)

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
        change = np.where(burns, change, 0.0).T
        if self._filter is not None:
            self._filter.burn(change)
        return change, burns

    def _estimated(self, navigation: NavigationFilter, state: Any) -> tuple[Any, Any, Any]:
        """Estimated state after a reading, and standard deviations (N,) of a component of position and velocity."""
        reading = np.array([*state.p.columns(), *state.v.columns()]).T
        mean, covariance = navigation.read(reading)
        variance = np.diagonal(covariance, axis1=1, axis2=2)
        deviations = np.sqrt(variance[:, :3].max(axis=1)), np.sqrt(variance[:, 3:].max(axis=1))
        return replace(state, p=Vec3(*mean[:, :3].T), v=Vec3(*mean[:, 3:].T)), *deviations

    def _change_by_plan(self, state: Any, now: float, plans: _Plans) -> np.ndarray:
        """(3, N) change of velocity in W, m/s, that this period's burn is to give.

        A burn over a period acts as an impulse in its middle.
        """
        half = 0.5 * self._period
        p, v = self.task.drift.carry(state.p, state.v, half)
        p, v = Vec2(p.x, p.y), Vec2(v.x, v.y)
        left = plans.second - now
        transfer = left > half
        time = np.where(transfer, left, self._period)
        to_reach = velocity_to_reach(self.task.drift, p, Vec2(plans.x, plans.y), time)
        waits = now < plans.first - half
        around = closed_ellipse(self.task.mean_motion, p.x, p.y)
        x = np.where(transfer, to_reach.x, around[0]) - v.x
        y = np.where(transfer, to_reach.y, around[1]) - v.y
        return np.where(waits, 0.0, np.array([x, y, 0.0 * x]))

    def _plan(self, row: int, state: Any, goal: Any, now: float) -> None:
        """Set the plan of one flight."""
        assert self._plans is not None
        state_now, target_now = map_leaves(lambda x: float(x[row]), (state, goal))
        left = self._within - now
        if left <= 0.0:
            left = self._within
        first, second, target, price = self._priced(state_now, target_now)
        order = np.argsort(price, kind="stable")
        order = order[second[order] < left]
        most_points = -1
        best = 0
        end = now + left
        for begin in range(0, len(order), _TOGETHER):
            some = order[begin : begin + _TOGETHER]
            inspected, finish = self._judged(
                state_now, target_now, first[some], second[some], target[:, some], left
            )
            if self._safe_coasts and np.isfinite(finish).any():
                safe = self._coasts_safely(
                    state_now, now, first[some], second[some], target[:, some]
                )
                inspected, finish = np.where(safe, inspected, -1), np.where(safe, finish, math.inf)
            # The cheapest that sees enough, or else the one that sees the most.
            k = int(np.argmax(np.where(np.isfinite(finish), math.inf, inspected)))
            if inspected[k] > most_points:
                most_points = inspected[k]
                best = some[k]
                end = now + min(finish[k], left)
            if np.isfinite(finish[k]):
                break
        if most_points < 0:
            # Nothing keeps clear: the closed orbit through this position.
            self._set(row, now, now, state_now.p.x, state_now.p.y, now + left)
            return
        x, y = map(float, target[:, best])
        self._set(row, now + first[best], now + second[best], x, y, end)

    def _set(
        self, row: int, first: float, second: float, x: float, y: float, finish: float
    ) -> None:
        assert self._plans is not None
        self._plans.first[row] = first
        self._plans.second[row] = second
        self._plans.x[row] = x
        self._plans.y[row] = y
        self._plans.finish[row] = finish

    def _priced(
        self, state_now: Any, target_now: Any
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Times of both burns (K,), position of the second (2, K), and velocity change (K,) of all plans."""
        n = self.task.mean_motion
        orbit = self._orbit
        least = self.task.keep_out + _CLEAR
        grid = np.array(list(itertools.product(_WAITS, _TRANSFERS, _PHASES, _WIDTHS))).T
        # Burns are in the middle of control periods.
        period = self._period
        first = np.round(grid[0] * orbit / period) * period + 0.5 * period
        second = first + np.maximum(np.round(grid[1] * orbit / period), 1.0) * period
        phase = target_now.notes[0] - n * second + grid[2]
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
    ) -> tuple[np.ndarray, np.ndarray]:
        """Number of points (K,) that plans see, -1 if one comes too near, and when it is enough, s, else inf."""
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
        # Clear of the ball and of the outer limit, with a margin, at all times until the inspection is done.
        clear = _nearest(p) > task.keep_out + 0.9 * _CLEAR
        clear &= p.norm() < task.fail_distance - _CLEAR
        # Points inspected so far at each time; the sun turns backwards in the Hill frame.
        notes = (target_now.notes[0] - n * times, *target_now.notes[1:])
        coasting = replace(state_now, p=p)
        inspected = np.array(task.visible(replace(target_now, notes=notes), coasting))
        inspected_before = np.array([bool(x) for word in task._known(target_now) for x in word])
        inspected = np.logical_or.accumulate(inspected, axis=1) | inspected_before[:, None, None]
        count = inspected.sum(axis=0)
        enough = 1.0 - count / task.points < task.unseen_tolerance - 1e-9
        finish = np.where(enough.any(axis=0), times[np.argmax(enough, axis=0), 0], math.inf)
        safe = (clear | (times > finish)).all(axis=0)
        return np.where(safe, count[-1], -1), np.where(safe, finish, math.inf)

    def _coasts_safely(
        self, state_now: Any, now: float, first: np.ndarray, second: np.ndarray, target: np.ndarray
    ) -> np.ndarray:
        """Whether the coasts of plans (K,) stay outside the ball for an orbit, whenever the thrusters shut.

        A coast from the start of the flight that enters the ball is left as it is by no plan, only by a burn in
        the first control period.
        """
        n = self.task.mean_motion
        orbit = self._orbit
        count = len(first)
        waits = first > self._period
        start = np.tile(np.array([*state_now.p.columns(), *state_now.v.columns()]), (count, 1))
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
        if self._coast_distance(start[0]) >= self.task.keep_out or now > 0.0:
            pieces.append(Pieces(at_first, transfer, nothing + orbit, nothing, every))
        return keep_away(n, joined(pieces), count, self.task.keep_out + _COASTS_CLEAR)

    def _coasted(self, p: Any, v: Any, times: np.ndarray) -> Vec3:
        positions, _ = self.task.drift.carry(p, v, times)
        shape = np.broadcast_shapes(*(np.shape(x) for x in positions.columns()))
        return Vec3(*(np.broadcast_to(x, shape) for x in positions.columns()))


def _nearest(p: Vec3) -> np.ndarray:
    """Least distance (T, K) from the origin on the line from every instant to the next one, m."""
    points = np.array(p.columns())
    steps = np.diff(points, axis=1, append=points[:, -1:])
    fraction = -(points * steps).sum(axis=0) / np.maximum((steps * steps).sum(axis=0), 1e-12)
    return np.linalg.norm(points + steps * np.clip(fraction, 0.0, 1.0), axis=0)
