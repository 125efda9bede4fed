"""Our kernels as one operation of torch's, which its compiler neither looks into nor makes anew."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import cache
from typing import Protocol
from weakref import WeakValueDictionary

import torch
from torch import Tensor


class RowKernels(Protocol):
    """Has kernels that find numbers, and a whole number, of each of N rows."""

    def rows(self, number: int, rows: Tensor) -> tuple[Tensor, Tensor]:
        """What one of them finds, (N, k) and (N,) int64, of rows (N, width)."""
        ...

    def room(self, number: int, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Memory for it."""
        ...


_KNOWN: WeakValueDictionary[int, RowKernels] = WeakValueDictionary()
_NUMBERS = itertools.count()


def opaque(kernels: RowKernels) -> Callable[[int, Tensor], tuple[Tensor, Tensor]]:
    """`RowKernels.rows` for functions that torch compiles."""
    number = next(_NUMBERS)
    operation = _operation()
    _KNOWN[number] = kernels
    return lambda which, tensor: operation(number, which, tensor)


@cache
def _operation() -> Callable[[int, int, Tensor], tuple[Tensor, Tensor]]:
    """Torch's operation for kernels of ours; its first argument is the number of an object in `_KNOWN`."""

    @torch.library.custom_op(
        "rans::rows",
        mutates_args=(),
        schema="(int number, int which, Tensor tensor) -> (Tensor, Tensor)",
    )
    def rows(number: int, which: int, tensor: Tensor) -> tuple[Tensor, Tensor]:
        return _KNOWN[number].rows(which, tensor)

    @rows.register_fake
    def _(number: int, which: int, tensor: Tensor) -> tuple[Tensor, Tensor]:
        return _KNOWN[number].room(which, tensor)

    return rows
