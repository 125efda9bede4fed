"""Gradients without autograd on a GPU: as good as torch's of bfloat16."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from rans.fast.engine import Engine
from rans.fast.learn.beginning import begin, set_precision
from rans.fast.learn.config import MemorySettings, PPOSettings
from rans.fast.learn.ppo import PPOLearner, losses
from rans.fast.learn.rollout import Batch, minibatches
from rans.tasks import GoToPose
from tests.support.engines import FLYER, PLATFORM
from tests.support.training import settings_with

pytestmark = [
    pytest.mark.gpu,
    pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device"),
    pytest.mark.filterwarnings("ignore:.*torch.jit.script_method:DeprecationWarning"),
]  # torch's own
SETTINGS = PPOSettings(
    n_envs=4096,
    n_steps=16,
    batch_size=16384,
    layers=(128, 128),
    matmul="bf16",
    reward_scale=1.0,
)


def by_autograd(learner: PPOLearner, part: Batch, bf16: bool) -> tuple[Tensor, list[Tensor]]:
    """Losses and gradients by weight, in float32 or with hidden layers of bfloat16."""
    network = learner.network
    given = learner.network.architecture
    set_precision("bf16" if bf16 else "float32", part.columns.device)
    network.architecture = replace(given, bf16=bf16)
    found = losses(network, part, learner.settings)
    gradients = torch.autograd.grad(found.loss, [network.tensors[name] for name in network.learnt])
    network.architecture = given
    return torch.stack(found[:]).detach(), list(gradients)


def clipped(learner: PPOLearner, part: Batch, bf16: bool) -> Tensor:
    """Which samples' ratios have left the clipping range, (N,) bool; precision as in `by_autograd`."""
    network = learner.network
    given = network.architecture
    set_precision("bf16" if bf16 else "float32", part.columns.device)
    network.architecture = replace(given, bf16=bf16)
    with torch.no_grad():
        output = network.evaluate_seen(part.columns, part.memory, part.privileged)
        ratio = (output.policy.log_prob(part.action) - part.log_prob).exp()
    network.architecture = given
    return (ratio - 1).abs() > learner.settings.clip_range


WIDE = {"layers": (256, 192), "memory": MemorySettings(4, averages=(0.5, 0.9))}


@pytest.mark.parametrize(
    ("craft", "settings"),
    [
        (PLATFORM, {}),
        (PLATFORM, {"layers": (64, 64), "activation": "relu"}),
        (PLATFORM, WIDE),
        (PLATFORM, WIDE | {"privileged_critic": True}),
        (FLYER, {"zoom": 16.0, "layers": (100, 128), "activation": "elu"}),
    ],
    ids=[
        "plane",
        "relu",
        "wide, in products",
        "a critic of its own",
        "space, elu, idle units and a second look",
    ],
)
def test_gradients_are_as_good_as_torchs(craft: Any, settings: Any) -> None:
    given = settings_with(SETTINGS, **settings)
    learner = begin(Engine(craft, GoToPose(), given.n_envs, device="cuda"), given, 0)
    kernel = learner.backend
    network = learner.network
    assert kernel is not None
    for _ in range(2):
        learner.collect()
        learner.update()
    learner.collect()
    prepared = learner.batch()
    learner.backend = None
    plain = learner.batch()
    generator = torch.Generator("cuda").manual_seed(1)
    learner.adam.row.add_(
        0.02 * torch.randn(learner.adam.row.shape, device="cuda", generator=generator)
    )
    advantage = plain.advantage / plain.advantage.std()
    part, prepared = (minibatches(x._replace(advantage=advantage), 4)[1] for x in (plain, prepared))
    exact, rounded = (by_autograd(learner, part, bf16) for bf16 in (False, True))
    found = torch.stack(kernel(prepared))
    # torch rounds as often, at other places.
    allowed = 2 * (rounded[0] - exact[0]).abs() + 5e-4 * exact[0].abs() + 5e-5
    # Rounding moves samples over the clipping bound in either direction, as many as it moves under torch. What
    # is left of them in the sum is as random as so many coins: four standard deviations, and two samples.
    moved = int((clipped(learner, part, True) != clipped(learner, part, False)).sum())
    allowed[-1] = (4.0 * moved**0.5 + 2.0) / len(part.columns)
    off = (found - exact[0]).abs()
    assert (off <= allowed).all(), (off / allowed).tolist()
    for name, true, theirs in zip(network.learnt, exact[1], rounded[1], strict=True):
        start = network.tensors[name].storage_offset()
        ours = learner.adam.gradient[start : start + true.numel()].view(true.shape)
        # Of a bias both are off by 1e-3.
        assert (ours - true).norm() <= 1.5 * (theirs - true).norm() + 3e-3 * true.norm(), name
