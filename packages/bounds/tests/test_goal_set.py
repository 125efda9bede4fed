"""Goal sets and pulses of certificates."""

import dataclasses
import math

import pytest
from rans_bounds.goal_set import pulse

from rans.evaluation.compare.bounds import rounded_up
from rans.model.spacecraft_file import load_spacecraft
from tests.support.tiny_lattice import lopsided

PLATFORM = load_spacecraft("floating-platform")


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        (0.0, 0.2, 0.0),
        (-1.0, 0.2, 0.0),
        (0.01, 0.2, 0.2),
        (0.2, 0.2, 0.2),
        (0.6, 0.2, 0.6),
        (0.601, 0.2, 0.8),
        (43 * 0.2, 0.2, 8.6),
        (math.inf, 0.2, math.inf),
    ],
)
def test_rounded_up(value, unit, expected):
    """0.6 / 0.2 is 2.9999999999999996 and 0.6000000000000001 / 0.2 is 3.0000000000000004."""
    assert rounded_up(value, unit) == pytest.approx(expected)
    assert rounded_up(3 * 0.2, 0.2) == pytest.approx(0.6)


def test_pulses_of_a_craft():
    assert pulse(PLATFORM, 0.25) == pytest.approx(0.25)
    assert pulse(dataclasses.replace(PLATFORM, thrust_sharing="split"), 0.25) == pytest.approx(0.25)
    assert pulse(lopsided(), 0.25) is None
