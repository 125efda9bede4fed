"""Functions recorded on a GPU, with stand-ins for what needs one."""

from __future__ import annotations

import gc
from contextlib import nullcontext
from unittest.mock import MagicMock

import pytest
import torch

from rans.fast.learn.graph import graphed


@pytest.mark.parametrize("fails", [False, True])
@pytest.mark.parametrize("usually", [True, False])
def test_python_collects_no_garbage_while_a_graph_is_recorded(usually: bool, fails: bool,
                                                              monkeypatch: pytest.MonkeyPatch) -> None:
    """What it may destroy then, such as the graphs of an earlier training, breaks the one in the making."""
    for name in ("CUDAGraph", "Stream", "current_stream"):
        monkeypatch.setattr(torch.cuda, name, MagicMock())
    for name in ("stream", "graph"):
        monkeypatch.setattr(torch.cuda, name, lambda _: nullcontext())
    collects = []

    def function() -> torch.Tensor:
        collects.append(gc.isenabled())
        if fails and len(collects) == 3:
            raise ValueError("while it was recorded")
        return torch.zeros(())

    called = graphed(function, torch.device("cuda"))
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
