"""What a block of the kernel of gradients has room for."""

from __future__ import annotations

from typing import Any

import pytest

from rans.compile.cuda.design import DoesNotFit
from rans.compile.cuda.update_design import KernelDesign
from rans.fast.learn.config import MemorySettings
from tests.support.engines import FLYER
from tests.support.training import tiny_learner


def test_the_kernel_has_no_place_for_a_critic_of_its_own() -> None:
    with pytest.raises(DoesNotFit, match="a critic of its own"):
        KernelDesign(tiny_learner(privileged_critic=True).network.architecture, 2**20)


@pytest.mark.parametrize(
    ("layers", "zoom", "history", "shared", "message"),
    [
        ((129, 64), 0.0, 1, 232448, "24 inputs and layers of \\(129, 64\\) units"),
        ((128, 128), 16.0, 3, 232448, "64 inputs and"),
        ((128, 128), 0.0, 1, 166912, "shared memory a block"),
    ],
)
def test_what_the_kernel_has_no_room_for(
    layers: Any, zoom: float, history: int, shared: int, message: str
) -> None:
    learner = tiny_learner(layers=layers, zoom=zoom, memory=MemorySettings("history", history))
    with pytest.raises(DoesNotFit, match=message):
        KernelDesign(learner.network.architecture, shared)


def test_a_block_of_an_h200_has_room_for_networks_in_space() -> None:
    design = KernelDesign(
        tiny_learner(FLYER, layers=(128, 128), zoom=16.0).network.architecture, 232448
    )
    # Two looks at 16 columns, and a one; 16 thrusters, and a value.
    assert (design.inputs, design.widths, design.heads) == (48, (128, 128), 32)
