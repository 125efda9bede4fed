"""How many operations training takes: on a GPU each of them is a kernel, or part of one.

Counts do not depend on the machine or its load, so they find what a timing would lose in its noise. Bounds
are counts of torch 2.13 and a tenth, because other versions of torch divide some functions differently.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from rans.fast.learn.ppo import PPOLearner
from tests.support.engines import FLYER, PLATFORM
from tests.support.training import tiny_learner


class _Counting(TorchDispatchMode):
    """Notes every operation of torch that computes or copies; views move nothing."""

    def __init__(self) -> None:
        super().__init__()
        self.operations: Counter[str] = Counter()

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        if func.namespace == "aten" and not func.is_view:
            self.operations[func.name()] += 1
        return func(*args, **(kwargs or {}))


def operations(function: Callable[[], object]) -> Counter[str]:
    with _Counting() as counting:
        function()
    return counting.operations


def trained(craft: Any = PLATFORM, **settings: Any) -> PPOLearner:
    """A trainer whose optimiser has its memory already: the first update allocates it."""
    model = tiny_learner(craft, **settings)
    model.backend = None  # as on a GPU in TF32
    model.collect()
    model.update()
    return model


@pytest.mark.parametrize("craft", [PLATFORM, FLYER], ids=["plane", "space"])
def test_nothing_waits_for_the_device(craft):
    """A number taken from a tensor stops the host until the device is done, and cannot be in a CUDA graph."""
    model = trained(craft)
    found = operations(model.collect) + operations(model.update)
    assert found["aten::_local_scalar_dense"] == 0
    assert operations(lambda: torch.zeros(1).item())["aten::_local_scalar_dense"] == 1
