"""Agents' flights in the fast engine, thousands side by side, and what became of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from rans.errors import ConfigError
from rans.evaluation.fly.agent import Agent
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.measure.statistics import share
from rans.fast.engine import Engine
from rans.fast.learn.network import Network
from rans.fast.learn.selection import likeliest
from rans.files import environment, write_json
from rans.flight import Setup
from rans.model.conditions import Conditions

Rows = dict[str, dict[str, Any]]
"""What is told of one agent, by what it was flown in."""


class Found(NamedTuple):
    """What became of N episodes, each (N,)."""

    held: np.ndarray
    """Within all tolerances at every step of the last fifth, in truth."""
    settled: np.ndarray
    """Time to enter them for good, s; infinite if never."""
    duty: np.ndarray
    """Share of open thrusters over the last fifth."""
    lost: np.ndarray
    """Failed by the task, as too far away or spinning too fast."""
    distance: np.ndarray
    """At the end, or last before it was lost, m."""
    speed: np.ndarray
    """The same, m/s."""
    spin: np.ndarray
    """The same, rad/s."""

    def said(self) -> dict[str, Any]:
        """Share held, %, with its 95 % interval, and the median settling time, s."""
        return {
            "held": {key: 100.0 * x for key, x in asdict(share(self.held)).items()},
            "settling time": float(np.median(self.settled)),
        }


@torch.no_grad()
def flown(
    network: Network, setup: Setup, conditions: Conditions, episodes: int, seed: int, device: str
) -> Found:
    """An agent's flights in the fast engine, which is told one step too many: at the last it begins anew.

    Kicks, which are spread over an episode, so come at other times than in its evaluation.
    """
    steps = setup.timing.episode_steps
    period = setup.timing.control_period
    engine = Engine(
        setup.craft,
        setup.task,
        episodes,
        replace(setup.timing, episode_steps=steps + 1),
        seed=seed,
        device=device,
        conditions=conditions.or_none,
    )
    observation = engine.observe()
    memory = network.blank(episodes)
    ended = torch.zeros(episodes, dtype=torch.bool, device=device)
    outside = torch.zeros(episodes, device=device)
    duty = torch.zeros(episodes, device=device)
    now = motion(engine)
    for t in range(steps):
        command, memory = likeliest(network, observation, memory)
        step = engine.step(command)
        observation = step.observation
        ended = ended | step.terminated
        outside = torch.where(step.reached & ~ended, outside, t + 1.0)
        now = torch.where(ended, now, motion(engine))
        if t >= steps - steps // 5:
            duty += command.mean(dim=1) / (steps // 5)
    settled = torch.where(outside < steps, (outside + 1.0) * period, torch.inf)
    return Found(
        *(x.cpu().numpy() for x in (outside <= steps - steps // 5, settled, duty, ended, *now))
    )


def motion(engine: Engine) -> Tensor:
    """Distance, speed and spin, (3, N)."""
    state = engine.state
    goal = engine.goal
    parts = [
        [x - y for x, y in zip(state.p.columns(), goal.p.columns(), strict=True)],
        state.v.columns(),
        state.spin(),
    ]
    return torch.stack(
        [torch.stack([torch.as_tensor(x) for x in part]).norm(dim=0) for part in parts]
    )


def loaded(name: str, device: str) -> tuple[Network, Setup]:
    """The network of a run folder or of ``pretrained:NAME``, and what it is judged in, without conditions.

    Raises:
        ConfigError: there is no such agent.
    """
    run = contestant(name)
    if not isinstance(run.controller, Agent):
        raise ConfigError(f"{name} is not an agent: name a run folder, or pretrained:NAME.")
    lone = run.controller.network
    network = Network.stacked(
        lone.architecture, [lone.member(0)], torch.device(device), torch.float32
    )
    return network, run.judged._replace(conditions=None)


def study(
    agents: Sequence[str],
    told: Callable[[Network, Setup, str], Rows],
    episodes: int,
    seed: int,
    output: Path,
    extra: dict[str, Rows] | None = None,
) -> dict[str, Rows]:
    """Write what is told of each agent and its setup, on a GPU if there is one, to a JSON file.

    Args:
        agents: run folders, or ``pretrained:NAME``.
        told: of a network, what it is judged in and a device, what is said.
        episodes: a row, for the file.
        seed: of the starts, for the file.
        output: the file.
        extra: what is said of others.
    """
    device = "cuda" if torch.cuda.is_available() else "cpu"
    result = {name: told(*loaded(name, device), device) for name in agents} | (extra or {})
    write_json(
        output, {"episodes": episodes, "seed": seed, "agents": result, "environment": environment()}
    )
    return result
