"""Answers of actor and critic by machine code against torch's."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from rans_machine_code.network import CpuActorCritic, network_code
from rans_machine_code.policies import network_program

from rans import Engine, MultiTask, PPOSettings
from rans.fast.learn.beginning import architecture_of
from rans.policy.network import Network
from rans.policy.symmetry import symmetries
from rans.tasks.derived import layout
from tests.support.engines import NEAR, PLATFORM
from tests.support.training import MACHINE_CODE_CASES, collected, scatter

SIDES: Any = symmetries(PLATFORM)


@MACHINE_CODE_CASES
def test_answers_are_torchs(craft, settings):
    count = 75
    network = collected(craft, **settings)[0].network
    plain = Network(network.architecture, network.tensors)
    generator = torch.Generator().manual_seed(1)
    memory = network.initial_state(count)
    observation = torch.randn(count, network.architecture.layout.width, generator=generator)
    with torch.no_grad():
        found, expected = (x.evaluate(observation, memory) for x in (network, plain))
    torch.testing.assert_close(found.value, expected.value, rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(found.policy, expected.policy, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"layers": (16, 12)},
        {"activation": "relu"},
        {"zoom": 2.0},
        {"clip": 0.5},
        {"symmetries": None},
        {"symmetries": SIDES._replace(place=np.roll(SIDES.place, 1, axis=1))},
        {"layout": layout(MultiTask(), 2)},
    ],
    ids=["nothing", "layers", "activation", "zoom", "clip", "symmetries", "places", "columns"],
)
def test_looks_alike_share_their_code(change):
    """And only those: each says what torch says of its own weights."""
    network_code.cache_clear()
    first = replace(
        architecture_of(Engine(PLATFORM, NEAR, 1), PPOSettings(layers=(16, 16))), symmetries=SIDES
    )
    for seed, given in enumerate((first, replace(first, **change))):
        plain = scatter(Network(given, given.initial(seed, 0.5)[0]), seed)
        observation = torch.randn(
            40, given.layout.width, generator=torch.Generator().manual_seed(seed)
        )
        program = network_program(given)
        assert program
        found = CpuActorCritic(given, program, plain.tensors)(observation)
        with torch.no_grad():
            expected = plain.evaluate(observation)
        # Sums of 16 float32 products in another order.
        torch.testing.assert_close(
            found,
            (expected.policy[0], expected.value),  # type: ignore
            rtol=1e-5,
            atol=1e-5,  # type: ignore
        )
    assert network_code.cache_info().misses == 1 + bool(change)
