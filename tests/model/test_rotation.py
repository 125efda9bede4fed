"""Rotations by series, against SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from rans.model.dynamics import RULES
from rans.model.fields import Vec3, leaves
from rans.model.rotation import Rotation as Step, exponential, pulled, turned


@pytest.mark.parametrize(("angle", "error"), [(0.1, 1e-15), (1.0, 4e-8), (-1.0, 4e-8)])
def test_a_turn_is_that_of_scipy(angle, error):
    """What the series leave out at 1 rad is 1 / 11! of the sine, 1 / 12! of the cosine."""
    random = np.random.default_rng(1)
    axes = random.normal(size=(50, 3))
    axes *= angle / np.linalg.norm(axes, axis=1, keepdims=True)
    vectors = random.normal(size=(50, 3))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    theirs = Rotation.from_rotvec(axes)
    found = np.transpose(turned(Vec3(*axes.T), Vec3(*vectors.T)).columns())
    np.testing.assert_allclose(found, theirs.apply(vectors), rtol=0, atol=error)
    quaternions = np.transpose(leaves(exponential(Vec3(*axes.T))))
    expected = theirs.as_quat(scalar_first=True)
    np.testing.assert_allclose(quaternions, expected, rtol=0, atol=error)


def test_a_step_of_a_changing_rate_turns_as_scipy_integrates():
    """In half the time the error falls by 2^7 at the end and by 2^6 within it."""
    coefficients = np.random.default_rng(2).normal(size=(4, 3))
    shares = (0.3, 0.5, 0.8, 1.0)

    def rates(time: float, q: np.ndarray) -> list[float]:
        a, b, c = 0.5 * (coefficients * time ** np.arange(4.0)[:, None]).sum(axis=0)
        s, x, y, z = q
        return [
            -x * a - y * b - z * c,
            s * a + y * c - z * b,
            s * b + z * a - x * c,
            s * c + x * b - y * a,
        ]

    errors = []
    for duration in (0.4, 0.2):
        times = [share * duration for share in shares]
        precise = {"rtol": 1e-13, "atol": 1e-15}
        solved = solve_ivp(rates, (0.0, duration), [1, 0, 0, 0], t_eval=times, **precise)
        expected = Rotation.from_quat(solved.y.T, scalar_first=True).as_rotvec()
        step = Step([Vec3(*row * duration**k) for k, row in enumerate(coefficients)], duration)
        found = np.array([leaves(step.vector(share)) for share in shares])
        errors.append(np.abs(found - expected).max(axis=1))
    ratios = errors[0] / errors[1]
    assert (ratios[:3] > 40.0).all()
    assert ratios[3] > 80.0
    assert errors[0].max() < 1e-4


def test_a_torque_of_the_world_that_grows_is_integrated_twice():
    """2 N m from 1 to 1.5 times as large: once 2 (1 + 0.5 / 2), twice 2 (1 / 2 + 0.5 / 6); 3 N m of B beside it."""
    still = Vec3(0.0, 0.0, 0.0)
    turns = [(still, node, weight) for node, weight in RULES[3]]
    steady = [Vec3(0.0, 0.0, 2.0)] * 3
    once, twice = pulled([Vec3(0.0, 0.0, 3.0)], turns, steady, (1.0, 0.5))
    assert leaves(once) == pytest.approx([0.0, 0.0, 2.5 + 3.0])
    assert leaves(twice) == pytest.approx([0.0, 0.0, 7.0 / 6.0 + 1.5])
