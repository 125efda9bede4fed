"""rl_games' PPO on the batched environment: a choice of two a valve.

Its settings are in rl_games_ppo.yaml. After a training, `python rl_games_ppo.py --play FILE.pth` is rl_games' own
play mode.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import torch
import yaml
from gymnasium.spaces import Discrete, Tuple
from rl_games.common import env_configurations, vecenv
from rl_games.torch_runner import Runner
from shared import N_ENVS, N_STEPS, Agent, Spacecraft, main


class Valves(vecenv.IVecEnv):
    """The glue."""

    def __init__(self, _: str, num_actors: int, **__: Any) -> None:
        self.envs: Any = Spacecraft(num_actors)

    def reset(self) -> Any:
        """What is seen first."""
        return self.envs.reset(seed=0)[0]

    def step(self, actions: Any) -> Any:
        """Ends by time are told apart."""
        seen, reward, terminated, truncated, _ = self.envs.step(actions)
        return seen, reward, terminated | truncated, {"time_outs": truncated}

    def get_env_info(self) -> dict[str, Any]:
        """The spaces."""
        valves = [Discrete(2)] * self.envs.single_action_space.shape[0]
        return {
            "action_space": Tuple(valves),
            "observation_space": self.envs.single_observation_space,
        }


def runner(**changes: Any) -> Runner:
    """rl_games' runner, with the settings of rl_games_ppo.yaml."""
    vecenv.register("rans", lambda name, actors, **others: Valves(name, actors, **others))
    env_configurations.register("rans", {"vecenv_type": "rans", "env_creator": None})
    settings = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text())
    settings["params"]["config"].update(changes)
    made = Runner()
    made.load(settings)
    return made


def train(steps: int) -> Agent:
    """An agent that was trained for so many steps."""
    made = runner(max_epochs=max(1, steps // (N_ENVS * N_STEPS)))
    agent = made.algo_factory.create("a2c_discrete", base_name="rans", params=made.params)
    agent.train()
    actor = agent.model.eval().a2c_network
    columns = agent.model.running_mean_std
    mean = columns.running_mean.float()
    size = (columns.running_var.float() + columns.epsilon).sqrt()

    def act(rows: torch.Tensor) -> torch.Tensor:
        choices, *_ = actor({"obs": ((rows - mean) / size).clamp(-5.0, 5.0)})
        return torch.stack([choice.argmax(1) for choice in choices], dim=1)

    return Agent(act, actor)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--play"]:
        runner().run({"train": False, "play": True, "checkpoint": sys.argv[2]})
    else:
        main(train)
