"""What the network makes of observations: its looks, its memory, and what turns change."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from rans import Engine, GoToPose
from rans.fast.learn.beginning import begin
from rans.fast.learn.config import PPOSettings, Precision
from rans.policy.architecture import Architecture
from rans.policy.network import Network
from rans.tasks.derived import layout
from tests.support.engines import PLATFORM
from tests.support.training import seen


def untrained(dtype: torch.dtype = torch.float64, **settings: Any) -> Network:
    given = Architecture(layout(GoToPose(), 2), 8, (16,), **settings)
    return Network.copied(given, given.initial(0, 0.5)[0], torch.device("cpu"), dtype)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_statistics_are_those_of_all_observations(dtype):
    network = untrained(dtype=dtype)
    generator = torch.Generator().manual_seed(2)
    scale, shift = torch.rand(2, 10, generator=generator) * 5
    parts = [
        torch.randn(count, 10, generator=generator) * scale + shift * part
        for part, count in enumerate((3, 500, 1, 64))
    ]
    for part in parts:
        network.update_statistics(network.in_body(part)[None])
    everything = np.stack(
        layout(GoToPose(), 2).in_body(torch.cat(parts).double().unbind(1)), axis=1
    )
    # Rounding of the dtype, and in float32 of the observations turned into the body frame.
    relative = 1e-12 if dtype == torch.float64 else 2e-5
    mean, variance, count = (
        network.tensors[f"features_extractor.{name}"] for name in ("mean", "variance", "count")
    )
    np.testing.assert_allclose(mean, everything.mean(axis=0), rtol=relative, atol=relative)
    np.testing.assert_allclose(variance, everything.var(axis=0), rtol=relative)
    assert count == 568


def outputs_of(matmul: Precision, device: str) -> Tensor:
    """Values of a trainer's network with the same weights and observations."""
    settings = PPOSettings(n_envs=64, batch_size=2048, layers=(32, 32), matmul=matmul)
    network = begin(Engine(PLATFORM, GoToPose(), 64, device=device), settings, 0).network
    assert network.architecture.bf16 == (matmul == "bf16")
    with torch.no_grad():
        return network.evaluate(seen(PLATFORM, 64).float().to(device)).value


def test_a_cpu_knows_no_bf16():
    assert torch.equal(outputs_of("bf16", "cpu"), outputs_of("tf32", "cpu"))


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
def test_bf16_rounds_the_hidden_layers():
    """To 8 significant bits, of numbers of order one."""
    difference = (outputs_of("bf16", "cuda") - outputs_of("tf32", "cuda")).abs().max()
    assert 1e-5 < difference < 2e-2
