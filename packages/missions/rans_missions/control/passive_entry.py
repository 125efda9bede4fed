"""Passively safe approach of a target to dock with: the coast that leads to it would pass beside it.

`_points`, `_ends`, `_entered` and `_arrivals` have a row for each episode; plans are drawn with one seed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from rans.extend import ConfigError, Quat, Spacecraft, SpatialState, Task, Timing, Vec3, map_leaves
from rans.model.drift import steady
from rans.model.spacecraft import can_turn
from rans.tasks.shapes import Cone
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.control.passively_safe import PassivelySafeGuidance
from rans_missions.control.velocity_guidance import weaker
from rans_missions.convex.passive_transfer import passive_transfer
from rans_missions.convex.rendezvous import Meeting, least_margin
from rans_missions.guidance.arrival import whole_periods
from rans_missions.passive_safety import (
    CoastZone,
    Pieces,
    carried,
    coast_zone,
    joined,
    keep_away,
    pushed,
    single_coasts,
)
from rans_missions.tasks.orbital import OrbitalMission, last_check
from rans_missions.vectors import motion_of, numbers

_TRIES = ((0, 4000, 0.75), (0, 16_000, 0.92), (1, 32_000, 0.92))
"""Seeds and numbers of plans that are drawn for a start, and the largest part of the time to its deadline that the
first coast takes: later ones where none of those before is safe."""
_TURNS = tuple((seed, 32_000, 0.92) for seed in range(2, 10))
"""The same of plans whose first coast turns on the way, where none of those without a turn is safe."""
_TURN_SPEEDS = (0.003, 0.3)
"""Least and largest change of velocity with which such a plan begins, m/s: the largest is about a speed limit."""
_TURN = (0.05, 0.5)
"""Least and largest part of the time to the deadline before the turn."""
_CHECKED = 200
"""Number of plans whose coasts are computed at once, the cheapest first."""
_EARLIEST = 0.15
"""Least part of the time to the deadline that the first coast takes."""
_DEPTHS = (0.8, 0.97)
"""Least and largest distance of its end from the target, in those of `CoastZone.approach`."""
_REST = (0.3, 0.5, 0.75, 1.0)
"""Parts of the rest of the time for which the way from there to the target is priced."""
_CONE = 0.9
"""Part of a cone's half angle within which the first coast ends."""
_SPEED = 0.95
"""Part of a speed limit that plans keep."""
_ATTEMPTS = 12
"""Number of plans of a start that are flown ahead to find one that stays inside a cone."""
_CLEAR = 0.1
"""Least distance of coasts after impulses from the zone, m, in plans whose flight is predicted."""
_TRIM = 1e-4
"""Error of velocity that is left alone on the first coast, m/s."""
_ENTRIES = (0.77, 0.7, 0.84)
"""Parts of the time to the deadline in which a transfer of cone programs comes to the approach, tried in turn."""
_TRANSFER_CLEAR = 0.3
"""Distance from the zone that coasts of these keep at the instants of the programs, m."""
_OUT_OF_LIMIT = 1e3
"""Price of a plan that breaks a limit, m/s: more than any plan costs."""


class _Plans(NamedTuple):
    """Plans from one start: arrays of K."""

    points: np.ndarray
    """(K, 2, 3) where the first coast turns and where it ends, m; both equal: it does not turn."""
    ends: np.ndarray
    """(K, 2) instants of both, s."""
    before: np.ndarray
    """(K, B, 6) states before the burn at once, and before the turn."""
    after: np.ndarray
    """(K, B, 6) states after these burns."""
    price: np.ndarray
    """(K,) impulse to the target over mass, m/s."""

    def first_coast(self, row: int, is_safe: bool) -> _Plan:
        """The first coast of a plan."""
        return _Plan(self.points[row], self.ends[row], is_safe)


class _Plan(NamedTuple):
    """First coast of one plan."""

    points: np.ndarray
    """(2, 3) where it turns and where it ends, m."""
    ends: np.ndarray
    """(2,) instants of both, s."""
    is_safe: bool
    """Whether all its coasts keep out of the zone."""


