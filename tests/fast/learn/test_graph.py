"""Functions recorded on a GPU, with stand-ins for what needs one."""

from __future__ import annotations

import gc
from contextlib import nullcontext
from dataclasses import replace
from unittest.mock import MagicMock

import pytest
import torch

from rans.fast.learn import ppo
from rans.fast.learn.config import training
from rans.fast.learn.graph import as_written, fused, graphed
from rans.fast.learn.run_folder import RunFolder
from rans.fast.learn.trainer import Trainer
from rans.model.spacecraft_file import load_spacecraft

GPU = torch.device("cuda")


@pytest.fixture
def _on_a_gpu(monkeypatch) -> None:
    """Stand-ins for what needs one."""
    for name in ("CUDAGraph", "Stream", "current_stream"):
        monkeypatch.setattr(torch.cuda, name, MagicMock())
    for name in ("stream", "graph"):
        monkeypatch.setattr(torch.cuda, name, lambda _: nullcontext())


def test_nothing_is_compiled_until_that_is_wanted(monkeypatch):
    compiled = MagicMock(return_value=lambda x: -x)
    monkeypatch.setattr(torch, "compile", compiled)
    twice = fused(lambda x: 2 * x, GPU)
    with as_written():
        assert twice(3) == 6
    assert not compiled.called
    assert (twice(3), twice(4)) == (-3, -4)
    assert compiled.call_count == 1


@pytest.mark.usefixtures("_on_a_gpu")
def test_what_was_recorded_uncompiled_is_recorded_anew():
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
def test_python_collects_no_garbage_while_a_graph_is_recorded(usually, fails):
    """What it may destroy then, such as the graphs of an earlier training, breaks the one in the making."""
    collects = []

    def function():
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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("craft", "changes"),
    [
        ("floating-platform", {}),
        ("floating-platform-shared", {"backbone": "allocated"}),
    ],
)
def test_what_a_gpu_compiles_is_traced_whole(craft, changes, monkeypatch, tmp_path):
    """Without its compiler of kernels, on a processor; the training is the one of the functions as written."""
    given = training("go-to-pose", craft, "cpu")
    changed = replace(given.ppo, n_envs=8, n_steps=8, batch_size=32, n_epochs=1, **changes)
    given = replace(given, ppo=changed, plain=True, total_timesteps=64, report_interval=1)

    def weights(folder):
        trainer = Trainer(given, load_spacecraft(craft), RunFolder(tmp_path / folder))
        trainer.train(lambda _: None)
        return {name: x.detach() for name, x in trainer.learner.network.tensors.items()}

    traced = []

    def compiled(function, *_):
        traced.append(function.__name__)
        return torch.compile(function, fullgraph=True, dynamic=False, backend="eager")

    as_they_are = weights("as-written")
    monkeypatch.setattr(ppo, "fused", compiled)
    torch.testing.assert_close(weights("traced"), as_they_are, rtol=1e-5, atol=1e-6)
    assert traced == ["losses"]
