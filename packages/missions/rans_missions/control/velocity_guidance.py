"""Base of guidance on an orbit that changes the velocity of a craft: the frame of each law."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from rans.extend import Drift, ModelBased, Vec3, map_leaves
from rans_missions.control.tracking import Tracker
from rans_missions.orbits.linear import carried
from rans_missions.orbits.reach import velocity_to_reach
from rans_missions.tasks.final_approach import FinalApproach
from rans_missions.tasks.inspect import Inspect
from rans_missions.tasks.orbital import OrbitalMission
from rans_missions.vectors import components

TRIM = 0.001
"""Error of velocity that is left alone, m/s: an orbit whose speed is off by it drifts by 18 m a turn."""
_BACK = 600.0
"""Time in which a craft returns to a planned flight, s: a tenth of an orbit, nearly straight."""

Mission = TypeVar("Mission", bound=OrbitalMission | Inspect | FinalApproach)


class VelocityGuidance(ModelBased, ABC, Generic[Mission]):
    """Base of controllers in space that change the velocity of a craft, whose law is `velocity_change`.

    In every control period the law gives a change of velocity in W. It is turned into the body frame, and rounded
    to what the thrusters can give; no torque is given.

    Args:
        craft: by name, TOML file or as such.
        task: a mission, by name or as such.
        timing: control period, and length of the episode; None: the task's.

    Raises:
        ConfigError: the task is no such mission, or motion changes along its orbit.
    """

    heeds_constraints: ClassVar[bool] = True
    mission: ClassVar[Any]
    """Class of the missions that the law flies."""
    purpose: ClassVar[str]
    """Beginning of the message for other tasks, such as "circumnavigation flies inspections"."""

    def _prepare(self) -> None:
        self.task: Mission = self.mission.expected(self._task, self.purpose)
        self._period = self._timing.control_period
        self._tracker = Tracker(self.craft, self._period)
        self._step = 0
        """Number of control periods since the reset."""

    @cached_property
    def _most(self) -> float:
        """Change of velocity that a control period can give along every axis of B, either way, m/s."""
        forces = self.craft.wrenches[:, :3]
        either_way = forces.clip(0.0).sum(axis=0), (-forces).clip(0.0).sum(axis=0)
        return float(np.min(either_way)) * self._period / self.craft.mass

    def reset(self, count: int) -> None:
        """See `rans.episode.flight.Controller`."""
        self._tracker.reset(count)
        self._step = 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.episode.flight.Controller`; uses the state and the goal's notes, not the observation."""
        size = len(observation)
        state, goal = map_leaves(lambda x: np.broadcast_to(x, size), (state, goal))
        now = self._step * self._period
        self._step += 1
        change, burns = self.velocity_change(state, goal, now)
        return self._tracker.commands(state, Vec3(*change.T), burns)

    @abstractmethod
    def velocity_change(self, state: Any, goal: Any, now: float) -> tuple[np.ndarray, np.ndarray]:
        """Change of velocity in W, (N, 3) m/s, that this control period is to give, and whether craft burn, (N,).

        Args:
            state: states of arrays (N,).
            goal: goals of arrays (N,).
            now: time since the reset, s.
        """


class PlannedBurns:
    """Planned burns of N craft; an error of the velocity of more than `TRIM` is corrected on the way.

    Args:
        drift: motion of a free point.
        period: control period, s.
        count: number N of craft.
        periods: number of control periods from any instant on in which burns may be planned.
    """

    def __init__(self, drift: Drift, period: float, count: int, periods: int) -> None:
        self._drift = drift
        self._period = period
        self._changes = np.zeros((count, periods, 3))
        self._middle = np.zeros((count, 6))
        """States expected in the middle of this control period before its burn."""

    def begin(
        self, rows: slice, starts: np.ndarray, periods: np.ndarray, changes: np.ndarray
    ) -> None:
        """Plan the flights of some craft from their states now.

        Args:
            rows: D of the craft.
            starts: states (D, 6), m and m/s in W.
            periods: control periods from now on that have a burn, (K,).
            changes: changes of velocity in W in them, (D, K, 3) m/s.
        """
        self._changes[rows] = 0.0
        self._changes[rows, periods] = changes
        self._middle[rows] = carried(self._drift, starts, 0.5 * self._period)

    def change(self, states: np.ndarray) -> np.ndarray:
        """Changes of velocity in W of this control period, (N, 3) m/s, from states (N, 6); the next one follows."""
        planned = self._changes[:, 0]
        away = carried(self._drift, states, 0.5 * self._period) - self._middle
        back = velocity_to_reach(self._drift, Vec3(*away[:, :3].T), Vec3(0.0, 0.0, 0.0), _BACK)
        missing = components(back, len(away)) - away[:, 3:]
        corrects = np.linalg.norm(missing, axis=1, keepdims=True) > TRIM
        self._changes = np.roll(self._changes, -1, axis=1)
        self._changes[:, -1] = 0.0
        burnt = self._middle + np.pad(planned, ((0, 0), (3, 0)))
        self._middle = carried(self._drift, burnt, self._period)
        return planned + np.where(corrects, missing, 0.0)
