"""Functions recorded on a GPU, with stand-ins for what needs one."""

from __future__ import annotations

import gc
from contextlib import nullcontext
from unittest.mock import MagicMock

import pytest
import torch

from rans.fast.learn.graph import as_written, fused, graphed

GPU = torch.device("cuda")


@pytest.fixture
def _on_a_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stand-ins for what needs one."""
    for name in ("CUDAGraph", "Stream", "current_stream"):
        monkeypatch.setattr(torch.cuda, name, MagicMock())
    for name in ("stream", "graph"):
        monkeypatch.setattr(torch.cuda, name, lambda _: nullcontext())


def test_nothing_is_compiled_until_that_is_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = MagicMock(return_value=lambda x: -x)
    monkeypatch.setattr(torch, "compile", compiled)
    twice = fused(lambda x: 2 * x, GPU)
    with as_written():
        assert twice(3) == 6
    assert not compiled.called
    assert (twice(3), twice(4)) == (-3, -4)
    assert compiled.call_count == 1


@pytest.mark.usefixtures("_on_a_gpu")
def test_what_was_recorded_uncompiled_is_recorded_anew() -> None:
    """After one ordinary call; what the compiler made, after two."""
    function = MagicMock(return_value=torch.zeros(()))
    called = graphed(function, GPU)
    calls = list[int]()
    with as_written():
        for _ in range(4):
            called()
            calls.append(function.call_count)
    for _ in range(4):
        called()
        calls.append(function.call_count)
    assert calls == [1, 2, 2, 2, 3, 4, 5, 5]


@pytest.mark.usefixtures("_on_a_gpu")
@pytest.mark.parametrize("fails", [False, True])
@pytest.mark.parametrize("usually", [True, False])
def test_python_collects_no_garbage_while_a_graph_is_recorded(usually: bool, fails: bool) -> None:
    """What it may destroy then, such as the graphs of an earlier training, breaks the one in the making."""
    collects = []

    def function() -> torch.Tensor:
        collects.append(gc.isenabled())
        if fails and len(collects) == 3:
            raise ValueError("while it was recorded")
        return torch.zeros(())

    called = graphed(function, GPU)
    if not usually:
        gc.disable()
    try:
        called()
        called()
        with pytest.raises(ValueError, match="recorded") if fails else nullcontext():
            called()
        assert gc.isenabled() == usually
    finally:
        gc.enable()
    assert collects == [usually, usually, False]  # the third call is recorded
