"""RSL-RL's PPO on the batched environment: a Gaussian a valve, which is open where it is positive."""

from __future__ import annotations

from typing import Any

import torch
from rsl_rl.env import VecEnv
from rsl_rl.runners import OnPolicyRunner
from shared import N_ENVS, N_STEPS, Agent, Spacecraft, main
from tensordict import TensorDict

CONFIG: dict[str, Any] = {
    "num_steps_per_env": N_STEPS,
    "save_interval": 10_000,
    "obs_groups": {"actor": ["policy"], "critic": ["policy"]},
    "actor": {
        "class_name": "MLPModel",
        "hidden_dims": [64, 64],
        "activation": "tanh",
        "distribution_cfg": {"class_name": "GaussianDistribution", "init_std": 1.0},
    },
    "critic": {"class_name": "MLPModel", "hidden_dims": [64, 64], "activation": "tanh"},
    "algorithm": {
        "class_name": "PPO",
        "gamma": 0.98,
        "lam": 0.95,
        "learning_rate": 1e-3,
        "entropy_coef": 0.0,
        "num_learning_epochs": 4,
        "num_mini_batches": 4,
        "desired_kl": 0.016,
        "schedule": "adaptive",
    },
}


class Valves(VecEnv):
    """The glue."""

    def __init__(self, envs: Any) -> None:
        self.envs = envs
        self.num_envs = envs.num_envs
        self.device = envs.device
        self.cfg = {}
        self.num_actions = envs.single_action_space.shape[0]
        self.max_episode_length = envs.engine.timing.episode_steps
        self.episode_length_buf = torch.zeros(envs.num_envs, dtype=torch.long, device=envs.device)
        self.seen, _ = envs.reset(seed=0)

    def get_observations(self) -> TensorDict:
        """What is seen now."""
        return TensorDict({"policy": self.seen}, [self.num_envs])

    def step(
        self, actions: torch.Tensor
    ) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """Open where positive."""
        self.seen, reward, terminated, truncated, _ = self.envs.step(actions > 0)
        return self.get_observations(), reward, terminated | truncated, {"time_outs": truncated}


def train(steps: int) -> Agent:
    """An agent that was trained for so many steps."""
    runner = OnPolicyRunner(Valves(Spacecraft()), CONFIG)
    runner.learn(max(1, steps // (N_ENVS * N_STEPS)))
    policy = runner.alg.get_policy().as_onnx(verbose=False)
    return Agent(lambda rows: policy(rows) > 0, policy)


if __name__ == "__main__":
    main(train)
