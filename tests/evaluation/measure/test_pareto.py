"""Indicators of fronts against brute force and by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rans.evaluation.measure.pareto import epsilon_indicator, hypervolume

SIDE = 12
points = hnp.arrays(
    float, st.tuples(st.integers(1, 6), st.just(2)), elements=st.integers(1, SIDE).map(float)
)


def covers(few: np.ndarray, reference: np.ndarray, factor: float) -> bool:
    """Whether each point of a reference set times a factor has a point that is as good in both coordinates."""
    return all(any((a <= factor * b).all() for a in few) for b in reference)


@given(points, points)
def test_epsilon_is_the_least_factor_that_covers(few: np.ndarray, reference: np.ndarray) -> None:
    factor = epsilon_indicator(few, reference)
    assert covers(few, reference, factor * (1.0 + 1e-9))
    assert not covers(few, reference, factor * (1.0 - 1e-9))


@given(points)
def test_hypervolume_counts_the_cells_of_a_grid(few: np.ndarray) -> None:
    """Points of whole numbers dominate whole cells, which can be counted one by one."""
    cells = sum(any(a[0] <= x and a[1] <= y for a in few) for x in range(SIDE) for y in range(SIDE))
    assert hypervolume(few, np.array([SIDE, SIDE])) == pytest.approx(cells)


def test_who_never_arrives_covers_nothing() -> None:
    never = np.array([[math.inf, math.inf]])
    assert epsilon_indicator(never, np.array([[1.0, 1.0]])) == math.inf
    assert hypervolume(never, np.array([2.0, 2.0])) == 0.0
