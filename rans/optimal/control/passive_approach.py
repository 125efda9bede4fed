"""Approach of a hold point that is passively safe: coasts keep out of the ball whenever the thrusters shut."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rans.model.drift import velocity_to_reach
from rans.model.fields import Quat, Vec3, leaves, map_leaves
from rans.model.passive_safety import (
    Pieces,
    carried,
    joined,
    least_distances,
    pieces_of_periods,
    pushed,
    single_coasts,
)
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.optimal.control.arguments import craft_and_task
from rans.optimal.trajectory.allocation import rounding
from rans.tasks.base import Task
from rans.tasks.hold import Hold

_LEGS = ((1, 24), (2, 6000), (3, 8000))
"""Numbers of coasts of plans, and how many of these are drawn: one has only its time to choose."""
_CHECKED = 256
"""Number of plans whose coasts are computed at once, the cheapest first."""
_MOST_CHECKED = 24 * _CHECKED
"""Number of plans of a start whose coasts are computed: twice as many find a plan for few further starts."""
_FLOWN = 8
"""Number of plans of each batch, safe if burns were impulses, that are flown ahead."""
_CLEAR = 0.1
"""Least distance of the coasts of a flown plan from the ball, m: for rounding."""
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


@dataclass
class _Plan:
    """Plan of one flight with L coasts."""

    times: np.ndarray
    """(L + 1,) instants of the burns, s: the middle of each."""
    begins: np.ndarray
    """(L + 1,) instants at which the burns begin, s."""
    points: np.ndarray
    """(L, 3) where each coast ends, m."""


class PassiveApproach:
    """Flies to a hold point so that if all thrusters shut, a coast of an orbit never enters the keep-out ball.

    >>> rans.PassiveApproach("vbar-chaser", "hold")
    <passive: Hold for vbar-chaser>

    A plan has one to three coasts and a burn before and after each. Plans are drawn at random, with the same random
    numbers for every start. In the order of their prices all their coasts are computed
    (`rans.model.passive_safety`): those of the plan, and those after any part of a burn, first of impulses and then
    of burns as they are flown. The cheapest plan whose coasts keep out of the ball is flown; without one, that
    whose coasts keep the largest distance. Burns of several control periods are centred on their instants and keep
    their direction. At the hold point the craft stays on a closed ellipse, which drifts nowhere.

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

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None = None,
    ) -> None:
        self.craft, task_value = craft_and_task(craft, task)
        self.task = Hold.expected(task_value, "passive approach flies to hold points")
        self._period = (self.task.timing if timing is None else timing).control_period
        self._rounding = rounding(
            self.craft, self._period, np.zeros(self.craft.degrees_of_freedom, bool)
        )
        self.reset(0)

    def __repr__(self) -> str:
        return f"<{self.name}: {type(self.task).__name__} for {self.craft.name}>"

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`; forgets plans."""
        self._rounding.reset(count)
        self._plans: list[_Plan] = []
        self._step = 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; uses the state and the goal's notes, not the observation."""
        size = len(observation)
        state, goal = map_leaves(lambda x: np.broadcast_to(x, size), (state, goal))
        states = np.stack([*state.p.columns(), *state.v.columns()], axis=1)
        goals = np.stack(goal.p.columns(), axis=1)
        if not self._plans:
            deadlines = np.asarray(goal.notes[0])
            self._plans = [
                self._planned(*row) for row in zip(states, goals, deadlines, strict=True)
            ]
        now = self._step * self._period
        self._step += 1
        gain = self._burns(self._plans, states, goals, now)
        # Who has arrived and drifts to the edge comes back.
        staying = np.stack(self.task.staying(state, goal).columns(), axis=1)
        away = np.linalg.norm(states[:, :3] - goals, axis=1) > self.task.position_tolerance * _EDGE
        over = np.array([now > plan.times[-1] + _ARRIVED * self._period for plan in self._plans])
        gain = np.where((over & away)[:, None], staying - states[:, 3:], gain)
        burns: Any = gain.any(axis=1)
        push = Vec3(*(gain * (self.craft.mass / self._period)).T)
        force = np.array(leaves(state.attitude.to(Quat(1.0, 0.0, 0.0, 0.0)).rotate(push)))
        wrench = np.pad(force.T, ((0, 0), (0, self.craft.degrees_of_freedom - 3)))
        return self._rounding.round(wrench, ~burns, state.stores)

    def _burns(
        self, plans: list[_Plan], states: np.ndarray, goals: np.ndarray, now: float
    ) -> np.ndarray:
        """(N, 3) change of velocity in W, m/s, that plans ask of this period; a burn acts in its middle.

        Burns keep their direction where a component exceeds what a period can give.
        """
        n = self.task.mean_motion
        middle = carried(n, states, np.full(len(states), 0.5 * self._period))
        leg = np.array([np.sum(now >= plan.begins - 1e-6) for plan in plans])
        coasting = np.array([0 < k < len(plan.times) for k, plan in zip(leg, plans, strict=True)])
        target = np.stack(
            [
                plan.points[min(max(k, 1), len(plan.points)) - 1]
                for k, plan in zip(leg, plans, strict=True)
            ]
        )
        end = np.array(
            [
                plan.times[min(max(k, 1), len(plan.points))]
                for k, plan in zip(leg, plans, strict=True)
            ]
        )
        time = np.maximum(end - now - 0.5 * self._period, self._period)
        reach = self._velocity(middle[:, :3], target, time)
        # The closed ellipse around the hold point.
        offset = middle[:, :3] - goals
        rest = np.stack(
            [0.5 * n * offset[:, 1], -2.0 * n * offset[:, 0], 0.0 * offset[:, 2]], axis=1
        )
        velocity = np.where(coasting[:, None], reach, rest)
        gain = velocity - middle[:, 3:]
        most = self.task.braking * self._period
        largest = np.abs(gain).max(axis=1, keepdims=True)
        gain = gain * np.minimum(1.0, most / np.maximum(largest, 1e-12))
        return np.where((leg[:, None] > 0) & (largest > _TRIM), gain, 0.0)

    def _velocity(self, p: np.ndarray, target: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Velocities (K, 3) with which coasts lead from positions (K, 3) to others in times (K,)."""
        v = velocity_to_reach(self.task.drift, Vec3(*p.T), Vec3(*target.T), time)
        return np.stack(v.columns(), axis=1)

    def _planned(self, start: np.ndarray, goal: np.ndarray, deadline: float) -> _Plan:
        """The cheapest plan from a state (6,) whose coasts are safe."""
        n = self.task.mean_motion
        orbit = 2.0 * math.pi / n
        own = least_distances(n, single_coasts(start[None], np.array([orbit]), np.array([0])), 1)[0]
        random = np.random.default_rng(0)
        candidates = [
            self._drawn(random, legs, count, start, goal, deadline) for legs, count in _LEGS
        ]
        prices = np.concatenate([batch[0] for batch in candidates])
        # (number of coasts, row)
        names = [(k, row) for k, batch in enumerate(candidates) for row in range(len(batch[0]))]
        order = np.argsort(prices, kind="stable")[:_MOST_CHECKED]
        k, row = names[order[0]]
        best, farthest = self._made(*(x[row] for x in candidates[k][1:])), -1.0
        for begin in range(0, len(order), _CHECKED):
            some = [names[i] for i in order[begin : begin + _CHECKED]]
            pieces = []
            for k, (_, times, _, before, after) in enumerate(candidates):
                mine = [(index, row) for index, (other, row) in enumerate(some) if other == k]
                if not mine:
                    continue
                index, row = np.array(mine).T
                nothing = np.zeros(len(row))
                for j in range(before.shape[1]):
                    if j > 0 or own >= self.task.keep_out:
                        # Any part of a burn.
                        pieces.append(
                            Pieces(before[row, j], after[row, j], nothing + orbit, nothing, index)
                        )
                    if j + 1 < before.shape[1]:
                        lasting = orbit + times[row, j + 1] - times[row, j]
                        pieces.append(single_coasts(after[row, j], lasting, index))
            distance = least_distances(n, joined(pieces), len(some))
            # Those that are safe as impulses are flown ahead.
            ahead = np.flatnonzero(distance > self.task.keep_out)[:_FLOWN]
            if not len(ahead):
                continue
            plans = [
                self._made(*(x[some[i][1]] for x in candidates[some[i][0]][1:])) for i in ahead
            ]
            flown = self._flown(plans, start, goal, own < self.task.keep_out)
            safe = flown > self.task.keep_out + _CLEAR
            if safe.any():
                return plans[int(np.argmax(safe))]
            if flown.max() > farthest:
                best, farthest = plans[int(np.argmax(flown))], float(flown.max())
        return best

    def _made(
        self, times: np.ndarray, points: np.ndarray, before: np.ndarray, after: np.ndarray
    ) -> _Plan:
        begins = times - 0.5 * self._durations((after - before)[:, 3:])
        begins[0] = 0.0
        return _Plan(times, begins, points)

    def _flown(
        self, plans: list[_Plan], start: np.ndarray, goal: np.ndarray, unsafe_start: bool
    ) -> np.ndarray:
        """Distance (K,) that coasts of plans keep, as they are flown with constant thrust in control periods."""
        n, period = self.task.mean_motion, self._period
        count = len(plans)
        states = np.tile(start, (count, 1))
        goals = np.tile(goal, (count, 1))
        pieces = []
        since = np.zeros(count)
        coasts = states
        last = max(plan.times[-1] for plan in plans) + self.task.hold_seconds
        orbit = 2.0 * math.pi / n
        for step in range(math.ceil(last / period)):
            now = step * period
            gain = self._burns(plans, states, goals, now)
            after = pushed(n, states, gain / period, period)
            burn = np.flatnonzero(gain.any(axis=1))
            if len(burn):
                # Coasts since the last burn, and from the midst of this one.
                lasting = orbit + now - since[burn]
                pieces.append(single_coasts(coasts[burn], lasting, burn))
                if step or not unsafe_start:
                    family = pieces_of_periods(
                        n, states[burn], after[burn], period, orbit, self.task.keep_out, burn
                    )
                    pieces.append(family)
                elif unsafe_start:
                    pieces.pop()
                since[burn] = now + period
                coasts = coasts.copy()
                coasts[burn] = after[burn]
            states = after
        everyone = np.arange(count)
        pieces.append(single_coasts(coasts, orbit + last - since, everyone))
        return least_distances(n, joined(pieces), count)

    def _durations(self, burns: np.ndarray) -> np.ndarray:
        """Times (..., 1) that changes of velocity (..., 3) take, in whole control periods, s."""
        largest = np.abs(burns).max(axis=-1)
        periods = np.ceil(largest / (self.task.braking * self._period) - 1e-6)
        return np.maximum(periods, 1.0) * self._period

    def _drawn(
        self,
        random: np.random.Generator,
        legs: int,
        count: int,
        start: np.ndarray,
        goal: np.ndarray,
        deadline: float,
    ) -> tuple[np.ndarray, ...]:
        """Plans of so many coasts.

        Returns:
            Prices (K,), instants of burns (K, L + 1), ends of coasts (K, L, 3), and states (K, L + 1, 6) before and
            after each burn.
        """
        n = self.task.mean_motion
        # Instants, of which the first is half of a burn of three periods after the start.
        fractions = np.maximum(random.dirichlet(np.full(legs, 1.5), count), _SHORTEST)
        fractions /= fractions.sum(axis=1, keepdims=True)
        first = 1.5 * self._period
        latest = deadline - 4.0 * self._period
        total = random.uniform(_EARLIEST, 1.0, (count, 1)) * (latest - first)
        if legs == 1:
            total = np.linspace(_EARLIEST, 1.0, count)[:, None] * (latest - first)
        times = first + np.concatenate(
            [np.zeros((count, 1)), np.cumsum(fractions * total, axis=1)], axis=1
        )
        # Burns begin with control periods: their middles are multiples of half a period.
        times = first + np.round((times - first) / self._period) * self._period
        points = np.tile(goal, (count, legs, 1))
        for j in range(legs - 1):
            if j == legs - 2:
                height, ahead, behind = _BEHIND
                box = random.uniform(
                    [-height, -behind, -height], [height, ahead, height], (count, 3)
                )
                points[:, j] = goal + box
            else:
                away = goal + (start[:3] - goal) * random.uniform(0.2, 1.0, (count, 1))
                points[:, j] = away + random.uniform(-_AROUND, _AROUND, (count, 3))
        state = carried(n, np.tile(start, (count, 1)), times[:, 0])
        price = np.zeros(count)
        before, after = [], []
        for j in range(legs):
            time = times[:, j + 1] - times[:, j]
            before.append(state)
            velocity = self._velocity(state[:, :3], points[:, j], time)
            after.append(np.concatenate([state[:, :3], velocity], axis=1))
            price += np.abs(after[-1] - before[-1])[:, 3:].sum(axis=1)
            state = carried(n, after[-1], time)
        before.append(state)
        after.append(np.concatenate([state[:, :3], np.zeros((count, 3))], axis=1))
        price += np.abs(state[:, 3:]).sum(axis=1)
        befores, afters = np.stack(before, axis=1), np.stack(after, axis=1)
        # Burns must not overlap.
        lasting = self._durations((afters - befores)[:, :, 3:])
        room = np.diff(times, axis=1) - 0.5 * (lasting[:, 1:] + lasting[:, :-1])
        crowded = (room < self._period).any(axis=1) | (
            lasting[:, 0] > 2.0 * first + 2.0 * self._period
        )
        return np.where(crowded, price + 1e3, price), times, points, befores, afters
