"""Guidance in closed form for missions on an orbit: the change of velocity that the mission recommends."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rans.effectors.commands import per_velocity
from rans.errors import ConfigError
from rans.model.fields import Heading, Quat
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.optimal.control.regulator import ModelBased
from rans.scenario import scenario
from rans.tasks.base import Task
from rans.tasks.orbital import OrbitalMission
from rans.tasks.shapes import Ball, SpeedLimit


class MissionGuidance(ModelBased):
    """Gives the change of velocity that a mission on an orbit recommends, in every control period.

    >>> rans.MissionGuidance("afrl-deputy", "dock")
    <mission: Dock for afrl-deputy>

    The recommendation (`rans.tasks.orbital.OrbitalMission.recommended`) keeps below speed limits, goes around
    keep-out balls and makes burns later where that is cheaper. Agents with the head "guided" observe it, and
    begin their training as this controller.

    Args:
        craft: by name, TOML file or as such; it has one throttled or pulsed thruster either way along each axis.
        task: a mission on an orbit, by name or as such.
        timing: control period, and length of the episode.

    Raises:
        ConfigError: the task is no mission on an orbit or has other limits, such as a cone, or the craft has
            other thrusters.
    """

    name = "mission"
    heeds_constraints: ClassVar[bool] = True

    def __init__(
        self, craft: str | Path | Spacecraft, task: str | Task, timing: Timing | None = None
    ) -> None:
        super().__init__(craft, task, timing)
        self._mission = OrbitalMission.expected(
            self._task, "mission guidance flies missions on an orbit, such as dock and hold"
        )
        if not self.keeps_limits(self._mission):
            raise ConfigError(
                "mission guidance keeps speed limits and keep-out balls, but "
                f"{type(self._mission).__name__} has other limits; fly it with convex."
            )
        self._identity = Heading(0.0) if self._craft.dimension == 2 else Quat(1.0, 0.0, 0.0, 0.0)
        self._levers = np.array(per_velocity(self._craft, self._timing.control_period))

    @staticmethod
    def keeps_limits(task: OrbitalMission) -> bool:
        """Whether all limits of a mission are of the kinds that its recommendation keeps."""
        goal = scenario(task, task.dimensions[0], seed=0, episode=0).goal
        return all(isinstance(limit, Ball | SpeedLimit) for limit in task.limits(goal).values())

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`; nothing is remembered."""

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; reads the state and the times in the goal's notes."""
        arrival = self._mission.arrival(goal)
        change = self._mission.recommended(state, goal, arrival) - state.v
        in_body = state.attitude.to(self._identity).rotate(change)
        shape = np.shape(state.p.x)
        columns = [np.broadcast_to(np.asarray(x, float), shape) for x in in_body.columns()]
        return np.clip(np.stack(columns, axis=1) @ self._levers.T, 0.0, 1.0)
