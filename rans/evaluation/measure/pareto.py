"""Indicators for the comparison of sets of points whose coordinates are all to be minimised (Pareto fronts).

Both are those of E. Zitzler, L. Thiele, M. Laumanns, C. M. Fonseca and V. Grunert da Fonseca, "Performance
assessment of multiobjective optimizers: an analysis and review", IEEE Trans. Evol. Comput. 7(2), 2003,
https://doi.org/10.1109/TEVC.2003.810758.
"""

from __future__ import annotations

import math

import numpy as np


def epsilon_indicator(points: np.ndarray, reference: np.ndarray) -> float:
    """Multiplicative epsilon indicator of a set of points against a reference set.

    The least factor such that every point of the reference set, multiplied by it, is weakly dominated by a
    point of the set: max over b of the reference, min over a of the set, max over coordinates i of a_i / b_i.
    It is 1 or less if the set weakly dominates the whole reference.

    Args:
        points: (N, d), positive; infinite coordinates dominate nothing.
        reference: (M, d), positive and finite.

    Returns:
        The factor; infinite if no point is finite.
    """
    finite = points[np.isfinite(points).all(axis=1)]
    if not len(finite):
        return math.inf
    ratios = (finite[None, :, :] / reference[:, None, :]).max(axis=2)
    return float(ratios.min(axis=1).max())


def hypervolume(points: np.ndarray, corner: np.ndarray) -> float:
    """Area that a set of points in the plane dominates, up to a corner.

    Args:
        points: (N, 2); those beyond the corner dominate nothing.
        corner: (2,) the worst values that count.
    """
    inside = points[(points < corner).all(axis=1)]
    area = 0.0
    lowest = float(corner[1])
    for x, y in inside[np.lexsort((inside[:, 1], inside[:, 0]))]:
        if y < lowest:
            area += (float(corner[0]) - x) * (lowest - y)
            lowest = float(y)
    return area
