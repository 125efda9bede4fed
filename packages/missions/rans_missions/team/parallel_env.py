"""PettingZoo's `ParallelEnv` of a team (``pip install pettingzoo``)."""

from __future__ import annotations

from importlib import import_module
from typing import Any, ClassVar

import numpy as np
import torch
from gymnasium import spaces
from gymnasium.error import ResetNeeded

from rans import Engine, load_spacecraft
from rans.base.inputs import array
from rans.episode.environment import within
from rans.extend import ConfigError, action_space, brief, observation_space
from rans.fast.envs.actions import Actions
from rans_missions.team.task import InspectTeam

# By name: types are checked also where it is not installed.
ParallelEnv: Any = import_module("pettingzoo").ParallelEnv


class TeamEnv(ParallelEnv):
    """One team of deputies that inspect a target together.

    Agents are "deputy_0" and so on, all of one team end in the same step, and rewards, observations and actions are
    those of the `Engine` (`InspectTeam`). Each info says whether the team has succeeded ("is_success").

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
        seed = int(np.random.default_rng().integers(2**63))
        self._engine = Engine(self._craft, self._task, count, seed=seed, dtype=torch.float64)
        self._actions = Actions(self._engine)
        self.possible_agents = [f"deputy_{k}" for k in range(count)]
        self.agents: list[str] = []
        # Some libraries read these dicts, others call the methods.
        observed = observation_space(self._task, self._craft.dimension)
        commanded = action_space(self._craft)
        self.observation_spaces = dict.fromkeys(self.possible_agents, observed)
        self.action_spaces = dict.fromkeys(self.possible_agents, commanded)

    def observation_space(self, agent: str) -> spaces.Box:
        """Bounds of the observation of each deputy."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Commands of each deputy's thrusters."""
        return self.action_spaces[agent]

    def state(self) -> np.ndarray:
        """Observations of all deputies one after the other, for centralised critics."""
        return np.concatenate([*self._observed(self._engine.observe()).values()])

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, dict[str, Any]]]:
        """Begin an episode: the first of a seed, or the next one, at first of a random seed."""
        observations = self._observed(self._engine.reset(seed))
        self.agents = [*self.possible_agents]
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
            ConfigError: a command is out of range, or those of a deputy are missing.
            gymnasium.error.ResetNeeded: no episode is running.
        """
        if not self.agents:
            raise ResetNeeded("call reset() before step(), and after the end of an episode.")
        if {*actions} != {*self.agents}:
            raise ConfigError(
                f"a step takes an action of each of {', '.join(self.agents)}, got {brief([*actions])}."
            )
        rows = [array("actions", actions[agent]) for agent in self.agents]
        step = self._engine.step(self._actions.checked(array("actions", rows)))
        ended = bool((step.terminated | step.truncated).any())
        observations = self._observed(step.final_observation if ended else step.observation)

        def each(values: torch.Tensor) -> dict[str, Any]:
            return dict(zip(self.agents, values.tolist(), strict=True))

        results = each(step.reward), each(step.terminated), each(step.truncated)
        infos = {agent: {"is_success": won} for agent, won in each(step.at_goal).items()}
        if ended:
            self.agents = []
        return observations, *results, infos

    def _observed(self, rows: torch.Tensor) -> dict[str, np.ndarray]:
        """Observation of each deputy."""
        space = self.observation_space(self.possible_agents[0])
        observations = within(space, rows.to(torch.float32).numpy())
        return {
            agent: row.copy() for agent, row in zip(self.possible_agents, observations, strict=True)
        }
