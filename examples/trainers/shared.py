"""What every example shares: the environment, what its agents observe, and how they are judged."""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from gymnasium.spaces import Box
from gymnasium.vector.utils import batch_space
from torch import Tensor, nn

import rans

N_ENVS = 128
N_STEPS = 64


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


class Agent(nn.Module):
    """A trained agent: the commands (N, 8) to the environment's own observations (N, 10).

    Args:
        act: the likeliest commands to observations (N, 7) of `body_frame`.
        network: what `act` calls, so that a saved file has its weights.
    """

    def __init__(self, act: Callable[[Tensor], Tensor], network: nn.Module) -> None:
        super().__init__()
        self.act = act
        self.network = network

    def forward(self, observation: Tensor) -> Tensor:
        """Commands, float32."""
        return self.act(body_frame(observation)).float()

    def save(self, file: Path, what: str) -> None:
        """Write an ONNX file of any number of rows, which flies without the trainer, and a text about it."""
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore"
            )  # of the exporter, about itself and about trainers' checks
            torch.onnx.export(
                self.eval(),
                (torch.zeros(2, 10),),
                file,
                input_names=["observation"],
                output_names=["command"],
                dynamic_axes={"observation": {0: "N"}, "command": {0: "N"}},
                opset_version=17,
                dynamo=False,
            )
        model = onnx.load(file)
        model.doc_string = what
        onnx.save(model, file)


def judged(
    agent: Agent, episodes: int = 1024, spacecraft: rans.Spacecraft | None = None
) -> dict[str, float]:
    """Success (%), settling time (s) and impulse (N s) of an agent, as `rans evaluate` prints them."""
    metrics = rans.load_agent(agent, "go-to-pose", spacecraft).evaluate(episodes=episodes)
    return {name: metrics[name].value for name in ("solved", "settling time", "impulse")}


def main(train: Callable[[int], Agent], spacecraft: rans.Spacecraft | None = None) -> None:
    """Train by the command line's number of steps, print one row of the table, and save the agent if asked."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--episodes", type=int, default=1024)
    parser.add_argument("--save", type=Path, metavar="FILE", help="ONNX file of the agent")
    given = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(0)
    begun, used = time.perf_counter(), time.process_time()
    agent = train(given.steps)
    seconds, processor = time.perf_counter() - begun, time.process_time() - used
    found = judged(agent, given.episodes, spacecraft)
    figures = ", ".join(f"{name} {value:.4g}" for name, value in found.items())
    print(f"{given.steps} steps, {seconds:.1f} s ({processor:.1f} s of a core): {figures}")
    if given.save is not None:
        agent.save(given.save, f"{Path(sys.argv[0]).name}, {given.steps} steps: {figures}")
        print(f"Written to {given.save}")
