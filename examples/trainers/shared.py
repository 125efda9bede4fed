"""What every example shares: the environment, what its agents observe, and how they are judged."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Box
from gymnasium.vector.utils import batch_space
from torch import Tensor

import rans

N_ENVS = 128
N_STEPS = 64
Act = Callable[[Tensor], Any]
"""Commands (N, 8), 0 or 1, to observations (N, 7) in the body frame."""


def body_frame(rows: Tensor) -> Tensor:
    """Observations (N, 10) of go-to-pose in the plane as (N, 7): in the body frame, each column of a size of 1.

    The same motion then looks the same from every heading. `rans train` does so by itself.
    """
    cos, sin, v_x, v_y, spin, _, d_x, d_y, cos_left, sin_left = rows.unbind(1)
    velocity = [cos * v_x + sin * v_y, cos * v_y - sin * v_x]
    way = [cos * d_x + sin * d_y, cos * d_y - sin * d_x]
    columns = [*(3.0 * v for v in velocity), 3.0 * spin, *way, cos_left, sin_left]
    return torch.stack(columns, dim=1)


class Spacecraft(rans.SpacecraftVectorEnv):
    """Floating platforms on tensors, observed in the body frame, with rewards of about 0.1 a step."""

    def __init__(self, count: int = N_ENVS) -> None:
        super().__init__(count, "go-to-pose", 2)
        self.single_observation_space = Box(-np.inf, np.inf, (7,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, count)

    def reset(self, **options: Any) -> Any:
        """Observations and information."""
        rows, info = super().reset(**options)
        return body_frame(rows), info

    def step(self, actions: Any) -> Any:
        """Observations, rewards, terminations, truncations and information, which has ``final_obs``."""
        rows, reward, terminated, truncated, info = super().step(actions)
        info["final_obs"] = body_frame(info["final_obs"])
        return body_frame(rows), 0.1 * reward, terminated, truncated, info


def judged(
    act: Act, episodes: int = 1024, spacecraft: rans.Spacecraft | None = None
) -> dict[str, float]:
    """Success (%), settling time (s) and impulse (N s) of an agent, as `rans evaluate` prints them."""

    def policy(observation: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return np.asarray(act(body_frame(torch.as_tensor(observation))), dtype=np.float32)

    metrics = rans.load_agent(policy, "go-to-pose", spacecraft).evaluate(episodes=episodes)
    return {name: metrics[name].value for name in ("solved", "settling time", "impulse")}


def main(train: Callable[[int], Act], spacecraft: rans.Spacecraft | None = None) -> None:
    """Train by the command line's number of steps and print one row of the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--episodes", type=int, default=1024)
    given = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(0)
    begun, used = time.perf_counter(), time.process_time()
    act = train(given.steps)
    seconds, processor = time.perf_counter() - begun, time.process_time() - used
    found = judged(act, given.episodes, spacecraft)
    told = ", ".join(f"{name} {value:.4g}" for name, value in found.items())
    print(f"{given.steps} steps, {seconds:.1f} s ({processor:.1f} s of a core): {told}")
