"""rl_games' PPO on the batched environment: a choice of two a valve."""

from __future__ import annotations

from typing import Any

import torch
from gymnasium.spaces import Discrete, Tuple
from rl_games.common import env_configurations, vecenv
from rl_games.torch_runner import Runner
from shared import N_ENVS, N_STEPS, Act, Spacecraft, main


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


def config(steps: int) -> dict[str, Any]:
    """As rl_games reads it from YAML."""
    return {
        "params": {
            "seed": 0,
            "algo": {"name": "a2c_discrete"},
            "model": {"name": "multi_discrete_a2c"},
            "network": {
                "name": "actor_critic",
                "separate": False,
                "space": {"multi_discrete": {}},
                "mlp": {
                    "units": [64, 64],
                    "activation": "tanh",
                    "initializer": {"name": "default"},
                },
            },
            "config": {
                "name": "rans",
                "env_name": "rans",
                "device": "cpu",
                "device_name": "cpu",
                "num_actors": N_ENVS,
                "horizon_length": N_STEPS,
                "minibatch_size": 2048,
                "mini_epochs": 4,
                "gamma": 0.98,
                "tau": 0.95,
                "learning_rate": 1e-3,
                "lr_schedule": "adaptive",
                "kl_threshold": 0.016,
                "e_clip": 0.2,
                "clip_value": True,
                "critic_coef": 1.0,
                "entropy_coef": 0.0,
                "grad_norm": 1.0,
                "ppo": True,
                "truncate_grads": True,
                "normalize_input": True,
                "normalize_value": True,
                "value_bootstrap": True,
                "normalize_advantage": True,
                "reward_shaper": {"scale_value": 1.0},
                "score_to_win": 1e9,
                "max_epochs": max(1, steps // (N_ENVS * N_STEPS)),
                "save_best_after": 10**9,
                "save_frequency": 0,
                "torch_compile": False,
            },
        }
    }


def train(steps: int) -> Act:
    """The likeliest commands of an agent that was trained for so many steps."""
    vecenv.register("rans", lambda name, actors, **others: Valves(name, actors, **others))
    env_configurations.register("rans", {"vecenv_type": "rans", "env_creator": None})
    runner = Runner()
    runner.load(config(steps))
    torch.set_num_threads(1)  # rl_games asks for more, which crowded cores are slower with
    agent = runner.algo_factory.create("a2c_discrete", base_name="rans", params=runner.params)
    agent.train()
    agent.set_eval()

    def act(rows: torch.Tensor) -> torch.Tensor:
        choices = agent.get_action_values({"obs": rows})["logits"]
        return torch.stack([choice.argmax(1) for choice in choices], dim=1)

    return act


if __name__ == "__main__":
    main(train)
