"""Random layouts of thrusters: what they can do, by linear programs; no shipped craft is among them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from rans.fast.learn.demands import draw_pool
from rans.model.spacecraft_file import load_spacecraft
from rans.randomization.layouts import (
    authority_margin,
    canonical,
    layouts,
    sample_layout,
)

PLANAR = (
    "astrobee-granite",
    "atmos",
    "floating-platform",
    "floating-platform-air-tank",
    "floating-platform-shared",
    "freeflyer2",
    "pingu",
    "roboran-platform",
)


def columns_of(name: str) -> np.ndarray:
    craft = load_spacecraft(name)
    assert craft.dimension == 2
    return np.array(craft.wrench_map) / np.array([craft.mass, craft.mass, craft.inertia[2][2]])


def test_every_drawn_layout_reaches_every_direction_of_twist() -> None:
    random = np.random.default_rng(3)
    counts = set()
    for columns in layouts(60, seed=11):
        counts.add(len(columns))
        directions = random.normal(size=(6, 3))
        for wanted in directions:
            found = linprog(np.ones(len(columns)), A_eq=columns.T, b_eq=wanted, bounds=(0.0, None))
            assert found.success
    assert {6, 8, 12} <= counts <= set(range(4, 13))


def test_a_layout_is_the_same_in_every_longer_draw() -> None:
    few = list(layouts(3, seed=5))
    many = list(layouts(9, seed=5))
    assert all(np.array_equal(a, b) for a, b in zip(few, many, strict=False))


def test_a_layout_that_cannot_turn_one_way_has_no_margin() -> None:
    # Four thrusters that push every way and turn to the left only.
    wheel = np.array([[1.0, 0.0, 0.3], [0.0, 1.0, 0.3], [-1.0, 0.0, 0.3], [0.0, -1.0, 0.3]])
    assert authority_margin(wheel) == pytest.approx(0.0, abs=1e-9)
    both = np.vstack([wheel, wheel * [1.0, 1.0, -1.0]])
    assert authority_margin(both) > 1.0


def test_layouts_are_equal_up_to_order_turn_mirror_and_units() -> None:
    random = np.random.default_rng(0)
    columns = sample_layout(random)
    angle = 0.7
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    image = np.column_stack([columns[:, :2] @ turn * 3.0, columns[:, 2] * 5.0])
    image = random.permutation(image) * [1.0, 1.0, 1.0]
    mirrored = image @ np.diag([1.0, -1.0, -1.0])
    assert canonical(columns) & canonical(image)
    assert canonical(columns) & canonical(mirrored)
    # A torque that is two percent larger is another craft.
    other = image.copy()
    other[0, 2] *= 1.05
    assert not canonical(columns) & canonical(other)


def test_no_shipped_craft_is_drawn_in_the_training() -> None:
    shipped = [canonical(columns_of(name), digits=2) for name in PLANAR]
    pool = draw_pool(300, 0)
    for row in pool.columns.double().numpy():
        drawn = canonical(row[np.abs(row).max(axis=1) > 0.0], digits=2)
        assert not any(drawn & tables for tables in shipped)
    # Without being held out some are drawn, and the test would notice.
    random = np.random.default_rng(0)
    planted = random.permutation(columns_of("pingu")) * [1.0, -1.0, -1.0] * [2.0, 2.0, 7.0]
    assert any(canonical(planted, digits=2) & tables for tables in shipped)
