"""On a GPU: functions compiled into few kernels, and recorded once to be replayed without Python."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

import torch
from torch import Tensor

P = ParamSpec("P")
R = TypeVar("R")


def fused(function: Callable[P, R], device: torch.device) -> Callable[P, R]:
    """The same function compiled for a GPU; on a CPU, itself: there compiling takes longer than training."""
    if device.type != "cuda":
        return function
    return torch.compile(function, fullgraph=True, dynamic=False)


def graphed(function: Callable[[], Tensor], device: torch.device) -> Callable[[], Tensor]:
    """The same function, replayed from a CUDA graph after two ordinary calls; on a CPU, itself.

    It works on memory of the device that never moves, and without waiting for the device.
    """
    return function if device.type != "cuda" else _Graphed(function)


class _Graphed:
    """The first calls compile and warm up, which a graph cannot record; they count as real calls."""

    _WARM_UP = 2

    def __init__(self, function: Callable[[], Tensor]) -> None:
        self._function, self._calls = function, 0
        self._recorded: tuple[torch.cuda.CUDAGraph, Tensor] | None = None

    def __call__(self) -> Tensor:
        if self._recorded is None and self._calls < self._WARM_UP:
            self._calls += 1
            return self._on_side_stream()
        if self._recorded is None:
            graph = torch.cuda.CUDAGraph()
            with _no_garbage_collection(), torch.cuda.graph(graph):
                self._recorded = graph, self._function()
        graph, result = self._recorded
        graph.replay()
        return result

    def _on_side_stream(self) -> Tensor:
        stream = torch.cuda.Stream()
        stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(stream):
            result = self._function()
        torch.cuda.current_stream().wait_stream(stream)
        return result


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Within it Python destroys no graph of an earlier training, which would break one being recorded.

    Since version 2.9 torch does not see to that (github.com/pytorch/pytorch/pull/161037).
    """
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
