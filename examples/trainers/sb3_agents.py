"""Stable-Baselines3 and sb3-contrib: PPO, A2C and TRPO on valves, SAC and TD3 on throttles, DQN on 27 choices.

`python sb3_agents.py PPO --steps 1000000`.
"""

from __future__ import annotations

import itertools
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import stable_baselines3
import torch
from shared import N_ENVS, N_STEPS, Agent, body_frame, main
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

import rans

PPO = {"n_steps": N_STEPS, "batch_size": 2048, "n_epochs": 4, "learning_rate": 1e-3}
OFF_POLICY = {
    "learning_rate": 1e-3,
    "batch_size": 256,
    "train_freq": 1,
    "gradient_steps": 4,
    "learning_starts": 16_384,
    "policy_kwargs": {"net_arch": [64, 64]},
}
SETTINGS: dict[str, dict[str, Any]] = {
    "PPO": {**PPO, "gae_lambda": 0.95, "max_grad_norm": 1.0},
    "A2C": {"n_steps": 16, "learning_rate": 1e-3},
    "TRPO": {"n_steps": N_STEPS, "batch_size": 2048, "target_kl": 0.016},
    "SAC": {**OFF_POLICY, "ent_coef": "auto_0.02"},
    "TD3": {
        **OFF_POLICY,
        "gradient_steps": 16,
        "action_noise": NormalActionNoise(np.zeros(8), 0.3 * np.ones(8)),
    },
    "DQN": {
        **OFF_POLICY,
        "learning_rate": lambda left: 2e-5 + 9.8e-4 * left,  # of the steps, from 1 to 0
        "batch_size": 512,
        "gradient_steps": 16,
        "n_steps": 3,
        "tau": 0.05,
        "target_update_interval": N_ENVS,
        "exploration_fraction": 0.3,
        "policy_kwargs": {"net_arch": [128, 128]},
    },
}
ALGORITHM = sys.argv.pop(1) if len(sys.argv) > 1 and sys.argv[1] in SETTINGS else "PPO"
THROTTLED = Path(__file__).with_name("throttled-platform.toml")
CRAFT = rans.load_spacecraft(THROTTLED if ALGORITHM in ("SAC", "TD3") else "floating-platform")


def valve_sets() -> torch.Tensor:
    """Commands (27, 8): the fewest open valves for every combination of signs of force x, force y and torque."""
    wrenches = np.array(CRAFT.wrench_map)
    found: dict[tuple[float, ...], tuple[int, ...]] = {}
    for command in sorted(itertools.product((0, 1), repeat=len(wrenches)), key=sum):
        signs = np.sign(np.round(command @ wrenches, 6))
        found.setdefault(tuple(signs), command)
    return torch.tensor(list(found.values()))


VALVES = valve_sets()


class BodyFrame(VecEnvWrapper):
    """The glue: what `shared.Spacecraft` does, for arrays."""

    def __init__(self, envs: VecEnv) -> None:
        space = gymnasium.spaces.Box(-np.inf, np.inf, (7,), np.float32)
        choices = envs.action_space
        if ALGORITHM == "DQN":
            choices = gymnasium.spaces.Discrete(len(VALVES))
        super().__init__(envs, observation_space=space, action_space=choices)

    def step_async(self, actions: np.ndarray) -> None:
        """Commands; a choice is a row of `VALVES`."""
        if ALGORITHM == "DQN":
            actions = VALVES.numpy()[actions]
        self.venv.step_async(actions)

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


def train(steps: int) -> Agent:
    """An agent that was trained for so many steps."""
    library: Any = stable_baselines3
    if ALGORITHM == "TRPO":
        import sb3_contrib as library
    envs = BodyFrame(rans.SB3VecEnv(rans.Engine(CRAFT, "go-to-pose", num_envs=N_ENVS)))
    algorithm = getattr(library, ALGORITHM)
    model = algorithm("MlpPolicy", envs, gamma=0.98, seed=0, device="cpu", **SETTINGS[ALGORITHM])
    model.learn(steps)

    def act(rows: torch.Tensor) -> torch.Tensor:
        answer = model.policy(rows, deterministic=True)
        if ALGORITHM in ("SAC", "TD3"):
            return (0.5 * (answer + 1.0)).clamp(0.0, 1.0)  # outputs are -1 to 1, but for rounding
        if ALGORITHM == "DQN":
            return VALVES[answer]
        return answer[0]

    return Agent(act, model.policy)


if __name__ == "__main__":
    main(train, CRAFT)
