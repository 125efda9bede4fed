"""The optimiser against torch's own, with torch's own clipping."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from rans.fast.distributed import ALONE
from rans.fast.learn.adam import EPSILON, Adam
from rans.policy.architecture import Architecture
from rans.policy.network import Network
from rans.tasks import GoToPose
from rans.tasks.derived import layout

GIVEN = Architecture(layout(GoToPose(), 2), 2, (5, 3))
RATE = 1e-2


def made() -> Network:
    return Network.copied(GIVEN, GIVEN.initial(1, 0.3)[0], torch.device("cpu"), torch.float64)


def loss(weights: list[Tensor], step: int) -> Tensor:
    """Anything whose gradient differs from weight to weight and from step to step."""
    return torch.stack([(x * (n + 1) + step).sin().sum() for n, x in enumerate(weights)]).sum()


def learnt(network: Network) -> list[Tensor]:
    return [network.tensors[name] for name in network.learnt]


@pytest.mark.parametrize(("bound", "is_clipped"), [(0.5, True), (1e3, False)])
def test_steps_are_those_of_torchs_adam(bound: float, is_clipped: bool) -> None:
    network = made()
    copy = [x.detach().clone().requires_grad_() for x in learnt(made())]
    theirs = torch.optim.Adam(copy, RATE, eps=EPSILON)
    adam = Adam(network, RATE)
    for step in range(4):
        found = adam.descend(loss(learnt(network), step), bound, ALONE)
        theirs.zero_grad()
        loss(copy, step).backward()
        norm = torch.nn.utils.clip_grad_norm_(copy, bound)
        theirs.step()
        assert (norm > bound) == is_clipped
        torch.testing.assert_close(found, norm, rtol=1e-12, atol=0)
        for x, y in zip(learnt(network), copy, strict=True):
            # Four steps of at most 1e-2 in float64, with the operations in another order.
            torch.testing.assert_close(x, y, rtol=0, atol=1e-14)
    kept = theirs.state_dict()["state"]
    assert adam.steps == 4
    for name, moments in zip(("exp_avg", "exp_avg_sq"), adam.moments, strict=True):
        for place, memory in enumerate(moments):
            torch.testing.assert_close(memory, kept[place][name], rtol=1e-12, atol=1e-16)
