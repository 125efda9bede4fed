"""Coordinates around a goal against SciPy's rotations; both directions undo each other."""

import numpy as np
import pytest
from rans_optimal.mpc import shortest
from scipy.spatial.transform import Rotation

from rans.model.coordinates import around, coordinates
from rans.model.fields import leaves, map_leaves
from tests.support.crafts import random_states

BOTH = pytest.mark.parametrize("dimension", [2, 3])


@BOTH
def test_there_and_back(dimension):
    state, goal = (random_states(dimension, 50, seed) for seed in (1, 2))
    back = around(goal, shortest(state, goal))
    np.testing.assert_allclose((back.p - state.p).norm(), 0.0, atol=1e-14)
    np.testing.assert_allclose((back.v - state.v).norm(), 0.0, atol=1e-14)
    np.testing.assert_allclose(np.array(back.spin()) - np.array(state.spin()), 0.0, atol=1e-14)
    # the square root of 1e-24 that keeps roots differentiable
    np.testing.assert_allclose(back.attitude.to(state.attitude).magnitude(), 0.0, atol=1e-11)


@BOTH
def test_smooth_ones_go_beyond_half_a_turn(dimension):
    goal = random_states(dimension, 40, 3)
    generator = np.random.default_rng(4)
    given = generator.uniform(-1, 1, (6 if dimension == 2 else 12, 40))
    turn = given[2:3] if dimension == 2 else given[3:6]
    turn *= generator.uniform(0.5, 6.0, 40) / np.linalg.norm(
        turn, axis=0
    )  # up to nearly a full turn
    np.testing.assert_allclose(coordinates(around(goal, given), goal), given, atol=1e-9)


def test_rotation_is_scipys():
    state, goal = (random_states(3, 30, seed) for seed in (5, 6))
    ours = shortest(state, goal)[3:6]
    scipy = [
        Rotation.from_quat(np.roll(np.array(leaves(s.attitude)), -1, axis=0).T)
        for s in (goal, state)
    ]
    np.testing.assert_allclose(ours.T, (scipy[0].inv() * scipy[1]).as_rotvec(), atol=1e-12)


@BOTH
def test_no_coordinates_at_the_goal(dimension):
    goal = random_states(dimension, 5, 7)
    np.testing.assert_allclose(shortest(map_leaves(np.copy, goal), goal), 0.0, atol=1e-15)
