"""Stable-Baselines3 and sb3-contrib: PPO, A2C and TRPO on valves, SAC and TD3 on throttles, DQN on 256 choices.

`python sb3_agents.py PPO --steps 1000000`.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import stable_baselines3
import torch
from shared import N_ENVS, N_STEPS, Act, body_frame, main
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

import rans
from rans.fast.envs.discrete import DiscreteThrusters

PPO = {"n_steps": N_STEPS, "batch_size": 2048, "n_epochs": 4, "learning_rate": 1e-3}
OFF_POLICY = {"train_freq": 1, "gradient_steps": 4, "batch_size": 256, "learning_starts": 4096}
SETTINGS: dict[str, dict[str, Any]] = {
    "PPO": {**PPO, "gae_lambda": 0.95, "max_grad_norm": 1.0},
    "A2C": {"n_steps": 16, "learning_rate": 1e-3},
    "TRPO": {"n_steps": N_STEPS, "batch_size": 2048, "target_kl": 0.016},
    "SAC": OFF_POLICY,
    "TD3": OFF_POLICY,
    "DQN": {"train_freq": 1, "gradient_steps": 1, "learning_starts": 4096},
}
ALGORITHM = sys.argv.pop(1) if len(sys.argv) > 1 and sys.argv[1] in SETTINGS else "PPO"
CRAFT = rans.load_spacecraft("floating-platform")
if ALGORITHM in ("SAC", "TD3"):
    CRAFT = replace(CRAFT, actuators=rans.Throttle())


class BodyFrame(VecEnvWrapper):
    """The glue: what `shared.Spacecraft` does, for arrays."""

    def __init__(self, envs: VecEnv) -> None:
        space = gymnasium.spaces.Box(-np.inf, np.inf, (7,), np.float32)
        super().__init__(envs, observation_space=space)

    def reset(self) -> Any:
        """Observations."""
        return body_frame(torch.from_numpy(self.venv.reset())).numpy()

    def step_wait(self) -> Any:
        """Observations, rewards, ends, information."""
        rows, reward, done, infos = self.venv.step_wait()
        for k in np.flatnonzero(done):
            last = torch.from_numpy(infos[k]["terminal_observation"])
            infos[k]["terminal_observation"] = body_frame(last[None])[0].numpy()
        return body_frame(torch.from_numpy(rows)).numpy(), 0.1 * reward, done, infos


def environment() -> VecEnv:
    """Valves, throttles, or one choice of 256."""
    if ALGORITHM == "DQN":
        return make_vec_env(
            lambda: DiscreteThrusters(gymnasium.make("rans/GoToPose2D-v0")), n_envs=8
        )
    if ALGORITHM in ("SAC", "TD3"):
        return rans.SB3VecEnv(rans.Engine(CRAFT, "go-to-pose", num_envs=16))
    return rans.SB3VecEnv(rans.Engine(CRAFT, "go-to-pose", num_envs=N_ENVS))


def train(steps: int) -> Act:
    """The likeliest commands of an agent that was trained for so many steps."""
    library: Any = stable_baselines3
    if ALGORITHM == "TRPO":
        import sb3_contrib as library
    envs = BodyFrame(environment())
    algorithm = getattr(library, ALGORITHM)
    model = algorithm("MlpPolicy", envs, gamma=0.98, seed=0, device="cpu", **SETTINGS[ALGORITHM])
    model.learn(steps)

    def act(rows: torch.Tensor) -> np.ndarray:
        answer, _ = model.predict(rows.numpy(), deterministic=True)
        if ALGORITHM == "DQN":
            answer = answer[:, None] >> np.arange(8) & 1
        return answer

    return act


if __name__ == "__main__":
    main(train, CRAFT)
