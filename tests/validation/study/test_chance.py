"""Statistics as checks: what chance gives passes, and what it does not fails, by as much as worked out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from validation.study.chance import (
    all_pairs,
    chance_check,
    even_check,
    independence_check,
    normal_check,
    share_check,
    uniform_check,
)

COUNT = 8192
RANDOM = np.random.default_rng(4)
U = RANDOM.random(COUNT)
NORMAL = RANDOM.standard_normal(COUNT)


@pytest.mark.parametrize(
    ("probability", "decades", "passed"),
    [
        (1.0, 0.0, True),
        (1e-3, 3.0, True),
        (1.1e-8, 7.96, True),
        (1e-9, 9.0, False),
        (0.0, 300.0, False),
        (4.0, 0.0, True),
    ],
)
def test_probabilities_are_told_in_decades(
    probability: float, decades: float, passed: bool
) -> None:
    check = chance_check("x", probability, "Because")
    assert check.value == pytest.approx(decades, abs=0.01)
    assert check.passed is passed


def test_uniform_numbers_pass_within_their_bounds_only() -> None:
    assert uniform_check("x", {"a": (2.0 + 3.0 * U, 2.0, 5.0), "b": (U, 0.0, 1.0)}).passed
    wrong = {
        "crowded": U**1.2,
        "beyond": np.append(U, 1.001),
        "below": np.append(U, -0.001),
        "narrow": 0.05 + 0.9 * U,
        "not a number": np.append(U, math.nan),
    }
    for name, values in wrong.items():
        check = uniform_check("x", {"right": (U, 0.0, 1.0), name: (values, 0.0, 1.0)})
        assert not check.passed, name
        assert check.worst.startswith(name)


def test_whole_numbers_are_even() -> None:
    assert even_check("x", np.floor(5 * U), 5).passed
    assert not even_check("x", np.floor(5 * U), 6).passed  # the last never comes
    assert not even_check("x", np.floor(5 * U), 4).passed  # the last may not come
    assert not even_check("x", np.floor(5 * U**1.2), 5).passed
    assert even_check("x", np.zeros(9), 1).passed
    assert not even_check("x", np.zeros(0), 3).passed


def test_shares_by_hand() -> None:
    """None of 100 where half are due: 2 * 2^-100, 29.8 decades."""
    assert share_check("x", np.zeros(100), 0.5).value == pytest.approx(
        100 * math.log10(2) - math.log10(2)
    )
    assert share_check("x", np.arange(100) < 30, 0.3).passed


def test_normal_numbers_have_their_shape_and_size() -> None:
    assert normal_check("x", 0.3 * NORMAL, 0.3).passed
    assert not normal_check("x", 0.3 * NORMAL, 0.28).passed
    assert not normal_check("x", 0.3 * NORMAL, 0.32).passed
    assert not normal_check("x", math.sqrt(12.0) * (U - 0.5), 1.0).passed
    assert not normal_check("x", NORMAL + 0.1, 1.0).passed
    assert not normal_check("x", np.append(NORMAL, math.nan), 1.0).passed


def test_what_knows_of_another_is_found() -> None:
    columns = {"a": U, "b": NORMAL, "c": U[::-1]}
    assert list(all_pairs(columns)) == ["a and b", "a and c", "b and c"]
    assert independence_check("x", all_pairs(columns)).passed
    for other in (U, -U, NORMAL + 0.15 * U / U.std(), np.zeros(COUNT), np.append(U[1:], math.nan)):
        check = independence_check("x", all_pairs(columns | {"d": other}))
        assert not check.passed
        assert "d" in check.worst
