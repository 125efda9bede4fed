"""Ways to open on/off thrusters together whose effects differ."""

from __future__ import annotations

import itertools
import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

MOST_SUBSETS = 4096
"""Largest number of subsets that are compared: all of 12 thrusters; of more, those with few open and those that
push farthest along directions of every kind."""
_ENOUGH_OPEN = {2: math.inf, 3: 4}
"""Open thrusters up to which all subsets are enough, by number of directions: the agent for any craft in space was
trained with four of up to 16, and spends a tenth more thrust with others."""
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
    count = len(ordered)
    masks = _candidates(ordered, most)
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


def _candidates(columns: np.ndarray, most: int) -> np.ndarray:
    """(S, n) Subsets to be compared: all, or of many thrusters those with few open and those that push farthest."""
    count, size = columns.shape
    few = _with_fewest_open(count, most)
    if few[-1].sum() >= min(count, _ENOUGH_OPEN[(size + 1) // 2]):
        return few
    # Roberts' sequence fills a cube of directions evenly; for each so many thrusters as push along it most.
    root = 2.0
    for _ in range(64):  # of x^(d + 1) = x + 1
        root = (1.0 + root) ** (1.0 / (size + 1.0))
    number = np.arange(most)
    ways = 2.0 * (np.outer(number, root ** -np.arange(1.0, size + 1.0)) % 1.0) - 1.0
    along = np.round((ways * np.abs(columns).sum(axis=0)) @ columns.T, 9)  # equal ones in one order
    place = np.argsort(np.argsort(-along, axis=1, kind="stable"), axis=1)
    opened = (place <= number[:, None] % count) & (along > 0.0)
    both = np.concatenate([_with_fewest_open(count, most // 3), opened.astype(int)])
    _, first = np.unique(both, axis=0, return_index=True)
    return both[np.sort(first)[:most]]


def _with_fewest_open(count: int, most: int) -> np.ndarray:
    """(S, n) Subsets up to the largest number of open thrusters of which all are at most so many."""
    largest = count
    while sum(math.comb(count, k) for k in range(largest + 1)) > most:
        largest -= 1
    return np.array(
        [
            [k in subset for k in range(count)]
            for size in range(largest + 1)
            for subset in map(set, itertools.combinations(range(count), size))
        ],
        dtype=int,
    ).reshape(-1, count)
