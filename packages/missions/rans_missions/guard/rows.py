"""Operations on rows of batches, which are trees of NumPy arrays or torch tensors (N,)."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from rans.extend import leaves, map_leaves
from rans.model.fields import unflatten


def is_array(x: Any) -> bool:
    """Whether a field is an array or a tensor with an axis, instead of one number for all."""
    return getattr(x, "ndim", 0) > 0


def batched(tree: Any) -> tuple[Any, bool]:
    """Tree whose fields are arrays or tensors (N,) or shared numbers, and whether it was that of one craft.

    The fields of a single spacecraft, which are numbers, become arrays (1,).

    Raises:
        TypeError: the fields are symbols of a kernel; a filter with predictions branches on values.
    """
    if any(type(x).__module__.startswith("rans.") for x in leaves(tree)):
        raise TypeError(
            "a safety filter branches on predicted values, which a generated program cannot do."
        )
    if any(is_array(x) for x in leaves(tree)):
        return tree, False
    return map_leaves(lambda x: np.array([x], dtype=np.float64), tree), True


def count(tree: Any) -> int:
    """Number N of spacecraft in a tree of arrays (N,)."""
    return max(len(x) for x in leaves(tree) if is_array(x))


def like(tree: Any, size: int, value: float = 0.0) -> Any:
    """Array or tensor (size,) like the fields of a tree, filled with a number."""
    first = next(x for x in leaves(tree) if is_array(x))
    if isinstance(first, np.ndarray):
        return np.full(size, value, first.dtype)
    return first.new_full((size,), value)


def truths(tree: Any, size: int) -> Any:
    """Booleans (size,), all false, in the library of a tree's fields."""
    first = next(x for x in leaves(tree) if is_array(x))
    if isinstance(first, np.ndarray):
        return np.zeros(size, bool)
    return first.new_zeros((size,), dtype=sys.modules["torch"].bool)


def row_indices(tree: Any, size: int) -> Any:
    """Numbers 0, 1, ... (size,) in the library of a tree's fields."""
    first = next(x for x in leaves(tree) if is_array(x))
    if isinstance(first, np.ndarray):
        return np.arange(size)
    return sys.modules["torch"].arange(size, device=first.device)


def where_true(mask: Any) -> Any:
    """Indices of the rows where a mask (N,) is true, in order."""
    return np.flatnonzero(mask) if isinstance(mask, np.ndarray) else mask.nonzero().squeeze(1)


def taken(tree: Any, rows: Any) -> Any:
    """Rows of a tree; shared numbers are kept."""
    return map_leaves(lambda x: x[rows] if is_array(x) else x, tree)


def copied(x: Any) -> Any:
    """Copy of an array or a tensor."""
    return x.copy() if isinstance(x, np.ndarray) else x.clone()


def stacked(parts: list[Any]) -> Any:
    """Concatenation of arrays or tensors."""
    if isinstance(parts[0], np.ndarray):
        return np.concatenate(parts)
    return sys.modules["torch"].cat(parts)


def grid(tree: Any, values: list[float]) -> Any:
    """Numbers as a column (T, 1) in the library, dtype and device of a tree's fields."""
    first = next(x for x in leaves(tree) if is_array(x))
    column = [[value] for value in values]
    if isinstance(first, np.ndarray):
        return np.array(column, dtype=first.dtype)
    return first.new_tensor(column)


def least_row(x: Any) -> Any:
    """Least entry of each column of an array or a tensor (T, N), (N,)."""
    return x.min(0) if isinstance(x, np.ndarray) else x.amin(0)


def lesser(a: Any, b: Any) -> Any:
    """Lesser entries of two arrays or tensors (N,); NaN where one is."""
    return np.minimum(a, b) if isinstance(a, np.ndarray) else sys.modules["torch"].minimum(a, b)


def repeated(tree: Any, values: Sequence[Any], size: int) -> Any:
    """Tree that repeats each of several trees of numbers ``size`` times, concatenated.

    Its fields are arrays or tensors like those of ``tree``.
    """
    columns = [
        stacked([like(tree, size, number) for number in numbers_])
        for numbers_ in zip(*map(leaves, values), strict=True)
    ]
    return unflatten(values[0], columns)
