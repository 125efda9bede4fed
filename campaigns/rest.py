"""What agents do when they are there: how often valves move, whether commands repeat, what is wasted.

``python -m campaigns rest`` flies every agent that comes with RANS on 16,384 evaluation episodes in a perfect
world, on a GPU if there is one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, islice
from typing import Any

import numpy as np
import torch
from torch import Tensor
from tyro.conf import Positional

from campaigns.batch import Rows, study
from rans.episode import Setup
from rans.evaluation.fly.contestants import judged_separately
from rans.fast.flights import Flights
from rans.model.spacecraft import Spacecraft
from rans.policy.network import Network
from rans.pretrained import pretrained_names
from rans.scenario import EVALUATION_SEED
from rans.verdict import last_fifth


def last_commands(network: Network, setup: Setup, episodes: int, seed: int, device: str) -> Tensor:
    """Commands of the last fifth of an agent's flights, (T / 5, N, thrusters) bool."""
    flights = Flights(network, setup, device, generated=False)
    draws = flights.draws(seed, np.arange(episodes, dtype=np.int32))
    begin = setup.timing.episode_steps - last_fifth(setup.timing.episode_steps)
    return torch.stack(
        [
            torch.stack([torch.as_tensor(x) for x in outcome.command], dim=1) > 0
            for _, outcome in islice(flights.steps(draws), begin, None)
        ]
    )


def cycles(commands: Tensor) -> Tensor:
    """Length in steps of the cycle that each flight's commands (T, N, thrusters) repeat, (N,).

    0 where they do not repeat within half of T, where the same valves are open throughout, or none.
    """
    found = torch.zeros(commands.shape[1], dtype=torch.int64, device=commands.device)
    moves = (commands[1:] != commands[:-1]).flatten(2).any(dim=2).any(dim=0)
    for lag in range(len(commands) // 2, 1, -1):
        repeats = (commands[lag:] == commands[:-lag]).all(dim=2).all(dim=0)
        found = torch.where(repeats & moves, lag, found)
    return found


def opposite(craft: Spacecraft) -> list[tuple[int, int]]:
    """Pairs of thrusters whose wrenches cancel: open together they do nothing but spend."""
    wrenches = np.array(craft.wrench_map)
    close = 1e-9 * np.abs(wrenches).max()  # directions are given in decimals and normalised
    return [
        (i, j)
        for i, j in combinations(range(len(wrenches)), 2)
        if np.abs(wrenches[i] + wrenches[j]).max() < close
    ]


def said(commands: Tensor, craft: Spacecraft, period: float) -> dict[str, Any]:
    """Of commands (T, N, thrusters): duty in %, valve changes a second, waste and cycles in %."""
    found = cycles(commands)
    wasted = torch.zeros(commands.shape[:2], dtype=torch.bool, device=commands.device)
    for i, j in opposite(craft):
        wasted |= commands[..., i] & commands[..., j]
    pairs = zip(
        *(x.tolist() for x in torch.unique(found[found > 0], return_counts=True)), strict=True
    )
    changes = (commands[1:] != commands[:-1]).sum(dim=2).float().mean() / period
    return {
        "duty": 100.0 * float(commands.float().mean()),
        "changes": float(changes),
        "opposite": 100.0 * float(wasted.float().mean()),
        "cycles": 100.0 * float((found > 0).float().mean()),
        "lengths": {str(length): count for length, count in pairs},
    }


@dataclass(frozen=True)
class Rest:
    """Fly agents, and see what they do at rest."""

    agents: Positional[tuple[str, ...]] = ()
    """Run folders, or pretrained:NAME; none: all that come with RANS."""
    episodes: int = 16_384
    seed: int = EVALUATION_SEED

    def measured(self) -> dict[str, Any]:
        """What every agent does at rest.

        Raises:
            ConfigError: there is no such agent.
        """

        def measure(network: Network, setup: Setup, device: str) -> Rows:
            judged = setup._replace(task=setup.task.for_evaluation())
            commands = last_commands(network, judged, self.episodes, self.seed, device)
            return {"at rest": said(commands, setup.craft, setup.timing.control_period)}

        return {"agents": study(self.agents or tuple(_shipped()), measure)}


def cells(evidence: Any) -> Iterator[dict[str, Any]]:
    """Rows of the table, by agent."""
    for name, rows in evidence["agents"].items():
        found = rows["at rest"]
        steps = ", ".join(found["lengths"]) or "–"  # noqa: RUF001
        yield {**found, "agent": name.removeprefix("pretrained:"), "steps": steps}


def _shipped() -> Iterator[str]:
    for name in pretrained_names():
        yield from map(str, judged_separately(f"pretrained:{name}"))
