"""Rows of batches: some of the spacecraft of a tree of NumPy arrays or torch tensors (N,)."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from rans.model.fields import leaves, map_leaves, unflatten


def is_array(x: Any) -> bool:
    """Whether a field is an array or a tensor with an axis, not one number for all."""
    return getattr(x, "ndim", 0) > 0


def batched(tree: Any) -> tuple[Any, bool]:
    """A tree whose fields are arrays or tensors (N,), or numbers that are shared; and whether it was of one craft.

    The fields of a single spacecraft, which are numbers, become arrays (1,).

    Raises:
        TypeError: the fields are symbols, of which a kernel is to be generated: a filter that flies ahead
            chooses by their values.
    """
    if any(type(x).__module__.startswith("rans.") for x in leaves(tree)):
        raise TypeError(
            "a safety filter flies ahead until nothing is left to decide, which no generated program does."
        )
    if any(is_array(x) for x in leaves(tree)):
        return tree, False
    return map_leaves(lambda x: np.array([x], dtype=np.float64), tree), True


def count(tree: Any) -> int:
    """N of a tree of arrays (N,)."""
    return max(len(x) for x in leaves(tree) if is_array(x))


def like(tree: Any, size: int, value: float = 0.0) -> Any:
    """An array or a tensor (size,) of the kind of a tree's fields, filled with a number."""
    one = next(x for x in leaves(tree) if is_array(x))
    if isinstance(one, np.ndarray):
        return np.full(size, value, one.dtype)
    return one.new_full((size,), value)


def truths(tree: Any, size: int) -> Any:
    """(size,) bool of the library of a tree's fields, all false."""
    one = next(x for x in leaves(tree) if is_array(x))
    if isinstance(one, np.ndarray):
        return np.zeros(size, bool)
    return one.new_zeros((size,), dtype=sys.modules["torch"].bool)


def numbers(tree: Any, size: int) -> Any:
    """(size,) 0, 1, ... of the library of a tree's fields."""
    one = next(x for x in leaves(tree) if is_array(x))
    if isinstance(one, np.ndarray):
        return np.arange(size)
    return sys.modules["torch"].arange(size, device=one.device)


def where_true(mask: Any) -> Any:
    """Numbers of the rows where a mask (N,) holds, in their order."""
    return np.flatnonzero(mask) if isinstance(mask, np.ndarray) else mask.nonzero().squeeze(1)


def taken(tree: Any, rows: Any) -> Any:
    """These rows of a tree; numbers that all share stay."""
    return map_leaves(lambda x: x[rows] if is_array(x) else x, tree)


def copied(x: Any) -> Any:
    """A copy of an array or a tensor."""
    return x.copy() if isinstance(x, np.ndarray) else x.clone()


def stacked(parts: list[Any]) -> Any:
    """Arrays or tensors of one kind behind each other."""
    if isinstance(parts[0], np.ndarray):
        return np.concatenate(parts)
    return sys.modules["torch"].cat(parts)


def grid(tree: Any, values: list[float]) -> Any:
    """Numbers as a column (T, 1) of the library, dtype and device of a tree's fields."""
    one = next(x for x in leaves(tree) if is_array(x))
    column = [[value] for value in values]
    if isinstance(one, np.ndarray):
        return np.array(column, dtype=one.dtype)
    return one.new_tensor(column)


def repeated(tree: Any, values: Sequence[Any], size: int) -> Any:
    """A tree of numbers for each of some trees of numbers, ``size`` times each behind each other.

    The result has arrays or tensors of the kind of ``tree``'s fields.
    """
    columns = [
        stacked([like(tree, size, number) for number in numbers_])
        for numbers_ in zip(*map(leaves, values), strict=True)
    ]
    return unflatten(values[0], columns)


def columns(fields: list[Any]) -> Any:
    """Fields (N,) as columns (N, n), or (N, m) as (N, m, n)."""
    if isinstance(fields[0], np.ndarray):
        return np.stack(fields, axis=-1)
    return sys.modules["torch"].stack(fields, dim=-1)
