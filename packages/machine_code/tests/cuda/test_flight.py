"""The generated flight, on a warp of a CPU, against stepping."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from rans_machine_code.cuda import flight
from rans_machine_code.cuda.flight import FlightKernel
from rans_machine_code.cuda.launch import CudaError

from rans.episode.flight_statistics import QUANTITIES, FlightStatistics
from rans.episode.step import Setup
from rans.fast import flights
from rans.fast.flights import Flights
from rans.model.actuators import Throttle
from rans.policy.network import Network
from tests.support.engines import PLATFORM
from tests.support.host_flight import HostFlights
from tests.support.host_kernels import needs_compiler
from tests.support.kernel_flights import WIDE, policy, setup

SEED = 2**40 + 5
FIRST = 1000
COUNT = 40
"""Both words of the seed differ from zero, and the second warp is not full."""
THROTTLED = replace(PLATFORM, actuators=Throttle())


def both(
    network: Network, given: Setup, folder: Path, **how: Any
) -> tuple[FlightStatistics, FlightStatistics]:
    """By the kernel, and by stepping."""
    stepped = Flights(network, given, generated=False)
    kernel = HostFlights(stepped.world, network, folder, **how)
    return kernel.fly(FIRST, COUNT, SEED, 1000), stepped.fly(FIRST, COUNT, SEED)


def agree(kernel: FlightStatistics, stepped: FlightStatistics, share: float) -> None:
    """All but one flight are judged alike, and means agree within a share of them."""
    assert kernel.flights == stepped.flights == COUNT
    assert (
        len(
            set(zip(kernel.numbers, kernel.kinds, strict=True))
            ^ set(zip(stepped.numbers, stepped.kinds, strict=True))
        )
        <= 2
    )
    assert np.abs(kernel.settled_at - stepped.settled_at).sum() <= 2
    for name in QUANTITIES:
        ours = kernel.sums[name]
        theirs = stepped.sums[name]
        np.testing.assert_allclose(
            [ours.mean, ours.squares], [theirs.mean, theirs.squares], rtol=share, err_msg=name
        )


@needs_compiler
def test_sides_and_zoom_in_three_products(tmp_path):
    network = policy(PLATFORM, zoom=4.0)
    kernel, stepped = both(network, setup(PLATFORM), tmp_path, products="bf16x3")
    # Products are good to 2^-16, which changes a command in 1e5 here; of 40 flights some fail in each way.
    agree(kernel, stepped, 2e-3)
    assert sum(count > 0 for count in kernel.failures.values()) >= 3
    assert 0 < kernel.unsolved < COUNT


@needs_compiler
@pytest.mark.parametrize(
    ("craft", "settings"),
    [
        (THROTTLED, {"head": "gated"}),
        (THROTTLED, {"activation": "silu"}),
        # Where the row's own order and the commands' order are both looked up.
        (PLATFORM, {"history": 1, "commands_only": True}),
    ],
    ids=lambda x: getattr(x, "name", str(x)),
)
def test_what_few_networks_have(craft, settings, tmp_path):
    """Heads and activations that only have a formula, and a history of one row seen from the side."""
    kernel, stepped = both(policy(craft, **settings), setup(craft), tmp_path, products="bf16x6")
    agree(kernel, stepped, 1e-4)


@needs_compiler
def test_only_so_many_are_listed(tmp_path):
    network = policy(PLATFORM, layers=(16,))
    given = setup(PLATFORM)
    stepped = Flights(network, given, generated=False)
    kernel = HostFlights(stepped.world, network, tmp_path, products="bf16x3")
    everything, few = (kernel.fly(0, COUNT, SEED, listed) for listed in (1000, 5))
    assert few.failures == everything.failures
    assert len(everything.numbers) == everything.unsolved > len(few.numbers) == 5
    assert set(few.numbers) < set(everything.numbers)


class Chip:
    major = 9
    minor = 0
    shared_memory_per_block_optin = 232448


@pytest.mark.parametrize(
    ("settings", "error", "chip", "message"),
    [
        ({"layers": (520, 16)}, None, 9, "their kernel has no place for"),
        ({}, None, 7, r"a GPU of capability 7\.0, where 8\.0 is needed"),
        ({}, CudaError("no kernel image"), 9, "stepped, which is slower: no kernel image"),
        ({}, OSError("libnvrtc.so.12: cannot open"), 9, "stepped, which is slower: libnvrtc"),
    ],
)
def test_flights_without_a_kernel_say_so(settings, error, chip, message, monkeypatch):
    def fail(*_):
        raise error or AssertionError

    def on_a_cpu(world, network, _, products):
        return FlightKernel.made(world, network, torch.device("cpu"), products)

    monkeypatch.setattr(flights, "machine_code", lambda _: SimpleNamespace(flights=on_a_cpu))
    monkeypatch.setattr(Chip, "major", chip)
    monkeypatch.setattr(torch.cuda, "get_device_properties", lambda _: Chip)
    monkeypatch.setattr(flight, "Function", fail)
    monkeypatch.setattr(torch.cuda, "device", lambda _: torch.no_grad())
    monkeypatch.setattr(torch.cuda, "get_device_capability", lambda: (9, 0))
    network = policy(PLATFORM, sided=False, **settings)
    given = Flights(network, setup(PLATFORM), generated=False)
    given.device = torch.device("cuda")
    with pytest.warns(UserWarning, match=message):
        assert given._made("bf16") is None


def test_a_task_of_tensors_is_stepped():
    weight: Any = torch.tensor(0.02)
    task = replace(WIDE, thrust_weight=weight)
    network = policy(PLATFORM, task)
    world = Flights(network, setup(PLATFORM, task), generated=False).world
    with pytest.raises(TypeError, match="Tensor operand"):
        FlightKernel(world, network, torch.device("cpu"), 232448, "bf16")
