"""Rotations in space against SciPy's rotations and its integrator."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation as Turn

from rans.model.fields import Vec3
from rans.model.rotation import Rotation, at, exponential, spin_series, turned

AXIS = np.array([2.0, -3.0, 6.0]) / 7.0
MOMENTS = Turn.from_rotvec([0.5, -0.8, 0.3]).as_matrix()
TENSOR = MOMENTS @ np.diag([0.21, 0.34, 0.47]) @ MOMENTS.T
SPIN = np.array([0.3, -0.2, 0.4])
TORQUE = np.array([0.02, 0.05, -0.03])
STEADY = np.array([-0.04, 0.01, 0.02])


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


@pytest.mark.parametrize(
    "steady", [None, STEADY], ids=["thrust", "thrust and a torque that stays in W"]
)
def test_spin_and_attitude_follow_eulers_equation(steady: np.ndarray | None) -> None:
    """0.1 s at 0.5 rad/s: eight terms leave 1e-12 of the spin, an attitude of order six some 1e-10."""
    inverse = np.linalg.inv(TENSOR)
    pull = np.zeros(3) if steady is None else steady

    def slope(_: float, y: np.ndarray) -> np.ndarray:
        w = y[:3]
        matrix = y[3:].reshape(3, 3)
        torque = TORQUE + matrix.T @ pull - np.cross(w, TENSOR @ w)
        return np.concatenate([inverse @ torque, (matrix @ np.cross(w, np.eye(3)).T).ravel()])

    first = np.concatenate([SPIN, np.eye(3).ravel()])
    end = solve_ivp(slope, (0.0, 0.1), first, "DOP853", rtol=1e-13, atol=1e-14)
    moments = tuple(float(x) for x in TENSOR[np.triu_indices(3)])
    seen = None if steady is None else Vec3(*steady)
    rate = spin_series(Vec3(*SPIN), [Vec3(*TORQUE)], moments, 0.1, seen)
    np.testing.assert_allclose(at(rate, 1.0).columns(), end.y[:3, -1], rtol=0, atol=1e-12)
    q = exponential(Rotation(rate, 0.1).vector(1.0))
    found = Turn.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    np.testing.assert_allclose(found, end.y[3:, -1].reshape(3, 3), rtol=0, atol=1e-10)
