"""CUDA graphs and compilation of functions on a GPU."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Generic, ParamSpec, TypeVar

import torch

P = ParamSpec("P")
R = TypeVar("R")

_compiles = True
"""Whether `fused` functions are compiled, see `as_written`."""


@contextmanager
def as_written() -> Iterator[None]:
    """Context in which `fused` functions are not compiled, in the whole process.

    A training of seconds ends before torch's compilers are imported (docs/speed.md).
    """
    global _compiles
    before = _compiles
    _compiles = False
    try:
        yield
    finally:
        _compiles = before


def fused(function: Callable[P, R], device: torch.device, plain: bool = False) -> Callable[P, R]:
    """Function that is compiled on a GPU at its first call outside of `as_written`.

    It is the function itself if ``plain`` or on a CPU, where compiling does not pay. It must not call
    `Network.forward`, `Network.look` or an engine: their kernels are not torch's.
    """
    if plain or device.type != "cuda":
        return function

    @cache
    def compiled() -> Callable[P, R]:
        return torch.compile(function, fullgraph=True, dynamic=False)

    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        return (compiled() if _compiles else function)(*args, **kwargs)

    return call


def graphed(
    function: Callable[[], R], device: torch.device, plain: bool = False
) -> Callable[[], R]:
    """Function that is replayed from a CUDA graph after one or two calls; itself if ``plain`` or on a CPU.

    It must use device memory at constant addresses, and not synchronise with the device.
    """
    return function if plain or device.type != "cuda" else _Graphed(function)


class _Graphed(Generic[R]):
    """Function that is recorded after its first calls, which compile or load kernels and are executed normally."""

    def __init__(self, function: Callable[[], R]) -> None:
        self._function = function
        self._calls = 0
        self._compiles = _compiles
        self._recorded: tuple[torch.cuda.CUDAGraph, R] | None = None

    def __call__(self) -> R:
        """Result of the function: the first calls run it, one records a graph, and later ones replay that.

        Results of a replay lie at the same addresses as those before, which it overwrites. Arguments cannot be
        passed: the function reads them from tensors that stay where they are.
        """
        if self._compiles != _compiles:  # the recorded kernels are other ones
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

    def _on_side_stream(self) -> R:
        stream = torch.cuda.Stream()
        stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(stream):
            result = self._function()
        torch.cuda.current_stream().wait_stream(stream)
        return result


def calls_until_recorded() -> int:
    """Number of eager calls of a `graphed` function: two with compilation, because the second has other strides."""
    return 2 if _compiles else 1


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Context without garbage collection, which could destroy an earlier graph and break one being recorded.

    torch does not prevent this since version 2.9 (github.com/pytorch/pytorch/pull/161037).
    """
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
