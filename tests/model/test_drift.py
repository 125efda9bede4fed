"""Drifts, and what is carried by them, against SciPy's integrator of the equations they solve."""

import itertools

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from rans.model.drift import ClohessyWiltshire, FreeFlight, step_goal
from rans.model.fields import Vec2, Vec3, leaves
from tests.support.crafts import random_states

LOW_ORBIT = 0.00113
"""rad/s."""


@pytest.mark.parametrize("dimension", [2, 3])
def test_goals_drift_and_spin(dimension):
    goal = random_states(dimension, 1, 5)
    drift = ClohessyWiltshire(0.2)
    later = step_goal(goal, drift, 3.0)
    many = goal
    for _ in range(10):
        many = step_goal(many, drift, 0.3)
    np.testing.assert_allclose(leaves(many), leaves(later), rtol=0, atol=1e-13)
    if dimension == 2:
        assert later.attitude.angle == pytest.approx(goal.attitude.angle + 3.0 * goal.w)
        return
    w, x, y, z = (q[0] for q in leaves(goal.attitude))
    expected = Rotation.from_quat([x, y, z, w]) * Rotation.from_rotvec(
        [3.0 * s[0] for s in leaves(goal.w)]
    )
    w, x, y, z = (q[0] for q in leaves(later.attitude))
    assert (expected.inv() * Rotation.from_quat([x, y, z, w])).magnitude() < 1e-14


@pytest.mark.parametrize("vector", [Vec2, Vec3])
def test_a_kick_is_a_coast_from_the_origin(vector):
    v = vector(*np.array([[0.3, -0.2], [0.1, 0.4], [-0.5, 0.2]])[: 2 if vector is Vec2 else 3])
    orbits = (ClohessyWiltshire(0.00113), FreeFlight())
    for drift, t in itertools.product(orbits, (7.5, np.array([7.5, 900.0]))):
        changes = drift.kicked(v, t)
        coast = drift.carry(v.scale(0.0), v, t)
        for change, end in zip(changes, coast, strict=True):
            np.testing.assert_array_equal(change.columns(), end.columns())


@pytest.mark.slow
def test_torch_compiles_a_coast_without_a_warning():
    """Warnings are errors here, and torch has one for functions that remember results."""
    drift = ClohessyWiltshire(LOW_ORBIT)

    def coast(x):
        p, v = drift.carry(Vec3(x, x, x), Vec3(x, x, x), 5.0)
        q, _ = drift.kicked(v, 2.5)
        return p.x + q.y

    x = torch.linspace(-1.0, 1.0, 5)
    torch.compiler.reset()
    compiled = torch.compile(coast, fullgraph=True, backend="eager")
    torch.testing.assert_close(compiled(x), coast(x))
