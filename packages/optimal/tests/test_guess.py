"""The optimiser's first guess is a real motion: its rates are the derivatives of its path."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rans_optimal.guess import guess, rotation_vector
from scipy.spatial.transform import Rotation

from rans import GoToPose
from rans.episode.scenario import scenario
from rans.model.fields import Quat, leaves
from rans.tasks.goal_set import aims


def test_rotation_vector_of_quaternions_is_scipys():
    rotations = Rotation.random(200, rng=np.random.default_rng(3))
    x, y, z, w = rotations.as_quat().T  # SciPy leaves the sign open, so both signs occur
    assert (w < 0).any()
    np.testing.assert_allclose(
        rotation_vector(Quat(w, x, y, z)).T, rotations.as_rotvec(), atol=1e-13
    )


POSE = aims(GoToPose())


@pytest.mark.parametrize("number", [0, 1, 2, 3])
@pytest.mark.parametrize("dimension", [2, 3])
def test_guess_is_a_motion_from_start_to_goal(dimension, number):
    duration = 7.0
    count = 2000
    start = scenario(GoToPose(), dimension, 1, 4)  # type: ignore[arg-type]
    path = guess(POSE, start.start, start.goal, duration, count, number)
    places = dimension + (1 if dimension == 2 else 4)
    p, attitude, v, w = np.split(path, [dimension, places, places + dimension])
    np.testing.assert_allclose(p[:, -1], start.goal.p.columns(), atol=1e-12)  # type: ignore[union-attr]
    step = duration / count
    # central differences are off by step^2 / 6 times the third derivative, below 1e-5 here
    np.testing.assert_allclose((p[:, 2:] - p[:, :-2]) / (2 * step), v[:, 1:-1], atol=1e-5)
    rotation = _rotations(attitude)
    turned = (rotation[:-2].inv() * rotation[2:]).as_rotvec()[:, -len(w) :].T
    np.testing.assert_allclose(turned / (2 * step), w[:, 1:-1], atol=1e-5)
    goal = _rotations(np.array([leaves(start.goal.attitude)]).T)
    assert (rotation[-1:].inv() * goal).magnitude()[0] < 1e-7  # arccos halves the digits
    # Odd numbers turn the other way round: to the other of two quaternions, or a heading 2 pi away.
    first = leaves(start.start.attitude)
    if dimension == 2:
        assert (abs(attitude[0, -1] - first[0]) > math.pi) == (number in (1, 3))
    else:
        is_far = np.dot(attitude[:, -1], first) < 0.0
        assert is_far == (number in (1, 3))


def _rotations(rows: np.ndarray) -> Rotation:
    if len(rows) == 1:
        return Rotation.from_euler("z", rows.T)
    return Rotation.from_quat(np.roll(rows, -1, axis=0).T)
