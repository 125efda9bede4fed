"""Bases of guidance on an orbit that changes the velocity of a craft: the frame of each law, and safe coasts."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np

from rans.extend import Quat, Spacecraft, Task, Timing, Vec3, leaves, map_leaves
from rans.optimal.control.arguments import craft_and_task
from rans.optimal.trajectory.allocation import rounding
from rans_missions.orbits.reach import velocity_to_reach
from rans_missions.passive_safety import (
    carried,
    coast_zone,
    joined,
    least_distances,
    pieces_of_periods,
    pushed,
    single_coasts,
)
from rans_missions.tasks.final_approach import FinalApproach
from rans_missions.tasks.inspect import Inspect
from rans_missions.tasks.orbital import OrbitalMission

_PREDICTED = 8
"""Number of plans of each batch, safe if burns were impulses, whose flight is predicted."""
_CLEAR = 0.1
"""Least distance of the coasts of a predicted flight from the zone, m: for rounding to pulses."""

Mission = TypeVar("Mission", bound=OrbitalMission | Inspect | FinalApproach)


class VelocityGuidance(ABC, Generic[Mission]):
    """Base of controllers in space that change the velocity of a craft, whose law is `velocity_change`.

    In every control period the law gives a change of velocity in W. It is turned into the body frame, and rounded
    to what the thrusters can give; no torque is given.

    Args:
        craft: by name, TOML file or as such.
        task: a mission, by name or as such.
        timing: control period, and length of the episode; None: the task's.
        mission: class of the missions that the law flies.
        purpose: beginning of the message for other tasks, such as "visiting flies inspections".

    Raises:
        ConfigError: the task is no such mission.
    """

    name: str
    observes: ClassVar[bool] = False
    """Whether it reads observations (`rans.flight.Controller`)."""

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None,
        mission: type[Mission],
        purpose: str,
    ) -> None:
        self.craft, task_value = craft_and_task(craft, task)
        self.task: Mission = mission.expected(task_value, purpose)
        self._timing = self.task.timing if timing is None else timing
        self._period = self._timing.control_period
        # Nothing is carried over to the next period: the law sees what is missing in the next state.
        self._rounding = rounding(
            self.craft, self._period, np.zeros(self.craft.degrees_of_freedom, bool)
        )
        self._step = 0
        """Number of control periods since the reset."""

    @cached_property
    def _most(self) -> float:
        """Change of velocity that a control period can give along every axis of B, either way, m/s."""
        forces = np.array([x.force * np.array(x.direction) for x in self.craft.thrusters])
        either_way = np.maximum(forces, 0.0).sum(axis=0), np.maximum(-forces, 0.0).sum(axis=0)
        return float(np.min(either_way)) * self._period / self.craft.mass

    def __repr__(self) -> str:
        return f"<{self.name}: {type(self.task).__name__} for {self.craft.name}>"

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._rounding.reset(count)
        self._step = 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; uses the state and the goal's notes, not the observation."""
        size = len(observation)
        state, goal = map_leaves(lambda x: np.broadcast_to(x, size), (state, goal))
        now = self._step * self._period
        self._step += 1
        change, burns = self.velocity_change(state, goal, now)
        return self._commands(state, change, burns)

    @abstractmethod
    def velocity_change(self, state: Any, goal: Any, now: float) -> tuple[np.ndarray, np.ndarray]:
        """Change of velocity in W, (N, 3) m/s, that this control period is to give, and whether craft burn, (N,).

        Args:
            state: states of arrays (N,).
            goal: goals of arrays (N,).
            now: time since the reset, s.
        """

    def _commands(self, state: Any, change: np.ndarray, burns: np.ndarray) -> np.ndarray:
        """Commands (N, thrusters) for changes of velocity in W, (N, 3) m/s; craft that do not burn keep shut."""
        push = Vec3(*(change * (self.craft.mass / self._period)).T)
        axes_of_world = Quat(1.0, 0.0, 0.0, 0.0)
        force = np.array(leaves(state.attitude.to(axes_of_world).rotate(push)))
        wrench = np.pad(force.T, ((0, 0), (0, self.craft.degrees_of_freedom - 3)))
        return self._rounding.round(wrench, ~burns, state.stores)


