"""Ways to open on/off thrusters together whose effects differ."""

from __future__ import annotations

import itertools
import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

MOST_SUBSETS = 4096
"""Largest number of subsets that are compared: all of 12 thrusters; of more thrusters those with fewest open."""
_EQUAL = 1e-6
"""Difference of twists, in units of the authority, up to which two subsets do the same."""


class Subsets(NamedTuple):
    """Ways to open on/off thrusters, and the linear functions of the demand whose largest one is the best."""

    opened: np.ndarray
    """(S, n) 0 or 1, in the order of the craft's thrusters."""
    twist: np.ndarray
    """(S, d) change of the twist."""
    slope: np.ndarray
    """(S, d) of each linear function."""
    offset: np.ndarray
    """(S,)"""


@lru_cache(maxsize=64)
def subsets(
    tokens: tuple[tuple[float, ...], ...], shared: bool, price: float, most: int = MOST_SUBSETS
) -> Subsets:
    """All useful subsets of on/off thrusters with columns ``tokens`` (n, d), of at most so many.

    Of subsets that do the same only the one with the least thrust stays. With a shared supply every open thruster
    gives its share of full force, 1 over their number.
    """
    columns = np.array(tokens)
    # By their numbers, so that a layout is the same however its thrusters are numbered.
    order = np.lexsort(columns.T[::-1])
    ordered = columns[order]
    # All subsets, or those with few open thrusters.
    count = len(ordered)
    largest = count
    while sum(math.comb(count, k) for k in range(largest + 1)) > most:
        largest -= 1
    masks = np.array(
        [
            [k in subset for k in range(count)]
            for size in range(largest + 1)
            for subset in map(set, itertools.combinations(range(count), size))
        ],
        dtype=int,
    ).reshape(-1, count)
    masks = masks[np.lexsort(masks.T)]  # as binary numbers, whose last thruster counts most
    shares = masks / np.maximum(masks.sum(axis=1, keepdims=True), 1) if shared else masks
    # Sums one column after the other, so that their bits do not depend on a library's order.
    pushing = (columns.shape[1] + 1) // 2
    twist = np.zeros((len(masks), columns.shape[1]))
    thrust = np.zeros(len(masks))
    for k, column in enumerate(ordered):
        twist = twist + shares[:, k : k + 1] * column
        thrust = thrust + shares[:, k] * math.hypot(*column[:pushing])
    # Of equal twists the cheapest, which comes first.
    cheapest = np.lexsort((np.arange(len(masks)), thrust))
    rounded = np.round(twist[cheapest] / _EQUAL).astype(np.int64)
    _, first = np.unique(rounded, axis=0, return_index=True)
    kept = np.sort(cheapest[np.sort(first)])
    opened = np.zeros((len(kept), count))
    opened[:, order] = masks[kept]
    return Subsets(
        opened,
        twist[kept],
        2.0 * twist[kept],
        -np.square(twist[kept]).sum(axis=1) - price * thrust[kept],
    )
