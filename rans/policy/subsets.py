"""Ways to open on/off thrusters together whose effects differ."""

from __future__ import annotations

import itertools
import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

MOST_SUBSETS = 4096
"""Largest number of subsets that are compared: all of 12 thrusters; of more, those with few open and those that
come nearest to demands of every kind."""
_FEW = 1 / 3
"""Part of them that have the fewest thrusters open: small demands need these."""
_ENOUGH_OPEN = {2: math.inf, 3: 4}
"""Open thrusters up to which all subsets are enough, by number of directions: the agent for any craft in space was
trained with four of up to 16, and spends a tenth more thrust with others."""
_EQUAL = 1e-6
"""Difference of twists, in units of the authority, up to which two subsets do the same."""
_TRIED_AT = 0.1
"""Price of a unit of velocity change in the search for these subsets: that of the agent for any craft."""


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
    masks = _candidates(tuple(map(tuple, ordered.tolist())), shared, most)
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


@lru_cache(maxsize=64)
def _candidates(columns: tuple[tuple[float, ...], ...], shared: bool, most: int) -> np.ndarray:
    """(S, n) Subsets to be compared: all, or of many thrusters those with few open and those of most effect."""
    count, size = len(columns), len(columns[0])
    if 2**count <= most:
        return _with_fewest_open(count, most)
    few = _with_fewest_open(count, most)
    if few[-1].sum() >= _ENOUGH_OPEN[(size + 1) // 2]:
        return few
    few = _with_fewest_open(count, int(most * _FEW))
    best = _best_subsets(
        _demands(min(most, MOST_SUBSETS), np.array(columns)), np.array(columns), shared
    )
    # Each once, those of few open thrusters first.
    both = np.concatenate([few, best])
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


def _demands(number: int, columns: np.ndarray) -> np.ndarray:
    """(number, d) Demands of every direction and size up to what all thrusters do, small ones more often.

    They are points of Roberts' sequence, which fills a cube evenly and is the same on every machine.
    """
    size = columns.shape[1]
    root = 2.0
    for _ in range(64):  # of x^(d + 1) = x + 1
        root = (1.0 + root) ** (1.0 / (size + 1.0))
    points = np.outer(np.arange(1.0, number + 1.0), root ** -np.arange(1.0, size + 1.0))
    signed = 2.0 * ((0.5 + points) % 1.0) - 1.0
    largest = np.maximum(columns.clip(min=0.0).sum(axis=0), -columns.clip(max=0.0).sum(axis=0))
    return signed * np.abs(signed) * largest


def _best_subsets(demands: np.ndarray, columns: np.ndarray, shared: bool) -> np.ndarray:
    """(M, n) A subset for each demand (M, d), by moving the valve that lowers its cost most until none does.

    The cost is that of `subsets`. Of valves that are equal but for rounding the first is moved, so that every
    machine finds the same.
    """
    count = len(columns)
    force = np.linalg.norm(columns[:, : (columns.shape[1] + 1) // 2], axis=1)
    gram, asked = columns @ columns.T, demands @ columns.T
    opened = np.zeros((len(demands), count), dtype=int)
    cost = np.zeros(len(demands))
    rows = np.arange(len(demands))
    while len(rows):
        chosen = opened[rows]
        sign = 1 - 2 * chosen
        sums = chosen @ gram
        # Squared twist, its product with the demand, thrust and number of open valves: now, and what a valve adds.
        now = (
            (sums * chosen).sum(axis=1),
            (asked[rows] * chosen).sum(axis=1),
            chosen @ force,
            chosen.sum(axis=1),
        )
        added = (2.0 * sign * sums + np.diag(gram), sign * asked[rows], sign * force, sign)
        square, product, thrust, number = (x[:, None] + y for x, y in zip(now, added, strict=True))
        share = 1.0 / np.maximum(number, 1) if shared else 1.0
        costs = share * (share * square - 2.0 * product + _TRIED_AT * thrust)
        least = costs.min(axis=1)
        better = least < cost[rows] - _EQUAL
        first = np.argmax(costs <= least[:, None] + _EQUAL, axis=1)[better]
        rows = rows[better]
        cost[rows] = least[better]
        opened[rows, first] ^= 1
    return opened
