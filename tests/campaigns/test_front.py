"""Factors of flights to a front, worked by hand."""

import math

import pytest

from campaigns.front import factor


def least(count):
    """A front of 8 N s in 10 periods and 6 N s in 11; nobody arrives before."""
    return math.inf if count < 10 else 8.0 if count == 10 else 6.0


@pytest.mark.parametrize(
    ("periods", "impulse", "expected"),
    [
        (12.6, 8.4, 1.2),  # 10.5 periods and 7 N s are between 8 and 6 N s
        (22, 9.0, 1.5),  # 14.67 periods and 6 N s
        (10, 8.0, 1.0),
        (10, 9.0, 1.0),  # as soon as can be: its time is not divided
    ],
)
def test_both_amounts_are_divided_until_the_front(periods, impulse, expected):
    assert factor(0.2 * periods, impulse, 0.2, least) == pytest.approx(expected)
