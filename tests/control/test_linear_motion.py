"""Linear motion between controls against the exponential of its equations."""

import numpy as np
import pytest
from scipy.linalg import expm

from rans.control.linear_motion import LinearMotion
from rans.model.drift import FREE, ClohessyWiltshire, UniformGravity
from tests.support.clohessy_wiltshire import orbit

ORBIT = ClohessyWiltshire(0.05)
"""Forty times as fast as a low orbit, so that the drift matters within a minute."""
SLOPE = UniformGravity((0.05, -0.08))
"""A floor that is tilted by half a degree."""


@pytest.mark.parametrize("time", [0.2, 30.0])
def test_linear_motion_is_the_exponential_of_the_equations(time):
    """Van Loan's matrix gives the effect of a constant acceleration as well."""
    joined = np.zeros((9, 9))
    joined[:6, :6] = orbit(0.05)
    joined[3:6, 6:] = np.eye(3)
    whole = expm(joined * time)
    found = LinearMotion.of(ORBIT, 3, time)
    np.testing.assert_allclose(found.matrix, whole[:6, :6], rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(found.effect, whole[:6, 6:], rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(found.offset, 0.0)


def test_gravity_is_an_offset():
    found = LinearMotion.of(SLOPE, 2, 2.0)
    np.testing.assert_allclose(found.offset, [0.1, -0.16, 0.1, -0.16], atol=1e-15)
    np.testing.assert_allclose(found.matrix, LinearMotion.of(FREE, 2, 2.0).matrix, atol=1e-15)
