"""On a GPU: functions recorded once to be replayed without Python, and compiled where that pays."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Generic, ParamSpec, TypeVar

import torch
from torch import Tensor

P = ParamSpec("P")
R = TypeVar("R")

_compiles = True
"""Whether `fused` functions are compiled, see `as_written`."""


@contextmanager
def as_written() -> Iterator[None]:
    """Within it what is `fused` runs operation by operation, in the whole process.

    A training of seconds is over before torch's compilers are imported (docs/speed.md).
    """
    global _compiles
    before = _compiles
    _compiles = False
    try:
        yield
    finally:
        _compiles = before


def fused(function: Callable[P, R], device: torch.device, plain: bool = False) -> Callable[P, R]:
    """Compile a function for a GPU; return it as it is if ``plain``, and on a CPU: there compiling takes longer."""
    return function if plain or device.type != "cuda" else _Fused(function)


def graphed(
    function: Callable[[], Tensor], device: torch.device, plain: bool = False
) -> Callable[[], Tensor]:
    """Replay a function from a CUDA graph after one or two calls; return it as it is if plain, and on a CPU.

    It works on memory of the device that never moves, and without waiting for the device.
    """
    return function if plain or device.type != "cuda" else _Graphed(function)


class _Fused(Generic[P, R]):
    """Compiled when it is first called outside of `as_written`."""

    def __init__(self, function: Callable[P, R]) -> None:
        self._function: Callable[P, R] = function
        self._compiled: Callable[P, R] | None = None

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        if not _compiles:
            return self._function(*args, **kwargs)
        if self._compiled is None:
            self._compiled = torch.compile(self._function, fullgraph=True, dynamic=False)
        return self._compiled(*args, **kwargs)


class _Graphed:
    """The first calls compile or load kernels, which a graph cannot record; they count as real calls."""

    def __init__(self, function: Callable[[], Tensor]) -> None:
        self._function = function
        self._calls = 0
        self._compiles = _compiles
        self._recorded: tuple[torch.cuda.CUDAGraph, Tensor] | None = None

    def __call__(self) -> Tensor:
        if self._compiles != _compiles:  # what was recorded are other kernels
            self._calls = 0
            self._recorded = None
            self._compiles = _compiles
        if self._recorded is None and self._calls < calls_until_recorded():
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


def calls_until_recorded() -> int:
    """Ordinary calls of a `graphed` function: the compiler takes two, the second finds other strides."""
    return 2 if _compiles else 1


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
