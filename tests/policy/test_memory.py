"""Memories: a recurrent core as torch's, histories and averages by hand."""

from __future__ import annotations

import torch

from tests.support.engines import PLATFORM
from tests.support.training import make_network, seen


def test_the_recurrent_core_is_torchs() -> None:
    """Step by step, and over whole sequences with episodes that begin anew."""
    network = make_network(PLATFORM, units=8)
    cell = torch.nn.GRUCell(16, 8).double()
    cell.load_state_dict(
        {name: network.tensors[f"features_extractor.core.{name}"] for name in cell.state_dict()}
    )
    generator = torch.Generator().manual_seed(3)
    columns = torch.randn(5 * 4, 8, generator=generator).double()
    memory = torch.randn(5 * 4, 8, generator=generator).double()
    going_on = (torch.rand(5, 4, generator=generator) > 0.4).double()
    found = network.evaluate_seen(columns, memory, going_on=going_on).core.unflatten(0, (5, 4))
    trunk = network._through(network._trunk, network._looks(columns)).unflatten(0, (5, 4))
    state = memory[:4]
    for t in range(5):
        if t > 0:
            state = state * going_on[t][:, None]
        state = cell(trunk[t], state)
        torch.testing.assert_close(found[t], state, rtol=0, atol=1e-12)  # float64 in another order
    assert going_on[1:].min() == 0.0


def test_averages_keep_their_share_of_what_was() -> None:
    """After a 1 and three zeros the first average is 0.5^4 and the second 0.1 x 0.9^3."""
    network = make_network(PLATFORM, history=1, averages=(0.5, 0.9))
    memory = network.initial_state(2)
    width = network.architecture.column_count
    output, columns = network.forward(seen(PLATFORM, 2).double(), memory)
    command = output.policy.mode()
    for level in (1.0, 0.0, 0.0, 0.0):
        told = torch.full_like(columns, level), memory, torch.full_like(command, level)
        memory = network.next_state(*told, output.core)
    assert memory is not None
    assert memory.shape == (2, 3 * (width + len(PLATFORM.thrusters)))
    rows = memory.unflatten(1, (3, -1))[0]
    for row, value in zip(rows, (0.0625, 0.0729, 0.0), strict=True):
        torch.testing.assert_close(
            row, torch.full_like(row, value), rtol=0, atol=1e-15
        )  # a last place
