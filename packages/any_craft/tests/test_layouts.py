"""Random layouts of thrusters: what they can do, by linear programs; no shipped craft is among them."""

from __future__ import annotations

import numpy as np
import pytest
from rans_any_craft.layouts import IN_SPACE, LayoutRanges, canonical, sample_layout
from scipy.optimize import linprog

from rans.model.twists import authority_margin
from tests.support.layouts import columns_of


def layouts(count: int, seed: int, ranges: LayoutRanges) -> list[np.ndarray]:
    random = np.random.default_rng(seed)
    return [sample_layout(random, ranges) for _ in range(count)]


@pytest.mark.parametrize(
    ("ranges", "counts"),
    [(LayoutRanges(), set(range(4, 13))), (IN_SPACE, set(range(7, 23)))],
)
def test_every_drawn_layout_reaches_every_direction_of_twist(
    ranges: LayoutRanges, counts: set[int]
) -> None:
    random = np.random.default_rng(3)
    found = set()
    for columns in layouts(30, 11, ranges):
        found.add(len(columns))
        for wanted in random.normal(size=(3, columns.shape[1])):
            flown = linprog(np.ones(len(columns)), A_eq=columns.T, b_eq=wanted, bounds=(0.0, None))
            assert flown.success
    assert len(found) > 5
    assert found <= counts


@pytest.mark.parametrize("ranges", [LayoutRanges(), IN_SPACE])
def test_the_margin_is_the_least_support_over_all_directions(ranges: LayoutRanges) -> None:
    """No direction of many has a smaller one, and descent from the best of them comes near it."""
    random = np.random.default_rng(7)
    for columns in layouts(3, 2, ranges):
        pushing = {3: 2, 6: 3}[columns.shape[1]]
        forces = np.linalg.norm(columns[:, :pushing], axis=1)
        torques = np.linalg.norm(columns[:, pushing:], axis=1)
        scaled = columns.copy()
        scaled[:, :pushing] /= forces[forces > 0.0].mean()
        scaled[:, pushing:] /= np.sqrt(np.square(torques[torques > 0.0]).mean())

        def support(ways: np.ndarray, scaled: np.ndarray = scaled) -> np.ndarray:
            unit = ways / np.linalg.norm(ways, axis=1, keepdims=True)
            return np.maximum(unit @ scaled.T, 0.0).sum(axis=1)

        best = random.normal(size=(4000, columns.shape[1]))
        assert support(best).min() >= authority_margin(columns) - 1e-9
        for size in 0.5 ** np.arange(1, 16):
            best = best[np.argsort(support(best))[:40]]
            best = best / np.linalg.norm(best, axis=1, keepdims=True)
            steps = size * random.normal(size=(50, *best.shape))
            best = np.vstack([best, (best + steps).reshape(-1, columns.shape[1])])
        assert support(best).min() == pytest.approx(authority_margin(columns), rel=0.02)


def test_wheels_are_two_columns_without_a_force() -> None:
    drawn = layouts(24, 4, IN_SPACE)
    wheels = [columns[np.abs(columns[:, :3]).max(axis=1) == 0.0] for columns in drawn]
    assert {len(one) for one in wheels} == {0, 6}
    for one in wheels:
        assert np.array_equal(one[:3], -one[3:]) or not len(one)


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


def test_a_layout_in_space_is_equal_up_to_order_turn_mirror_and_units() -> None:
    random = np.random.default_rng(0)
    columns = columns_of("astrobee-iss")
    turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    image = np.column_stack([columns[:, :3] @ turn.T * 3.0, columns[:, 3:] @ turn.T * 5.0])
    assert canonical(columns) & canonical(random.permutation(image))
    # In a mirror forces along z, and torques about x and y, are reversed.
    mirrored = columns * [1.0, 1.0, -1.0, -1.0, -1.0, 1.0]
    assert canonical(columns) & canonical(random.permutation(mirrored))
    other = columns.copy()
    other[0, 3:] *= 1.1
    assert not canonical(columns) & canonical(other)
