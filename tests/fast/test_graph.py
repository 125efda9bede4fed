"""Functions recorded on a GPU, with stand-ins for what needs one."""

from __future__ import annotations

import gc
from contextlib import nullcontext
from typing import Any
from unittest.mock import MagicMock

import pytest
import torch

from rans.fast.graph import graphed


@pytest.mark.parametrize("usually", [True, False])
def test_python_collects_no_garbage_while_a_graph_is_recorded(usually: bool,
                                                              monkeypatch: pytest.MonkeyPatch) -> None:
    """What it may destroy then, such as the graphs of an earlier training, breaks the one in the making."""
    recording, collects = [False], list[tuple[bool, bool]]()

    class Recording:
        def __init__(self, _: Any) -> None:
            pass

        def __enter__(self) -> None:
            recording[0] = True

        def __exit__(self, *_: object) -> None:
            recording[0] = False

    for name in ("CUDAGraph", "Stream", "current_stream"):
        monkeypatch.setattr(torch.cuda, name, MagicMock())
    monkeypatch.setattr(torch.cuda, "stream", lambda _: nullcontext())
    monkeypatch.setattr(torch.cuda, "graph", Recording)

    def function() -> torch.Tensor:
        collects.append((recording[0], gc.isenabled()))
        return torch.zeros(())

    called = graphed(function, torch.device("cuda"))
    if not usually:
        gc.disable()
    try:
        for _ in range(4):
            called()
        assert gc.isenabled() == usually
    finally:
        gc.enable()
    assert collects == [(False, usually)] * 2 + [(True, False)]
