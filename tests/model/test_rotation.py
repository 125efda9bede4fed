"""Rotations in space against SciPy's rotations and its integrator."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation as Turn

from rans.model.fields import Vec3
from rans.model.rotation import exponential, turned

AXIS = np.array([2.0, -3.0, 6.0]) / 7.0


@pytest.mark.parametrize("angle", [1e-9, 0.05, 0.4, 1.0])
def test_a_rotation_vector_turns_as_scipy_says(angle: float) -> None:
    """The series leave out x^11 / 11! of a sine and x^12 / 12! of a cosine; rounding is beside it."""
    vector = angle * AXIS
    v = np.array([0.3, 1.0, -0.7])
    whole, half = (
        x**11 / math.factorial(11) + x**12 / math.factorial(12) for x in (angle, angle / 2)
    )
    found = turned(Vec3(*vector), Vec3(*v)).columns()
    np.testing.assert_allclose(
        found, Turn.from_rotvec(vector).apply(v), rtol=0, atol=1.3 * whole + 1e-15
    )
    q = exponential(Vec3(*vector))
    true = Turn.from_rotvec(vector).as_quat()
    np.testing.assert_allclose((q.x, q.y, q.z, q.w), true, rtol=0, atol=half + 1e-15)
