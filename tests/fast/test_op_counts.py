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

from rans import Engine
from rans.fast.learn.ppo import PPOLearner
from tests.support.engines import FLYER, NEAR, PLATFORM, SHORT
from tests.support.training import tiny_learner

SLACK = 1.1


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


def updates(craft: Any = PLATFORM, **settings: Any) -> int:
    return operations(trained(craft, **settings).update).total()


@pytest.mark.parametrize(
    ("craft", "counted"), [(PLATFORM, 124), (FLYER, 124)], ids=["plane", "space"]
)
def test_a_minibatch(craft, counted):
    """What one more epoch of two minibatches adds; and a third adds as much as the second.

    Twenty of them are Adam's, one kernel where they are compiled.
    """
    one, two, three = (updates(craft, n_epochs=epochs) for epochs in (1, 2, 3))
    assert three - two == two - one
    assert (two - one) / 2 <= SLACK * counted


def test_what_a_critic_is_told_of_conditions():
    """However many numbers they draw: all of them beside each other, less the mean, times the scale."""
    engine = Engine(PLATFORM, NEAR, 16, SHORT, conditions="lab", remember=True)
    assert engine.privileged_quantities.width > 10
    assert operations(engine.privileged).total() == 3


@pytest.mark.parametrize("craft", [PLATFORM, FLYER], ids=["plane", "space"])
def test_nothing_waits_for_the_device(craft):
    """A number taken from a tensor stops the host until the device is done, and cannot be in a CUDA graph."""
    model = trained(craft)
    found = operations(model.collect) + operations(model.update)
    assert found["aten::_local_scalar_dense"] == 0
    assert operations(lambda: torch.zeros(1).item())["aten::_local_scalar_dense"] == 1
