"""A policy's layers as machine code, against torch's."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from rans.compile.cpu.layers import WIDTH, CpuLayers
from rans.model.spacecraft import Spacecraft
from rans.policy.architecture import EXTRACTOR
from rans.policy.program import inputs
from rans.policy.scalars import symbols
from rans.policy.traced import parameters, policy_program
from tests.support.engines import FLYER, PLATFORM
from tests.support.kernel_flights import policy

KINDS: dict[str, tuple[Spacecraft, dict[str, Any]]] = {
    "plane": (PLATFORM, {"layers": (64, 64), "zoom": 8.0}),
    "space, units that fill no group": (FLYER, {"layers": (33, 20, 7)}),
    "no sides": (FLYER, {"layers": (20,), "sided": False, "activation": "elu"}),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("count", [1, WIDTH, 5 * WIDTH + 3])
def test_outputs_are_torchs(kind: str, count: int) -> None:
    craft, settings = KINDS[kind]
    network = policy(craft, **settings)
    given = network.architecture
    _, (stage,) = symbols(
        policy_program(given), {"observation": inputs("observed", given.layout.width)}, ["command"]
    )
    rows = torch.randn(count, given.inputs, generator=torch.Generator().manual_seed(1))
    layers = CpuLayers(stage, parameters(network))
    found = layers(list(rows.numpy().T), layers.memory(count))
    x = rows
    for layer in range(len(given.layers)):
        x = given.activation_module()(
            torch.nn.functional.linear(x, *network.layer(f"{EXTRACTOR}trunk.{2 * layer}"))
        )
    weight, bias = (network.tensors[f"action_net.{kind}"] for kind in ("weight", "bias"))
    both = torch.nn.functional.linear(x, weight, bias)
    # Log-odds of a thruster are a difference of two outputs; of sums of float32 in another order.
    np.testing.assert_allclose(found.T, both[:, 1::2] - both[:, 0::2], rtol=0, atol=2e-5)
