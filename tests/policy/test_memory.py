"""Memories: averages by hand."""

from __future__ import annotations

import torch

from tests.support.engines import PLATFORM
from tests.support.training import make_network, seen


def test_averages_keep_their_share_of_what_was() -> None:
    """After a 1 and three zeros the first average is 0.5^4 and the second 0.1 x 0.9^3."""
    network = make_network(PLATFORM, history=1, averages=(0.5, 0.9))
    memory = network.initial_state(2)
    width = network.architecture.column_count
    output, columns = network.forward(seen(PLATFORM, 2).double(), memory)
    command = output.policy.mode()
    for level in (1.0, 0.0, 0.0, 0.0):
        inputs = torch.full_like(columns, level), memory, torch.full_like(command, level)
        memory = network.next_state(*inputs)
    assert memory is not None
    assert memory.shape == (2, 3 * (width + len(PLATFORM.thrusters)))
    rows = memory.unflatten(1, (3, -1))[0]
    for row, value in zip(rows, (0.0625, 0.0729, 0.0), strict=True):
        torch.testing.assert_close(
            row, torch.full_like(row, value), rtol=0, atol=1e-15
        )  # a last place
