"""Passively safe approach of a target to dock with: the coast that leads to it would pass beside it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rans.errors import ConfigError
from rans.guidance.arrival import whole_periods
from rans.model.drift import velocity_to_reach
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3, leaves, map_leaves
from rans.model.passive_safety import (
    CoastZone,
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
from rans.optimal.control.mission_guidance import MissionGuidance
from rans.optimal.trajectory.allocation import rounding
from rans.tasks.base import Task
from rans.tasks.orbital import OrbitalMission
from rans.tasks.shapes import Cone

_TRIES = ((4000, 0.75), (16_000, 0.92))
"""Numbers of plans that are drawn for a start, and the largest part of the time to the deadline that their first
coast takes: the second ones where none of the first is safe."""
_CHECKED = 200
"""Number of plans whose coasts are computed at once, the cheapest first."""
_FLOWN = 8
"""Number of plans of each batch, safe if burns were impulses, that are flown ahead."""
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
_CLEAR = 0.1
"""Least distance of the coasts of a flown plan from the zone, m: for rounding."""
_TRIM = 1e-4
"""Error of velocity that is left alone on the first coast, m/s."""
_OUT_OF_LIMIT = 1e3
"""Price of a plan that breaks a limit, m/s: more than any plan costs."""


class PassiveEntry:
    """Flies to a target so that if all thrusters shut before the approach, a coast of an orbit misses the target.

    >>> rans.PassiveEntry("afrl-deputy", "dock")
    <passive-entry: Dock for afrl-deputy>

    The first coast ends a little within the distance of the approach (`rans.tasks.base.Task.coast_zone`), at a
    point from where it would pass beside the zone. There `rans.MissionGuidance` takes over, and flies to the
    target. Plans, that is points and times, are drawn at random, with the same random numbers for every start. In
    the order of their prices their coasts are computed (`rans.model.passive_safety`), first of impulses and then of
    burns as they are flown. The cheapest plan whose coasts keep out of the zone is flown; without one, that whose
    coasts keep the largest distance.

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

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None = None,
    ) -> None:
        self.craft, task_value = craft_and_task(craft, task)
        mission = OrbitalMission.expected(task_value, "passive entry flies missions on an orbit")
        self._guidance = MissionGuidance(self.craft, mission, timing)
        zone = mission.coast_zone
        if zone is None or zone.approach <= zone.radius or self.craft.dimension != 3:
            raise ConfigError(
                f"passive entry flies missions in space with an approach to a target, such as dock, and "
                f"{type(mission).__name__} is not one."
            )
        self.task: OrbitalMission = mission
        self._zone: CoastZone = zone
        # The target is at W's origin.
        origin = Vec3(0.0, 0.0, 0.0)
        goal = SpatialState(origin, Quat(1.0, 0.0, 0.0, 0.0), origin, origin)
        self._limits = mission.guidance_limits(goal)
        self._period = (mission.timing if timing is None else timing).control_period
        free = np.zeros(self.craft.degrees_of_freedom, bool)
        self._rounding = rounding(self.craft, self._period, free)
        # What the weakest axis can give in a period, m/s.
        forces = np.array([t.force * np.array(t.direction) for t in self.craft.thrusters])
        strongest = np.maximum(forces, 0.0).sum(axis=0)
        self._most = float(strongest.min()) * self._period / self.craft.mass
        self.reset(0)

    def __repr__(self) -> str:
        return f"<{self.name}: {type(self.task).__name__} for {self.craft.name}>"

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`; forgets plans."""
        self._guidance.reset(count)
        self._rounding.reset(count)
        self._step = 0
        self._points = np.zeros((0, 3))
        """(N, 3) ends of the first coasts, m."""
        self._ends = np.zeros(0)
        """(N,) their instants, s."""
        self._entered = np.zeros(count, bool)
        """(N,) whether mission guidance flies."""
        self._arrivals = np.zeros(count)
        """(N,) instants of the arrivals that it plans, s."""

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; uses the state and the goal's notes, not the observation."""
        size = len(observation)
        state, goal = map_leaves(lambda x: np.broadcast_to(x, size), (state, goal))
        states = np.stack([*state.p.columns(), *state.v.columns()], axis=1)
        now = self._step * self._period
        self._step += 1
        if not len(self._points):
            self._entered, self._arrivals = np.zeros(size, bool), np.zeros(size)
            plans = [self._planned(p, float(t)) for p, t in zip(states, goal.notes[0], strict=True)]
            self._points = np.array([point for point, _ in plans])
            self._ends = np.array([end for _, end in plans])
        # Within the approach mission guidance makes a plan of its own.
        near = np.linalg.norm(states[:, :3], axis=1) < self._zone.approach
        enters = (near | (now > self._ends)) & ~self._entered
        if enters.any():
            anew = self.task.plan(state, goal, goal.notes[0])
            self._arrivals = np.where(enters, now + anew.notes[1], self._arrivals)
            self._entered |= enters
        arrival = np.where(self._entered, self._arrivals - now, goal.notes[1])
        planned = replace(goal, notes=(goal.notes[0], arrival, *goal.notes[2:]))
        command = self._guidance.act(state, planned, observation)
        gain = np.where(
            self._entered[:, None], 0.0, self._gain(states, self._points, self._ends, now)
        )
        burns: Any = gain.any(axis=1)
        push = Vec3(*(gain * (self.craft.mass / self._period)).T)
        force = np.array(leaves(state.attitude.to(Quat(1.0, 0.0, 0.0, 0.0)).rotate(push)))
        wrench = np.pad(force.T, ((0, 0), (0, self.craft.degrees_of_freedom - 3)))
        entry = self._rounding.round(wrench, ~burns, state.stores)
        return np.where(self._entered[:, None], command, entry)

    def _gain(
        self, states: np.ndarray, points: np.ndarray, ends: np.ndarray, now: float
    ) -> np.ndarray:
        """(N, 3) change of velocity in W, m/s, of this period, which acts in its middle and keeps its direction."""
        half = 0.5 * self._period
        middle = carried(self.task.mean_motion, states, np.full(len(states), half))
        left = np.maximum(ends - now - half, self._period)
        gain = self._velocity(middle[:, :3], points, left) - middle[:, 3:]
        largest = np.abs(gain).max(axis=1, keepdims=True)
        gain = gain * np.minimum(1.0, self._most / np.maximum(largest, 1e-12))
        return np.where((largest > _TRIM) & (ends - now > self._period)[:, None], gain, 0.0)

    def _velocity(self, p: np.ndarray, target: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Velocities (K, 3) with which coasts lead from positions (K, 3) to others in times (K,)."""
        v = velocity_to_reach(self.task.drift, Vec3(*p.T), Vec3(*target.T), time)
        return np.stack(v.columns(), axis=1)

    def _planned(self, start: np.ndarray, deadline: float) -> tuple[np.ndarray, float]:
        """End of the first coast from a state (6,), m, and its instant, s."""
        n, radius = self.task.mean_motion, self._zone.radius
        orbit = 2.0 * math.pi / n
        own = least_distances(n, single_coasts(start[None], np.array([orbit]), np.array([0])), 1)[0]
        best: tuple[np.ndarray, float] | None = None
        farthest = -1.0
        for count, latest in _TRIES:
            points, ends, before, after, price = self._drawn(start, deadline, count, latest)
            order = np.argsort(price, kind="stable")
            order = order[price[order] < _OUT_OF_LIMIT]
            for begin in range(0, len(order), _CHECKED):
                some = order[begin : begin + _CHECKED]
                number = np.arange(len(some))
                nothing = np.zeros(len(some))
                pieces = [single_coasts(after[some], orbit + ends[some], number)]
                if own >= radius:
                    pieces.append(
                        Pieces(before[some], after[some], nothing + orbit, nothing, number)
                    )
                distance = least_distances(n, joined(pieces), len(some))
                # Those that are safe as impulses are flown ahead.
                ahead = some[distance > radius + _CLEAR][:_FLOWN]
                if not len(ahead):
                    continue
                flown = self._flown(start, points[ahead], ends[ahead], own < radius)
                safe = flown > radius + _CLEAR
                if safe.any():
                    chosen = ahead[int(np.argmax(safe))]
                    return points[chosen], float(ends[chosen])
                if flown.max() > farthest:
                    chosen = ahead[int(np.argmax(flown))]
                    best, farthest = (points[chosen], float(ends[chosen])), float(flown.max())
            if best is None:
                chosen = int(np.argmin(price))
                best = points[chosen], float(ends[chosen])
        assert best is not None
        return best

    def _drawn(
        self, start: np.ndarray, deadline: float, count: int, latest: float
    ) -> tuple[np.ndarray, ...]:
        """So many plans of a start, with the largest part of the time that their first coast takes.

        Returns:
            Ends of first coasts (K, 3), their instants (K,), states (K, 6) before and after the burn, and prices
            (K,).
        """
        n, period = self.task.mean_motion, self._period
        random = np.random.default_rng(0)
        half = 0.5 * period
        time = whole_periods(deadline * random.uniform(_EARLIEST, latest, count), period)
        time = np.maximum(time, 2.0 * period)
        direction = random.normal(size=(count, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        direction = self._within_cone(direction, random)
        points = direction * self._zone.approach * random.uniform(*_DEPTHS, (count, 1))
        before = carried(n, np.tile(start, (count, 1)), np.full(count, half))
        after = before.copy()
        after[:, 3:] = self._velocity(before[:, :3], points, time)
        there = carried(n, after, time)
        # The rest of the way by two impulses.
        rest = np.full(count, np.inf)
        for part in _REST:
            left = np.maximum((deadline - half - time - 2.0 * period) * part, period)
            velocity = self._velocity(points, np.zeros((count, 3)), left)
            arrival = carried(n, np.concatenate([points, velocity], axis=1), left)[:, 3:]
            brake = np.maximum(np.abs(arrival).sum(axis=1) - self.task.velocity_tolerance, 0.0)
            rest = np.minimum(rest, np.abs(velocity - there[:, 3:]).sum(axis=1) + brake)
        price = np.abs(after - before)[:, 3:].sum(axis=1) + rest
        for part in np.linspace(0.0, 1.0, 9):
            price = np.where(
                self._keeps_speed(carried(n, after, time * part)), price, price + _OUT_OF_LIMIT
            )
        return points, time + half, before, after, price

    def _within_cone(self, direction: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """Directions (K, 3), or as many within the cone of the mission if it has one."""
        for limit in self._limits.others:
            if isinstance(limit, Cone):
                axis = np.array([float(x) for x in limit.axis.columns()])
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

    def _flown(
        self, start: np.ndarray, points: np.ndarray, ends: np.ndarray, unsafe_start: bool
    ) -> np.ndarray:
        """Distance (K,) that coasts of plans keep, as they are flown with constant thrust in control periods."""
        n, period = self.task.mean_motion, self._period
        orbit = 2.0 * math.pi / n
        count = len(points)
        states = coasts = np.tile(start, (count, 1))
        since = np.zeros(count)
        pieces = []
        for step in range(math.ceil(ends.max() / period) + 1):
            now = step * period
            away = np.linalg.norm(states[:, :3], axis=1) >= self._zone.approach
            gain = np.where(away[:, None], self._gain(states, points, ends, now), 0.0)
            after = pushed(n, states, gain / period, period)
            burn = np.flatnonzero(gain.any(axis=1))
            if len(burn):
                if step or not unsafe_start:
                    pieces.append(single_coasts(coasts[burn], orbit + now - since[burn], burn))
                    pieces.append(
                        pieces_of_periods(
                            n, states[burn], after[burn], period, orbit, self._zone.radius, burn
                        )
                    )
                since[burn] = now + period
                coasts = coasts.copy()
                coasts[burn] = after[burn]
            states = after
        pieces.append(single_coasts(coasts, orbit + ends + period - since, np.arange(count)))
        return least_distances(n, joined(pieces), count)
