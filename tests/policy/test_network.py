"""What the network makes of observations: its looks, its memory, and what turns and members change."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from rans.fast.engine import Engine
from rans.fast.learn.config import PPOSettings, Precision
from rans.fast.learn.member import begin
from rans.policy.architecture import Architecture
from rans.policy.filter_bank import Filters
from rans.policy.network import Network
from rans.tasks import GoToPose
from rans.tasks.derived import layout
from tests.support.engines import PLATFORM
from tests.support.training import make_network, scatter, seen

BANK = Filters.of(PLATFORM, GoToPose(), 0.2, (0.01, 1.0))


def test_many_members_say_what_each_says_alone() -> None:
    """Batched products against plain ones, for every kind of network."""
    kinds: list[dict[str, Any]] = [
        {},
        {"history": 2},
        {"history": 1, "averages": (0.5, 0.9)},
        {"privileged": 2},
        {"zoom": 20.0, "continuous": True},
        {"zoom": 20.0, "filters": BANK},
        {"history": 2, "filters": BANK._replace(steady=(0.0, 25.0))},
        {"averages": (0.5,), "commands_only": True, "filters": BANK},
        {"zoom": 20.0, "filters": BANK._replace(response=(0.1, 0.0))},
        {"filters": BANK._replace(response=(0.1, 0.0), gate=5.0)},
    ]
    for kind in kinds:
        alone = [make_network(PLATFORM, **kind) for _ in range(3)]
        for number, network in enumerate(alone):
            scatter(network, seed=number)
        given = alone[0].architecture
        together = Network.stacked(
            given, [network.member(0) for network in alone], torch.device("cpu"), torch.float64
        )
        generator = torch.Generator().manual_seed(2)
        memory = (
            torch.randn(12, given.memory, generator=generator).double() if given.memory else None
        )
        known = (
            torch.rand(12, given.privileged, generator=generator).double()
            if given.privileged
            else None
        )
        observations = seen(PLATFORM, 12).double()
        if given.filters:  # whose memory is no random numbers
            before, columns = together.forward(
                seen(PLATFORM, 12, seed=5).double(), together.initial_state(12)
            )
            memory = together.next_state(columns, together.initial_state(12), before.policy.mode())
        output, shown = together.forward(observations, memory, known)
        remembered = together.next_state(shown, memory, output.policy.mode())
        for number, network in enumerate(alone):
            own = slice(4 * number, 4 * number + 4)
            one, looked = network.forward(
                observations[own],
                None if memory is None else memory[own],
                None if known is None else known[own],
            )
            # Products of float64 in another order.
            torch.testing.assert_close(output.policy[0][own], one.policy[0], rtol=0, atol=1e-12)  # type: ignore
            torch.testing.assert_close(output.value[own], one.value, rtol=0, atol=1e-12)
            if remembered is not None:
                expected = network.next_state(looked, memory[own], one.policy.mode())  # type: ignore[index]
                torch.testing.assert_close(remembered[own], expected, rtol=0, atol=1e-12)


def untrained(dtype: torch.dtype = torch.float64, **settings: Any) -> Network:
    given = Architecture(layout(GoToPose(), 2), 8, (16,), **settings)
    return Network.stacked(given, [given.initial(0, 0.5)[0]], torch.device("cpu"), dtype)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_statistics_are_those_of_all_observations(dtype: torch.dtype) -> None:
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
    network = begin(Engine(PLATFORM, GoToPose(), 64, device=device), [settings], [0]).network
    assert network.architecture.bf16 == (matmul == "bf16")
    with torch.no_grad():
        return network.evaluate(seen(PLATFORM, 64).float().to(device)).value


def test_a_cpu_knows_no_bf16() -> None:
    assert torch.equal(outputs_of("bf16", "cpu"), outputs_of("tf32", "cpu"))


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
def test_bf16_rounds_the_hidden_layers() -> None:
    """To 8 significant bits, of numbers of order one."""
    difference = (outputs_of("bf16", "cuda") - outputs_of("tf32", "cuda")).abs().max()
    assert 1e-5 < difference < 2e-2


def looks(network: Network, observations: Tensor) -> Tensor:
    return network._looks(network.in_body(observations))