class PassiveEntry(PassivelySafeGuidance[OrbitalMission]):
    """Flies to a target so that if all thrusters shut before the approach, a coast of an orbit misses the target.

    >>> rans.PassiveEntry("afrl-deputy", "dock")
    <passive-entry: Dock for afrl-deputy>

    The first coast ends a little within the distance of the approach (`rans_missions.passive_safety.coast_zone`),
    at a point from where it would pass beside the zone. There `rans.MissionGuidance` takes over, and flies to the
    target. Plans, that is points and times, are drawn at random, with the same random numbers for every start. In
    the order of their prices their coasts are computed (`rans_missions.passive_safety`), first of impulses and then
    of burns as they are flown. The cheapest plan whose coasts keep out of the zone is flown. Without one, the first
    coast may turn on the way by one more burn. The whole flight is predicted. Of a mission with a cone the cheapest
    of these plans is flown that stays inside the cone. Of other missions a start without a plan that is safe, keeps
    the limits and arrives in time has a thrust for every period from cone programs
    (`rans_missions.convex.passive_transfer`). Without these too, that plan is flown whose coasts keep the largest
    distance.

    It knows the state exactly, and expects no errors of sensors and thrusters.

    Args:
        craft: by name, TOML file or as such.
        task: a mission on an orbit whose zone has an approach: dock or rendezvous.
        timing: control period, and length of the episode; None: the task's.

    Raises:
        ConfigError: the task is no such mission.
    """

    name = "passive-entry"
    heeds_constraints: ClassVar[bool] = True
    mission = OrbitalMission
    purpose = "passive entry flies missions on an orbit"

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None = None,
    ) -> None:
        super().__init__(craft, task, timing)
        self._guidance = MissionGuidance(self.craft, self.task, timing)
        steady(self.task.drift, "passive entry computes coasts")
        zone = coast_zone(self.task)
        if zone is None or zone.approach <= zone.radius or self.craft.dimension != 3:
            raise ConfigError(
                f"passive entry flies missions in space with an approach to a target, such as dock, and "
                f"{type(self.task).__name__} is not one."
            )
        self._zone: CoastZone = zone
        # The target is at W's origin.
        origin = Vec3(0.0, 0.0, 0.0)
        goal = SpatialState(origin, Quat(1.0, 0.0, 0.0, 0.0), origin, origin)
        self._limits = self.task.guidance_limits(goal)
        self._has_cone = any(isinstance(limit, Cone) for limit in self._limits.others)
        self.reset(0)

    def reset(self, count: int) -> None:
        """Forget plans and count ``count`` episodes; mission guidance begins anew too."""
        super().reset(count)
        self._guidance.reset(count)
        self._points = np.zeros((0, 2, 3))
        """(N, 2, 3) turns and ends of the first coasts, m."""
        self._ends = np.zeros((0, 2))
        """(N, 2) their instants, s."""
        self._entered = np.zeros(count, bool)
        """(N,) whether mission guidance flies."""
        self._arrivals = np.zeros(count)
        """(N,) instants of the arrivals that it plans, s."""
        self._scheduled: dict[int, np.ndarray] = {}
        """Changes of velocity in W in every period, (T, 3) m/s, of flights that cone programs have planned."""

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands (N, n): of coasts, or of mission guidance where it has taken over.

        The observation is not read.

        Every call counts a control period.
        """
        size = len(observation)
        state, goal = map_leaves(lambda x: np.broadcast_to(x, size), (state, goal))
        coasting = super().act(state, goal, observation)
        # Where mission guidance flies, its own arrival counts.
        now = (self._step - 1) * self._period
        arrival = np.where(self._entered, self._arrivals - now, goal.notes.arrival)
        planned = replace(goal, notes=replace(goal.notes, arrival=arrival))
        approaching = self._guidance.act(state, planned, observation)
        return np.where(self._entered[:, None], approaching, coasting)

    def velocity_change(self, state: Any, goal: Any, now: float) -> tuple[np.ndarray, np.ndarray]:
        """Changes of velocity (N, 3), m/s, and which rows burn; zero where mission guidance flies.

        The first call plans. Rows that are near, or late, are handed over to mission guidance for good.
        """
        states = motion_of(state)
        if not len(self._points):
            size = len(states)
            self._entered, self._arrivals = np.zeros(size, bool), np.zeros(size)
            plans = self._planned(states, state, goal)
            self._points = np.array([plan.points for plan in plans])
            self._ends = np.array([plan.ends for plan in plans])
        # Within the approach mission guidance makes a plan of its own.
        near = np.linalg.norm(states[:, :3], axis=1) < self._zone.approach
        step = round(now / self._period)
        schedules = {row: x for row, x in self._scheduled.items() if step < len(x)}
        enters = (near | (now > self._ends[:, 1])) & ~self._entered
        enters[list(schedules)] = False
        if enters.any():
            replanned = self.task.plan(state, goal, goal.notes.deadline)
            self._arrivals = np.where(enters, now + replanned.notes.arrival, self._arrivals)
            self._entered |= enters
        change = np.where(
            self._entered[:, None], 0.0, self._change(states, self._points, self._ends, now)
        )
        for row, changes in schedules.items():
            change[row] = changes[step]
        burns: Any = change.any(axis=1)
        return change, burns

    def _change(
        self, states: np.ndarray, points: np.ndarray, ends: np.ndarray, now: float
    ) -> np.ndarray:
        """(N, 3) change of velocity in W, m/s, of this period, which acts in its middle and keeps its direction.

        Columns of points and ends are the turn and the arrival. Now is s since the start; a burn that is not worth
        its error (`_TRIM`) waits for the next period. Plans are judged by flights of this same law
        (`_distance_of_flights`), so that a change of it changes which plan is chosen.
        """
        turned = now > ends[:, 0] - 0.75 * self._period
        points = np.where(turned[:, None], points[:, 1], points[:, 0])
        ends = np.where(turned, ends[:, 1], ends[:, 0])
        change = self._change_to_coast(states, points, ends, now)
        change, largest = weaker(change, self._most)
        return np.where((largest > _TRIM) & (ends - now > self._period)[:, None], change, 0.0)

    def _planned(self, states: np.ndarray, state: Any, goal: Any) -> list[_Plan]:
        """Plans of all starts, of states (N, 6): see `_plan`.

        All plans are flown ahead to the target. Where the mission has a cone, a start whose flight does not win
        tries its next plan, and flies the first one if none of its plans does. Elsewhere it tries cone programs.
        """
        deadlines = [float(t) for t in goal.notes.deadline]
        plans = [self._plan(p, t) for p, t in zip(states, deadlines, strict=True)]
        excluded: list[list[np.ndarray]] = [[] for _ in plans]
        trying = np.arange(len(plans))
        attempts = dict(enumerate(plans))
        for _ in range(_ATTEMPTS if self._has_cone else 1):
            wins = self._wins(states, state, goal, trying, [attempts[k] for k in trying.tolist()])
            for k in trying[wins].tolist():
                plans[k] = attempts[k]
            trying = trying[~wins]
            if not len(trying):
                break
            if self._has_cone:
                for k in trying.tolist():
                    excluded[k].append(attempts[k].points)
                    attempts[k] = self._plan(states[k], deadlines[k], excluded[k])
        if not self._has_cone and not can_turn(self.craft):
            unsafe = [k for k, plan in enumerate(plans) if not plan.is_safe]
            for k in sorted({*trying.tolist(), *unsafe}):
                self._schedule(k, states, state, goal, plans[k])
        return plans

    def _schedule(self, row: int, states: np.ndarray, state: Any, goal: Any, plan: _Plan) -> None:
        """Set the thrust of one flight by cone programs, if they have a safe flight that wins."""
        start, deadline = states[row], float(goal.notes.deadline[row])
        target = map_leaves(lambda x: float(x[row]), goal)
        meeting = replace(Meeting.of(self.craft, self.task, target), timing=self._timing)
        periods = last_check(deadline, self._period)
        if least_margin(meeting.limits, np.stack([start, start])) < 0.0:
            # Lost, whatever is flown.
            return
        for part in _ENTRIES:
            entry = round(part * periods)
            commands = passive_transfer(meeting, start, self._zone, _TRANSFER_CLEAR, entry, periods)
            if commands is None:
                continue
            changes = commands @ meeting.forces.T * (self._period / self.craft.mass)

            def law(x: np.ndarray, now: float, changes: np.ndarray = changes) -> np.ndarray:
                away = np.linalg.norm(x[:, :3], axis=1) >= self._zone.approach
                return np.where(away[:, None], changes[round(now / self._period)], 0.0)

            distance = self._predicted_distance(
                start[None],
                law,
                entry,
                self._orbit + entry * self._period,
                self._coast_distance(start) < self._radius,
            )
            rows = np.array([row])
            if (
                self._is_safe(distance[0])
                and self._wins(states, state, goal, rows, [plan], {0: changes}).all()
            ):
                self._scheduled[row] = changes
                return

    def _wins(
        self,
        states: np.ndarray,
        state: Any,
        goal: Any,
        rows: np.ndarray,
        plans: list[_Plan],
        scheduled: dict[int, np.ndarray] | None = None,
    ) -> np.ndarray:
        """Whether flights by plans from states (N, 6) with these numbers keep all limits and arrive, (K,).

        It flies a copy of this guidance with arrays of its own, so that nothing of the running episodes changes.
        """
        ahead = copy(self)
        # Everything forgotten, in objects of its own.
        ahead._guidance = MissionGuidance(self.craft, self.task, self._timing)
        ahead._rounding = copy(self._rounding)
        ahead.reset(len(rows))
        ahead._points = np.array([plan.points for plan in plans])
        ahead._ends = np.array([plan.ends for plan in plans])
        ahead._scheduled = scheduled or {}
        some, aim = map_leaves(lambda x: np.asarray(x)[rows], (state, goal))
        return ahead._arrives(states[rows], some, aim)

    def _arrives(self, states: np.ndarray, state: Any, goal: Any) -> np.ndarray:
        """Whether flights from states (N, 6) keep all limits at every check, and arrive by the deadline, (N,).

        The motion is that of the drift in closed form, and checks are those of the engine. `act` changes this
        object.
        """
        n, checks = self.task.mean_motion, self._timing.checks
        forces = np.array([t.force * np.array(t.direction) for t in self.craft.thrusters])
        inside = np.ones(len(states), bool)
        arrived = np.zeros(len(states), bool)
        limits = (*self._limits.speeds, *self._limits.others)
        for _ in range(math.ceil(np.max(goal.notes.deadline) / self._period)):
            now = replace(state, p=Vec3(*states[:, :3].T), v=Vec3(*states[:, 3:].T))
            command = self.act(now, goal, np.zeros((len(states), 0)))
            push = command @ forces / self.craft.mass
            after = states
            for check in range(1, checks + 1):
                passed = check * self._period / checks
                after = pushed(n, states, push, passed)
                p, v = Vec3(*after[:, :3].T), Vec3(*after[:, 3:].T)
                for limit in limits:
                    inside &= arrived | (np.asarray(limit.gap(p, v)) >= 0.0)
                reached = np.asarray(self.task.reached(replace(now, p=p, v=v), goal))
                arrived |= reached & inside & (goal.notes.deadline >= passed)
            states = after
            goal = self.task.later(goal, self._period)
            if bool((arrived | ~inside).all()):
                break
        return inside & arrived

    def _plan(
        self, start: np.ndarray, deadline: float, excluded: Sequence[np.ndarray] = ()
    ) -> _Plan:
        """The plan from a state (6,); another one than those whose points are excluded.

        Each try has a seed of its own, so that a plan depends on the start and the deadline alone.
        """
        is_unsafe_start = self._coast_distance(start) < self._radius
        best: _Plan | None = None
        farthest = -1.0
        for number, (seed, count, latest) in enumerate(_TRIES + _TURNS):
            turns = number >= len(_TRIES)
            plans = self._sampled(start, deadline, seed, count, latest, turns)
            order = np.argsort(plans.price, kind="stable")
            allowed = plans.price < _OUT_OF_LIMIT
            for point in excluded:
                allowed &= (plans.points != point).any(axis=(1, 2))
            plan = self._cheapest_safe(
                order[allowed[order]],
                _CHECKED,
                partial(self._safe_impulses, plans, is_unsafe_start),
                partial(self._distance_of_flights, plans, start, is_unsafe_start),
            )
            if plan is not None and plan.distance > farthest:
                farthest = plan.distance
                best = plans.first_coast(plan.row, bool(self._is_safe(farthest)))
            if self._is_safe(farthest):
                break
            if best is None:
                # No coast is safe even after impulses: the cheapest plan.
                best = plans.first_coast(int(np.argmin(plans.price)), False)
        assert best is not None
        return best

    def _safe_impulses(self, plans: _Plans, is_unsafe_start: bool, rows: np.ndarray) -> np.ndarray:
        """Whether the coasts of plans with these numbers keep out of the zone if the burn is an impulse, (K,)."""
        n, orbit = self.task.mean_motion, self._orbit
        after = plans.after[rows]
        flight = np.arange(len(rows))
        zero = np.zeros(len(rows))
        pieces = []
        for burn in range(after.shape[1]):
            lasting = orbit + plans.ends[rows, burn if after.shape[1] == 2 else 1]
            pieces.append(single_coasts(after[:, burn], lasting, flight))
            if burn or not is_unsafe_start:
                # Thrusters may shut after any part of the burn.
                before = plans.before[rows, burn]
                pieces.append(Pieces(before, after[:, burn], zero + orbit, zero, flight))
        return keep_away(n, joined(pieces), len(rows), self._radius + _CLEAR)

    def _distance_of_flights(
        self, plans: _Plans, start: np.ndarray, is_unsafe_start: bool, rows: np.ndarray
    ) -> np.ndarray:
        """Distance (K,), m, that the coasts of plans with these numbers keep, with burns as they are flown."""
        points, ends = plans.points[rows], plans.ends[rows]

        def law(states: np.ndarray, now: float) -> np.ndarray:
            # From the approach on coasts may lead anywhere.
            away = np.linalg.norm(states[:, :3], axis=1) >= self._zone.approach
            return np.where(away[:, None], self._change(states, points, ends, now), 0.0)

        return self._predicted_distance(
            np.tile(start, (len(rows), 1)),
            law,
            math.ceil(ends.max() / self._period) + 1,
            self._orbit + ends[:, 1] + self._period,
            is_unsafe_start,
        )

    def _sampled(
        self,
        start: np.ndarray,
        deadline: float,
        seed: int,
        count: int,
        latest: float,
        turns: bool = False,
    ) -> _Plans:
        """Plans from a state (6,); the first coast takes at most a part ``latest`` of the time to the deadline.

        Time, direction, cone and depth are drawn in this order, then the turn: published plans have it.
        """
        n, period = self.task.mean_motion, self._period
        random = np.random.default_rng(seed)
        # The burn acts in the middle of the first control period.
        half = 0.5 * period
        time = whole_periods(deadline * random.uniform(_EARLIEST, latest, count), period)
        time = np.maximum(time, 2.0 * period)
        # Points a little within the distance of the approach, in any direction that the mission allows.
        direction = random.normal(size=(count, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        direction = self._within_cone(direction, random)
        points = direction * self._zone.approach * random.uniform(*_DEPTHS, (count, 1))
        # The first coast, from the start or from the turn on.
        before = carried(n, np.tile(start, (count, 1)), np.full(count, half))
        to_turn = np.zeros(count)
        begins, begun = [], []
        if turns:
            to_turn = whole_periods(deadline * random.uniform(*_TURN, count), period)
            to_turn = np.clip(to_turn, 2.0 * period, np.maximum(time - 2.0 * period, 2.0 * period))
            away = random.normal(size=(count, 3))
            away /= np.linalg.norm(away, axis=1, keepdims=True)
            slowest, fastest = map(math.log, _TURN_SPEEDS)
            speed = np.exp(random.uniform(slowest, fastest, (count, 1)))
            begins.append(before)
            begun.append(before + np.concatenate([np.zeros((count, 3)), away * speed], axis=1))
            before = carried(n, begun[0], to_turn)
        end = time + half
        time = np.maximum(time - to_turn, period)
        after = before.copy()
        after[:, 3:] = self._coast_velocity(before[:, :3], points, time)
        at_point = carried(n, after, time)
        # The remaining way by two impulses, in the cheapest of a few times.
        remaining = np.full(count, np.inf)
        for part in _REST:
            left = np.maximum((deadline - end - 2.0 * period) * part, period)
            velocity = self._coast_velocity(points, np.zeros((count, 3)), left)
            arrival = carried(n, np.concatenate([points, velocity], axis=1), left)[:, 3:]
            brake = np.maximum(np.abs(arrival).sum(axis=1) - self.task.velocity_tolerance, 0.0)
            impulse = np.abs(velocity - at_point[:, 3:]).sum(axis=1) + brake
            remaining = np.minimum(remaining, impulse)
        price = np.abs(after - before)[:, 3:].sum(axis=1) + remaining
        # Plans that break a speed limit at one of nine instants of the coast.
        for part in np.linspace(0.0, 1.0, 9):
            price = np.where(
                self._keeps_speed(carried(n, after, time * part)), price, price + _OUT_OF_LIMIT
            )
        begins.append(before)
        begun.append(after)
        if turns:
            price += np.abs(begun[0] - begins[0])[:, 3:].sum(axis=1)
            for part in np.linspace(0.0, 1.0, 9):
                keeps = self._keeps_speed(carried(n, begun[0], to_turn * part))
                price = np.where(keeps, price, price + _OUT_OF_LIMIT)
            late = to_turn + time + half > end
            price = np.where(late, price + _OUT_OF_LIMIT, price)
        turn = before[:, :3] if turns else points
        ends = np.stack([to_turn + half if turns else end, end], axis=1)
        return _Plans(
            np.stack([turn, points], axis=1),
            ends,
            np.stack(begins, axis=1),
            np.stack(begun, axis=1),
            price,
        )

    def _within_cone(self, direction: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """Directions (K, 3), or as many within the cone of the mission if it has one.

        It draws from ``random`` only where there is a cone.
        """
        for limit in self._limits.others:
            if isinstance(limit, Cone):
                axis = numbers(limit.axis)
                axis /= np.linalg.norm(axis)
                across = direction - np.outer(direction @ axis, axis)
                across /= np.linalg.norm(across, axis=1, keepdims=True)
                angle = float(limit.half_angle) * _CONE * random.uniform(size=(len(direction), 1))
                return np.cos(angle) * axis + np.sin(angle) * across
        return direction

    def _keeps_speed(self, states: np.ndarray) -> np.ndarray:
        """Whether states (K, 6) keep `_SPEED` of the mission's speed limit, if it has one."""
        within = np.ones(len(states), bool)
        p, v = Vec3(*states[:, :3].T), Vec3(*states[:, 3:].T)
        for limit in self._limits.speeds:
            allowed = np.asarray(limit.gap(p, v.scale(0.0)))
            within &= np.linalg.norm(states[:, 3:], axis=1) < _SPEED * allowed
        return within
