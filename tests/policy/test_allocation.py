"""Control allocation against brute force, bounded least squares of SciPy, and linear programs."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from rans.model.authority import authorities
from rans.model.spacecraft_file import load_spacecraft
from rans.model.twists import balanced
from rans.policy.allocation import PRICE, shares, subsets
from rans.randomization.layouts import LayoutRanges, sample_layout


def drawn(seed: int, most: int = 8) -> np.ndarray:
    columns = sample_layout(np.random.default_rng(seed), LayoutRanges(most=most))
    ways = balanced(columns)
    return columns / [min(ways[:4]), min(ways[:4]), min(ways[4:])]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("shared", [False, True])
def test_the_chosen_subset_is_the_best_of_all(seed: int, shared: bool) -> None:
    columns = drawn(seed)
    chosen = subsets(tuple(map(tuple, columns.tolist())), shared)
    demands = np.random.default_rng(seed + 100).normal(size=(60, 3)) * 1.5
    found = chosen.opened[np.argmax(demands @ chosen.slope.T + chosen.offset, axis=1)]

    def cost(opened: np.ndarray, demand: np.ndarray) -> float:
        share = opened / max(opened.sum(), 1.0) if shared else opened
        error = share @ columns - demand
        return float(error @ error + PRICE * (share @ np.hypot(columns[:, 0], columns[:, 1])))

    every = [np.array(x) for x in itertools.product((0.0, 1.0), repeat=len(columns))]
    for demand, opened in zip(demands, found, strict=True):
        # A float64 sum in another order, and twists that count as equal, differ by this much.
        assert cost(opened, demand) <= min(cost(x, demand) for x in every) + 1e-4


@pytest.mark.parametrize("seed", range(6))
def test_subsets_follow_the_order_of_the_thrusters(seed: int) -> None:
    columns = drawn(seed)
    order = np.random.default_rng(seed).permutation(len(columns))
    here = subsets(tuple(map(tuple, columns.tolist())), False)
    there = subsets(tuple(map(tuple, columns[order].tolist())), False)
    assert np.array_equal(here.slope, there.slope)
    assert np.array_equal(here.offset, there.offset)
    assert np.array_equal(here.opened[:, order], there.opened)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_continuous_shares_are_near_bounded_least_squares(seed: int) -> None:
    columns = drawn(seed)
    thrust = np.hypot(columns[:, 0], columns[:, 1])
    # The price is one more row: |B u - d|^2 + p c u is that of a linear program's term, minimised exactly by
    # many passes.
    for demand in np.random.default_rng(seed).normal(size=(12, 3)):
        few = np.array(shares(list(demand), columns), dtype=float)
        many = np.array(shares(list(demand), columns, passes=400), dtype=float)

        def cost(u: np.ndarray, demand: np.ndarray = demand) -> float:
            error = columns.T @ u - demand
            return float(error @ error + PRICE * (thrust @ u))

        exact = lsq_linear(columns.T, demand, bounds=(0.0, 1.0)).x
        assert cost(many) <= cost(exact) + 1e-6
        free = np.array(shares(list(demand), columns, price=0.0, passes=2000), dtype=float)
        residual = np.linalg.norm(columns.T @ free - demand)
        assert residual == pytest.approx(np.linalg.norm(columns.T @ exact - demand), abs=1e-3)
        # What a few passes leave is demanded again in the next period.
        assert cost(few) <= cost(many) + 0.25 * float(demand @ demand)


@pytest.mark.parametrize(
    "name",
    [
        "astrobee-granite",
        "floating-platform",
        "floating-platform-shared",
        "freeflyer2",
        "atmos-orbit-16",
        "free-flyer-shared",
        "spheres",
        "cubesat-3u",
    ],
)
def test_balanced_authority_is_that_of_linear_programs(name: str) -> None:
    craft = load_spacecraft(name)
    columns = np.array(craft.wrench_map)
    # A wheel is a column of torque either way.
    torques = np.array(craft.wheel_map).reshape(-1, craft.degrees_of_freedom - craft.dimension)
    turning = np.column_stack([np.zeros((len(torques), craft.dimension)), torques])
    columns = np.vstack([columns, turning, -turning])
    found = balanced(columns, craft.thrust_sharing == "split")
    expected = [x for one in authorities(craft) for x in (one.forwards, one.backwards)]
    assert found == pytest.approx(expected, rel=1e-6)


def test_a_craft_that_cannot_push_alone_has_no_authority() -> None:
    tangential = np.array([[1.0, 0.0, 0.3], [0.0, 1.0, 0.3], [-1.0, 0.0, 0.3], [0.0, -1.0, 0.3]])
    assert math.isclose(balanced(tangential)[5], 0.0, abs_tol=1e-12)
