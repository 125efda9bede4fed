"""PettingZoo's `ParallelEnv` of a team (``pip install pettingzoo``)."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any, ClassVar

import numpy as np
import torch
from gymnasium import spaces

from rans import load_spacecraft
from rans.episode.environment import within
from rans.extend import Engine, action_space, observation_space
from rans_missions.team.task import InspectTeam

# By name: types are checked also where it is not installed.
ParallelEnv: Any = import_module("pettingzoo").ParallelEnv


class TeamEnv(ParallelEnv):
    """One team of deputies that inspect a target together.

    Agents are "deputy_0" and so on, all of one team end in the same step, and rewards, observations and actions are
    those of the `Engine` (`InspectTeam`). The info of the last step says whether the team succeeded ("is_success").

    Args:
        task: the inspection.
        spacecraft: name of the deputies' spacecraft, or its TOML file.
    """

    metadata: ClassVar[dict[str, Any]] = {"name": "inspect_team_v0", "is_parallelizable": True}
    render_mode = None

    def __init__(self, task: InspectTeam | None = None, spacecraft: str = "afrl-deputy") -> None:
        self._task = InspectTeam() if task is None else task
        self._craft = load_spacecraft(spacecraft)
        # Generated programs of float32 step rows that do not depend on one another.
        count = self._task.deputies
        self._engine = Engine(self._craft, self._task, count, dtype=torch.float64)
        self.possible_agents = [f"deputy_{k}" for k in range(count)]
        self.agents: list[str] = []

    @cache  # noqa: B019 -- PettingZoo asks for the same object every time
    def observation_space(self, agent: str) -> spaces.Box:
        """Bounds of the observation of each deputy."""
        return observation_space(self._task, self._craft.dimension)

    @cache  # noqa: B019
    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Commands of each deputy's thrusters."""
        return action_space(self._craft)

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, dict[str, Any]]]:
        """Begin an episode: the first of a seed, or the next one."""
        self.agents = [*self.possible_agents]
        observations = self._observed(self._engine.reset(seed))
        return observations, {agent: {} for agent in self.agents}

    def step(
        self, actions: dict[str, np.ndarray]
    ) -> tuple[
        dict[str, np.ndarray],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Hold the commands of all deputies for a control period.

        Raises:
            ConfigError: a command is out of range.
        """
        action = np.array([actions[agent] for agent in self.agents], dtype=np.float64)
        step = self._engine.step(torch.from_numpy(action))
        ended = bool((step.terminated | step.truncated).any())
        observations = self._observed(step.final_observation if ended else step.observation)

        def each(values: torch.Tensor) -> dict[str, Any]:
            return dict(zip(self.agents, values.tolist(), strict=True))

        results = each(step.reward), each(step.terminated), each(step.truncated)
        infos = {
            agent: {"is_success": won} if ended else {} for agent, won in each(step.success).items()
        }
        if ended:
            self.agents = []
        return observations, *results, infos

    def _observed(self, rows: torch.Tensor) -> dict[str, np.ndarray]:
        """Observation of each deputy."""
        space = self.observation_space(self.possible_agents[0])
        observations = within(space, rows.to(torch.float32).numpy())
        return {agent: row.copy() for agent, row in zip(self.agents, observations, strict=True)}
