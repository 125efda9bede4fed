"""Base of guidance on an orbit that changes the velocity of a craft: the frame of each law."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from rans.extend import ModelBased, Spacecraft, Task, Timing, Vec3, map_leaves
from rans_missions.control.tracking import Tracker
from rans_missions.tasks.final_approach import FinalApproach
from rans_missions.tasks.inspect import Inspect
from rans_missions.tasks.orbital import OrbitalMission

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

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None = None,
    ) -> None:
        super().__init__(craft, task, timing)
        self.task: Mission = self.mission.expected(self._task, self.purpose)
        self._period = self._timing.control_period
        self._tracker = Tracker(self.craft, self._period)
        self._step = 0
        """Number of control periods since the reset."""

    @cached_property
    def _most(self) -> float:
        """Change of velocity that a control period can give along every axis of B, either way, m/s."""
        forces = np.array([x.force * np.array(x.direction) for x in self.craft.thrusters])
        either_way = np.maximum(forces, 0.0).sum(axis=0), np.maximum(-forces, 0.0).sum(axis=0)
        return float(np.min(either_way)) * self._period / self.craft.mass

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._tracker.reset(count)
        self._step = 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; uses the state and the goal's notes, not the observation."""
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
