"""A network's commands as machine code, against torch's."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from rans.compile.cpu.history import CpuHistory
from rans.compile.cpu.policy import WIDTH, CpuPolicy
from rans.model.spacecraft import Spacecraft
from tests.support.engines import FLYER, PLATFORM
from tests.support.kernel_flights import policy

KINDS: dict[str, tuple[Spacecraft, dict[str, Any]]] = {
    "plane": (PLATFORM, {"layers": (64, 64), "zoom": 8.0}),
    "space, units that fill no group": (FLYER, {"layers": (33, 20, 7)}),
    "no sides": (FLYER, {"layers": (20,), "sided": False, "activation": "elu"}),
}


def seen(count: int, width: int) -> torch.Tensor:
    return 2.0 * torch.randn(count, width, generator=torch.Generator().manual_seed(1))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("count", [1, WIDTH, 5 * WIDTH + 3])
def test_commands_are_torchs(kind: str, count: int) -> None:
    craft, settings = KINDS[kind]
    network = policy(craft, **settings)
    rows = seen(count, network.architecture.layout.width)
    expected, _ = network.deterministic_action(rows, None)
    columns, view = shown(network, rows)
    found = CpuPolicy(network)(columns, view, CpuHistory(network.architecture, count))
    # Both sum float32 numbers, in another order: one command in ten thousand may be as near to zero.
    assert (found != expected.T.numpy()).mean() <= 1e-3
    assert 0.1 < found.mean() < 0.9


def shown(network: Any, rows: torch.Tensor) -> tuple[list[np.ndarray], np.ndarray]:
    """Columns as the network sees them, and from which side."""
    columns = network.in_body(rows)
    views = network.architecture.symmetries
    if views is None:
        return list(columns.T.numpy()), np.zeros(len(rows), np.int32)
    body = network.architecture.layout.body
    way = body.ahead(tuple(columns.T))
    which = views.tensors_like(columns).which(way)
    return list(network.look(columns)[0].T.contiguous().numpy()), which.numpy()
