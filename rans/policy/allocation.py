"""Control allocation: which commands of a craft come closest to a demanded change of its twist in a control period.

A twist in the plane is (v_x, v_y, w) in B. Every thruster changes it by a column in a period, in the units of the
craft's least authority, so that a demand of 1 along an axis can always be met. On/off thrusters are chosen as the
subset with the least squared error plus a price of its thrust: the search over all subsets is the search for the
largest of linear functions of the demand. Continuous thrusters are found by coordinate descent on the same cost.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rans.model.fields import Field, within

PRICE = 0.1
"""Price of the velocity change that thrusters give, summed over them, in units of squared errors."""
PASSES = 6
"""Times that coordinate descent visits every thruster. Errors that are left are demanded in the next period."""
MOST_SUBSETS = 4096
"""Largest number of subsets that are compared: all of 12 thrusters; of more thrusters those with fewest open."""
_PARALLEL = 1e-9
"""Sine of the angle up to which two directions count as one."""
_EQUAL = 1e-6
"""Difference of twists, in units of the authority, up to which two subsets do the same."""


class Subsets(NamedTuple):
    """Ways to open on/off thrusters, and the linear functions of the demand whose largest one is the best."""

    opened: np.ndarray
    """(S, n) 0 or 1, in the order of the craft's thrusters."""
    twist: np.ndarray
    """(S, 3) change of the twist."""
    slope: np.ndarray
    """(S, 3) of each linear function."""
    offset: np.ndarray
    """(S,)"""


def balanced(columns: np.ndarray, shared: bool = False) -> np.ndarray:
    """Largest twist changes along +x, -x, +y, -y, +turn and -turn, all other axes being balanced, (6,).

    Columns (n, 3) are those of thrusters that are open for a share of the time; ``shared``: the shares sum to 1 at
    most. 0: the axis cannot be pushed alone.

    The twists are a polytope, the projection of the shares: how far it reaches along an axis is the least over its
    facets' normals w of support(w) / w_axis. Every normal is that of a plane along two edges.
    """
    size = np.abs(columns).max(axis=0, initial=0.0)
    if not (size > 0.0).all():
        return np.zeros(6)
    scaled = columns / size
    edges = scaled
    if shared:
        corners = np.vstack([np.zeros((1, 3)), scaled])
        edges = (corners[:, None] - corners).reshape(-1, 3)
    first, second = np.triu_indices(len(edges), 1)
    normals = np.cross(edges[first], edges[second])
    lengths = np.linalg.norm(normals, axis=1)
    normals = normals[lengths > _PARALLEL] / lengths[lengths > _PARALLEL, None]
    normals = np.vstack([normals, -normals])
    along = np.maximum(normals @ scaled.T, 0.0)
    support = along.max(axis=1) if shared else along.sum(axis=1)
    result = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            part = sign * normals[:, axis]
            ahead = part > _PARALLEL
            reach = (support[ahead] / part[ahead]).min() if ahead.any() else 0.0
            result.append(max(0.0, float(reach)) * size[axis])
    return np.array(result)


def in_order(columns: np.ndarray) -> np.ndarray:
    """Order (n,) of columns by their numbers, in which a layout is the same however its thrusters are numbered."""
    return np.lexsort(columns.T[::-1])


@lru_cache(maxsize=64)
def subsets(tokens: tuple[tuple[float, ...], ...], shared: bool, price: float = PRICE) -> Subsets:
    """All useful subsets of on/off thrusters with columns ``tokens`` (n, 3).

    Of subsets that do the same only the one with the least thrust stays. With a shared supply every open thruster
    gives its share of full force, 1 over their number.
    """
    columns = np.array(tokens)
    order = in_order(columns)
    ordered = columns[order]
    # All subsets, or those with few open thrusters.
    count = len(ordered)
    most = count
    while sum(math.comb(count, k) for k in range(most + 1)) > MOST_SUBSETS:
        most -= 1
    masks = (np.arange(2**count)[:, None] >> np.arange(count)) & 1
    masks = masks[masks.sum(axis=1) <= most]
    shares = masks / np.maximum(masks.sum(axis=1, keepdims=True), 1) if shared else masks
    # Sums one column after the other, so that their bits do not depend on a library's order.
    twist = np.zeros((len(masks), 3))
    thrust = np.zeros(len(masks))
    for k, column in enumerate(ordered):
        twist = twist + shares[:, k : k + 1] * column
        thrust = thrust + shares[:, k] * math.hypot(column[0], column[1])
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


def shares(
    demand: Sequence[Field], columns: np.ndarray, price: float = PRICE, passes: int = PASSES
) -> list[Field]:
    """Shares of full force, 0 to 1, of continuous thrusters for a demand of three fields, by coordinate descent.

    Columns are (n, 3). All thrusters begin shut, and are visited in the order of their columns.
    """
    left = list(demand)
    share: list[Field] = [0.0] * len(columns)
    order = in_order(columns)
    for turn in range(passes):
        for k in order:
            column = [float(x) for x in columns[k]]
            square = sum(x * x for x in column)
            if square == 0.0:
                share[k] = left[0] * 0.0
                continue
            offset = 0.5 * price * math.hypot(column[0], column[1]) / square
            # Where the cost is least along this thruster, within its range.
            step = sum(x / square * e for x, e in zip(column, left, strict=True)) - offset
            before = share[k]
            after = within(step if turn == 0 else before + step, 0.0, 1.0)
            change = after if turn == 0 else after - before
            left = [e - x * change for x, e in zip(column, left, strict=True)]
            share[k] = after
    return share
