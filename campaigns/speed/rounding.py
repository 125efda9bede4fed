"""How many commands of a policy change when its products are of bfloat16, as in the kernel of flights.

``python -m campaigns.speed.rounding [AGENT ...]`` counts them over flights of shipped agents, whose commands
are those of float32; their states are what is seen.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor

from rans.evaluation.fly.agent import Agent
from rans.evaluation.fly.contestants import contestant, judged_separately
from rans.evaluation.fly.episodes import fly_episodes
from rans.policy.architecture import EXTRACTOR
from rans.policy.network import Network
from rans.terminal import Terminal

AGENTS = ("go-to-pose-2d", "go-to-pose-3d", "go-to-position-3d", "multi-task-2d")
PARTS = {"bf16": 1, "bf16x3": 2, "bf16x6": 3}
FLIGHTS = 256


class _Watched(Agent):
    """Keeps what it is shown."""

    def __init__(self, network: Network) -> None:
        super().__init__(network, "")
        self.seen: list[Tensor] = []

    def act(self, state: object, goal: object, observation: np.ndarray) -> np.ndarray:
        """See `Agent`."""
        network = self.network
        rows = torch.from_numpy(observation)
        self.seen.append(network.look(network.in_body(rows))[0])
        return super().act(state, goal, observation)


def differing(name: str, flights: int = FLIGHTS) -> Iterator[tuple[str, float, float]]:
    """Products, and the shares of commands and of decisions of all thrusters that differ from float32's."""
    run = contestant(judged_separately(f"pretrained:{name}")[0])
    assert isinstance(run.controller, Agent)
    network = run.controller.network
    agent = _Watched(network)
    fly_episodes(agent, run.judged, 0, flights)
    seen = torch.cat(agent.seen)
    exact = logits(network, seen, 0) > 0
    for products, parts in PARTS.items():
        other = (logits(network, seen, parts) > 0) != exact
        yield products, float(other.double().mean()), float(other.any(dim=1).double().mean())


def logits(network: Network, seen: Tensor, parts: int) -> Tensor:
    """Of a policy without a memory, by products of numbers in so many parts; 0: of float32."""
    given = network.architecture
    table = network.tensors
    scale = torch.rsqrt(table[f"{EXTRACTOR}variance"] + 1e-6)
    x = ((seen - table[f"{EXTRACTOR}mean"]) * scale).clamp(-given.clip, given.clip)
    if given.zoom:
        x = torch.cat((x, torch.tanh(seen * scale * given.zoom)), dim=1)
    for i in range(len(given.layers)):
        name = f"{EXTRACTOR}trunk.{2 * i}"
        x = given.activation_module()(
            _times(x, table[f"{name}.weight"], parts) + table[f"{name}.bias"]
        )
    weight = table["action_net.weight"]
    bias = table["action_net.bias"]
    return _times(x, weight[1::2] - weight[0::2], parts) + bias[1::2] - bias[0::2]


def _times(x: Tensor, weight: Tensor, parts: int) -> Tensor:
    if not parts:
        return x @ weight.T
    rows = _parts(x, parts)
    columns = _parts(weight, parts)
    return sum(
        (rows[i] @ columns[j].T for i in range(parts) for j in range(parts - i)),
        start=x.new_zeros(()),
    )


def _parts(x: Tensor, count: int) -> list[Tensor]:
    """Numbers of bfloat16 whose sum is nearest to x."""
    found = []
    for _ in range(count):
        found.append(x.bfloat16().float())
        x = x - found[-1]
    return found


if __name__ == "__main__":
    rows = [
        (name, products, f"{commands:.1e}", f"{decisions:.1e}")
        for name in sys.argv[1:] or AGENTS
        for products, commands, decisions in differing(name)
    ]
    Terminal().show(
        f"Commands that differ from float32's, over {FLIGHTS} flights",
        ("agent", "products", "commands", "decisions"),
        rows,
    )
