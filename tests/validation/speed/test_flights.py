"""What is measured of many flights, and how far bfloat16 is off."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from rans.evaluation.fly.contestants import contestant
from rans.fast.flights import Flights
from rans.fast.learn.selection import likeliest
from rans.fast.verdicts import QUANTITIES
from tests.fast.engines import PLATFORM
from tests.fast.flying import policy, setup
from validation.speed.flights import flight_rates, widened
from validation.speed.measurement import Clock
from validation.speed.rounding import _parts, differing, logits


def test_idle_units_change_nothing() -> None:
    network, given = policy(PLATFORM, layers=(16, 16), zoom=4.0), setup(PLATFORM)
    wide = widened(network, 48)
    assert wide.architecture.layers == (48, 48)
    a, b = (Flights(one, given, generated=False).fly(0, 100, 1) for one in (network, wide))
    assert a.failures == b.failures
    # Sums of float32 in another order.
    for name in QUANTITIES:
        np.testing.assert_allclose(a.sums[name].mean, b.sums[name].mean, rtol=1e-3)


def test_rates_of_shipped_agents(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("validation.speed.flights._AGENTS", (("go-to-pose-2d-fast", 64), ("none-3d", 64)))
    monkeypatch.setattr("validation.speed.flights.contestant", lambda name: contestant(
        name.replace("none", "track-velocity")))
    (measured,) = flight_rates({2}, 8, Clock("cpu", repeats=1, seconds=0.001))
    assert measured.name == "go-to-pose-2d-fast, 64x64, CPU, float32"
    assert (measured.kind, measured.unit, measured.note) == ("flights", "M steps/s", "8 flights of 125 steps")
    assert measured.value


def test_parts_add_up() -> None:
    x = torch.randn(1000, generator=torch.Generator().manual_seed(1))
    for count in (1, 2, 3):
        parts = _parts(x, count)
        assert all(torch.equal(part, part.bfloat16().float()) for part in parts)
        # Eight significant bits each, rounded to nearest.
        assert float(((sum(parts) - x).abs() / x.abs()).max()) <= 2.0 ** (-8 * count)


def test_logits_are_the_networks() -> None:
    network = policy(PLATFORM, zoom=4.0)
    generator = torch.Generator().manual_seed(2)
    observation = torch.randn(200, network.architecture.layout.width, generator=generator)
    with torch.no_grad():
        seen, _, place = network.look(network.in_body(observation))
        assert place is not None
        said = (logits(network, seen, 0) > 0).float().gather(1, place)
        assert torch.equal(said, likeliest(network, observation, None)[0])


@pytest.mark.parametrize("name", ["go-to-pose-2d-fast"])
def test_few_commands_differ(name: str) -> None:
    shares = {products: commands for products, commands, _ in differing(name, 8)}
    # One in a thousand over many flights; of 8,000 here at least one, and with more parts none.
    assert 1e-4 < shares["bf16"] < 1e-2
    assert shares["bf16x3"] <= 1 / 8000
    assert shares["bf16x6"] <= 1 / 8000
