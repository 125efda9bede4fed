"""A trained agent as a controller: what is in a run folder, ready to fly on any engine."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy

from rans.errors import ConfigError
from rans.fast.learn.run_folder import RunFolder
from rans.fast.policy import evaluate
from rans.files import first_line
from rans.flight import Controller
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.tasks import Task, observation_width


class Agent:
    """A policy that opens the thrusters it finds more likely open than shut.

    Args:
        policy: SB3 actor-critic with ``MultiDiscrete([2] * thrusters)`` actions.
        name: what to call it in tables.
    """

    def __init__(self, policy: ActorCriticPolicy, name: str) -> None:
        self.name = name
        self._policy = policy.set_training_mode(False) or policy

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`; an agent has no memory."""

    @torch.no_grad()
    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; looks at the observation only."""
        return evaluate(self._policy, torch.from_numpy(observation)).mode().numpy()


class LoadedRun(NamedTuple):
    """A controller and what it was made for: the agent of a run, or another contestant."""

    controller: Controller
    craft: Spacecraft
    task: Task
    """With the training's settings; judge it on ``task.for_evaluation()``."""
    timing: Timing


def load_agent(path: Path) -> LoadedRun:
    """The agent in a run folder.

    Raises:
        ConfigError: the folder holds no run, no policy yet, a damaged one, or one for another
            spacecraft.
    """
    run = RunFolder(path)
    config, craft = run.config(), run.spacecraft()
    if not run.policy_file.exists():
        raise ConfigError(f"{path} has no policy.zip yet: training was stopped before its first checkpoint.")
    try:
        policy = PPO.load(run.policy_file, device="cpu").policy
    except Exception as error:  # a damaged pickle raises anything
        raise ConfigError(f"{run.policy_file} is damaged: {first_line(error)}.") from error
    _check_fit(policy, craft, config.settings, run)
    return LoadedRun(Agent(policy, path.resolve().name), craft, config.settings, config.timing)


def _check_fit(policy: ActorCriticPolicy, craft: Spacecraft, task: Task, run: RunFolder) -> None:
    seen, open_or_shut = policy.observation_space.shape, policy.action_space.shape
    needed = ((observation_width(task, craft.dimension),), (len(craft.thrusters),))
    if (seen, open_or_shut) != needed:
        raise ConfigError(
            f"{run.policy_file} observes {seen} and commands {open_or_shut} thrusters, but "
            f"{run.spacecraft_file} needs {needed[0]} and {needed[1]}: they are of different runs.")
