"""How far bfloat16 is off."""

from __future__ import annotations

import pytest
import torch

from campaigns.speed.rounding import _parts, differing, logits
from tests.support.engines import PLATFORM
from tests.support.kernel_flights import policy


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
        assert torch.equal(said, network.deterministic_action(observation, None)[0])


@pytest.mark.parametrize("name", ["multi-task-2d"])
def test_few_commands_differ(name: str) -> None:
    shares = {products: commands for products, commands, _ in differing(name, 8)}
    # One in a thousand over many flights; of 8,000 here at least one, and with more parts none.
    assert 1e-4 < shares["bf16"] < 1e-2
    assert shares["bf16x3"] <= 1 / 8000
    assert shares["bf16x6"] <= 1 / 8000
