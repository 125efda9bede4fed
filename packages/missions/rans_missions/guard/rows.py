"""Operations on rows of batches, which are trees of NumPy arrays (N,) and of numbers that all rows share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rans.extend import leaves, map_leaves, unflatten


def is_array(x: Any) -> bool:
    """Whether a field is an array or a tensor with an axis, instead of one number for all."""
    return getattr(x, "ndim", 0) > 0


def on_numpy(tree: Any) -> Any:
    """Tree whose tensors of torch are NumPy arrays.

    Raises:
        TypeError: the fields are symbols of a kernel; a filter with predictions branches on values.
    """
    if any(type(x).__module__.startswith("rans.") for x in leaves(tree)):
        raise TypeError(
            "a safety filter branches on predicted values, which a generated program cannot do."
        )
    return map_leaves(
        lambda x: x.cpu().numpy() if type(x).__module__.startswith("torch") else x, tree
    )


def count(tree: Any) -> int:
    """Number N of spacecraft in a tree of arrays (N,)."""
    return max(len(x) for x in leaves(tree) if is_array(x))


def taken(tree: Any, rows: Any) -> Any:
    """Rows of a tree; shared numbers are kept."""
    return map_leaves(lambda x: x[rows] if is_array(x) else x, tree)


def repeated(values: Sequence[Any], size: int) -> Any:
    """Tree that repeats each of several trees of numbers ``size`` times, concatenated."""
    columns = [np.repeat(numbers, size) for numbers in zip(*map(leaves, values), strict=True)]
    return unflatten(values[0], columns)
