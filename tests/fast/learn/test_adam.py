"""The optimiser against torch's own, with torch's own clipping."""

from __future__ import annotations

import torch
from torch import Tensor

from rans.fast.distributed import ALONE
from rans.fast.learn.adam import EPSILON, Adam
from rans.fast.learn.policy_file import moments
from rans.policy.architecture import Architecture
from rans.policy.network import Network
from rans.tasks import GoToPose
from rans.tasks.derived import layout

GIVEN = Architecture(layout(GoToPose(), 2), 2, (5, 3))
RATES = torch.tensor([1e-2, 3e-3], dtype=torch.float64)
NORMS = torch.tensor([0.5, 1e3], dtype=torch.float64)
"""The first member's gradients are longer, the second's shorter."""


def made(*seeds: int) -> Network:
    return Network.stacked(
        GIVEN, [GIVEN.initial(seed, 0.3)[0] for seed in seeds], torch.device("cpu"), torch.float64
    )


def loss(weights: list[Tensor], step: int) -> Tensor:
    """Anything whose gradient differs from weight to weight and from step to step."""
    return torch.stack([(x * (n + 1) + step).sin().sum() for n, x in enumerate(weights)]).sum()


def learnt(network: Network) -> list[Tensor]:
    return [network.tensors[name] for name in network.learnt]


def descend(adam: Adam, network: Network, step: int, norms: Tensor = NORMS) -> Tensor:
    return adam.descend(loss(learnt(network), step), norms, ALONE)


def test_every_member_steps_as_with_torchs_adam() -> None:
    network = made(1, 2)
    copies = [[x.detach().clone().requires_grad_() for x in learnt(made(seed))] for seed in (1, 2)]
    theirs = [
        torch.optim.Adam(copy, float(rate), eps=EPSILON)
        for copy, rate in zip(copies, RATES, strict=True)
    ]
    adam = Adam(network, RATES)
    for step in range(4):
        found = descend(adam, network, step)
        for k, (copy, optimizer) in enumerate(zip(copies, theirs, strict=True)):
            optimizer.zero_grad()
            loss(copy, step).backward()
            norm = torch.nn.utils.clip_grad_norm_(copy, float(NORMS[k]))
            optimizer.step()
            assert (norm > NORMS[k]) == (k == 0)
            torch.testing.assert_close(found[k], norm, rtol=1e-12, atol=0)
            for x, y in zip(learnt(network), copy, strict=True):
                # Four steps of at most 1e-2 in float64, with the operations in another order.
                torch.testing.assert_close(x[k], y, rtol=0, atol=1e-14)
    for k, optimizer in enumerate(theirs):
        kept = optimizer.state_dict()["state"]
        for place, memory in moments(adam, k).items():
            assert memory["step"] == kept[place]["step"] == 4
            for name in ("exp_avg", "exp_avg_sq"):
                torch.testing.assert_close(memory[name], kept[place][name], rtol=1e-12, atol=1e-16)