def closed_ellipse(mean_motion: float, x: Any, y: Any) -> tuple[Any, Any]:
    """Velocity along x and y, m/s, of the closed ellipse around the origin through a point of the orbit's plane, m.

    On it a craft drifts nowhere: v_x = n y / 2 and v_y = -2 n x (Clohessy and Wiltshire, 1960).
    """
    return 0.5 * mean_motion * y, -2.0 * mean_motion * x


def weaker(change: np.ndarray, most: float) -> tuple[np.ndarray, np.ndarray]:
    """Changes of velocity (N, 3), weaker in the same direction where a component is larger than most, m/s.

    Returns:
        The changes, and the largest component of each before, (N, 1) m/s.
    """
    largest = np.abs(change).max(axis=1, keepdims=True)
    return change * np.minimum(1.0, most / np.maximum(largest, 1e-12)), largest


class SafePlan(NamedTuple):
    """The plan that a search for safe coasts has chosen."""

    row: int
    """Number of the plan."""
    distance: float
    """Distance from the target that its coasts keep, m."""


class PassivelySafeGuidance(VelocityGuidance[Mission]):
    """Base of guidance whose coasts of an orbit keep out of a zone around the target, whenever the thrusters shut.

    Plans have prices. In the order of these their coasts are computed, first of impulses and then of burns as they
    are flown (`rans_missions.passive_safety`).
    """

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

    def _is_safe(self, distance: Any) -> Any:
        """Whether a predicted flight whose coasts keep this distance, m, is safe."""
        return distance > self._radius + _CLEAR

    def _cheapest_safe(
        self,
        order: np.ndarray,
        batch: int,
        of_impulses: Callable[[np.ndarray], np.ndarray],
        of_flights: Callable[[np.ndarray], np.ndarray],
    ) -> SafePlan | None:
        """The cheapest plan whose predicted flight is safe; else that whose coasts keep the largest distance.

        Args:
            order: numbers of the plans, the cheapest first.
            batch: number of plans whose coasts are computed at once.
            of_impulses: whether the coasts of plans (K,) keep out of the zone if burns are impulses, (K,).
            of_flights: distances (K,) that the coasts of plans (K,) keep, of burns as they are flown.

        Returns:
            The plan; None if no plan would be safe with impulses.
        """
        best: SafePlan | None = None
        for begin in range(0, len(order), batch):
            rows = order[begin : begin + batch]
            rows = rows[of_impulses(rows)][:_PREDICTED]
            if not len(rows):
                continue
            distances = of_flights(rows)
            safe = self._is_safe(distances)
            if safe.any():
                first = int(np.argmax(safe))
                return SafePlan(int(rows[first]), float(distances[first]))
            farthest = int(np.argmax(distances))
            if best is None or distances[farthest] > best.distance:
                best = SafePlan(int(rows[farthest]), float(distances[farthest]))
        return best

    def _predicted_distance(
        self,
        starts: np.ndarray,
        law: Callable[[np.ndarray, float], np.ndarray],
        steps: int,
        end: Any,
        is_unsafe_start: bool,
    ) -> np.ndarray:
        """Distance (K,), m, that coasts of K flights keep, with constant thrust in every control period.

        Args:
            starts: states (K, 6) from which they begin.
            law: change of velocity in W, (K, 3) m/s, that states (K, 6) get at a time, s.
            steps: number of control periods of the prediction.
            end: time, s, or times (K,), at which the last coasts end.
            is_unsafe_start: whether the coast from the start itself enters the zone. Of flights that burn in the
                first control period it then does not count, nor do coasts from within it. Of others it does.
        """
        n, period = self.task.mean_motion, self._period
        count = len(starts)
        states = starts
        # Coasts since the last burn of each flight, and the instant at which they began.
        coasts = states
        since = np.zeros(count)
        pieces = []
        for step in range(steps):
            now = step * period
            change = law(states, now)
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
        pieces.append(single_coasts(coasts, end - since, np.arange(count)))
        return least_distances(n, joined(pieces), count)
