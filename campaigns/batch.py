"""Agents' flights in the fast engine, thousands side by side, and what became of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from rans.base.errors import ConfigError
from rans.episode.step import Episode, Setup
from rans.episode.verdict import FlightAccumulator
from rans.evaluation.fly.agent import Agent
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.measure.statistics import share
from rans.fast.flights import Flights
from rans.policy.network import Network
from rans.randomization.conditions import Conditions

Rows = dict[str, dict[str, Any]]
"""Results of one agent, by the conditions it was flown in."""


class Found(NamedTuple):
    """What became of N episodes, each (N,)."""

    held: np.ndarray
    """Whether the goal was held (`rans.episode.verdict`)."""
    settled: np.ndarray
    """Time at which the flight settled, s; infinite if it did not."""
    lost: np.ndarray
    """Whether the flight failed, as too far away or spinning too fast."""
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


def flown(
    network: Network, setup: Setup, conditions: Conditions, episodes: int, seed: int, device: str
) -> Found:
    """What became of an agent's flights in the fast engine."""
    flights = Flights(
        network, setup._replace(conditions=conditions.or_none), device, generated=False
    )
    verdict = None
    now = torch.zeros(3, episodes, device=device)
    with np.errstate(all="ignore"):
        numbers = np.arange(episodes, dtype=np.int32)
        for episode, outcome in flights.steps(flights.draws(seed, numbers)):
            if verdict is None:
                verdict = FlightAccumulator.begin(flights.world, episode)
                now = motion(episode)
            verdict = verdict.after(flights.world, outcome)
            now = torch.where(torch.as_tensor(verdict.running), motion(outcome.episode), now)
    assert verdict is not None, "an episode has at least one step"
    solved, settled, failed = (
        torch.as_tensor(x).cpu().numpy() for x in (verdict.solved, verdict.settled, verdict.failed)
    )
    times = np.where(solved, settled * setup.timing.control_period, np.inf)
    return Found(solved, times, failed, *now.cpu().numpy())


def motion(episode: Episode) -> Tensor:
    """Distance from the goal, speed and spin, (3, N)."""
    state = episode.state
    goal = episode.goal
    parts = [
        [x - y for x, y in zip(state.p.columns(), goal.p.columns(), strict=True)],
        state.v.columns(),
        state.spin(),
    ]
    # At the start of an episode a component may be one number for all.
    norms = [
        torch.stack(torch.broadcast_tensors(*map(torch.as_tensor, part))).norm(dim=0)
        for part in parts
    ]
    return torch.stack(torch.broadcast_tensors(*norms))


def loaded(name: str, device: str) -> tuple[Network, Setup]:
    """The network of a run folder or of ``pretrained:NAME``, and what it is judged in, without conditions.

    Raises:
        ConfigError: there is no such agent.
    """
    run = contestant(name)
    if not isinstance(run.controller, Agent):
        raise ConfigError(f"{name} is not an agent: name a run folder, or pretrained:NAME.")
    lone = run.network
    network = Network.copied(lone.architecture, lone.weights(), torch.device(device), torch.float32)
    return network, run.judged._replace(conditions=None)


def study(agents: Sequence[str], measure: Callable[[Network, Setup, str], Rows]) -> dict[str, Rows]:
    """Results of each agent in its setup, computed on a GPU if there is one.

    Args:
        agents: run folders, or ``pretrained:NAME``.
        measure: function of an agent's network, the setup it is judged in and the device of torch.
    """
    device = "cuda" if torch.cuda.is_available() else "cpu"
    return {name: measure(*loaded(name, device), device) for name in agents}


def printed(evidence: Any) -> list[dict[str, Any]]:
    """Rows for the terminal: agent, conditions and results; ratios to bounds are None where there is no bound."""
    none = {"over least": None, "over certified": None}
    return [
        {**none, "agent": agent, "row": row, **result}
        for agent, rows in evidence["agents"].items()
        for row, result in rows.items()
    ]
