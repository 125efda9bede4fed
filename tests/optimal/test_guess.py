"""The optimiser's first guess is a real motion: its rates are the derivatives of its path."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rans.dynamics import PlanarState
from rans.fields import Heading, Quat, Vec2
from rans.optimal.guess import rest_to_rest, rotation_vector, transfer_time
from rans.scenario import scenario
from rans.spacecraft_file import load_spacecraft
from rans.tasks import GoToPose


def test_rotation_vector_of_quaternions_is_scipys() -> None:
    rotations = Rotation.random(200, rng=np.random.default_rng(3))
    x, y, z, w = rotations.as_quat().T  # SciPy leaves the sign open, so both signs occur
    assert (w < 0).any()
    np.testing.assert_allclose(rotation_vector(Quat(w, x, y, z)).T, rotations.as_rotvec(), atol=1e-13)


def test_rotation_vector_vanishes_smoothly() -> None:
    assert np.array_equal(rotation_vector(Quat(1.0, 0.0, 0.0, 0.0)), np.zeros(3))
    assert rotation_vector(Quat(-1.0, 1e-9, 0.0, 0.0)) == pytest.approx([-2e-9, 0.0, 0.0], rel=1e-12)


def test_headings_turn_the_short_way() -> None:
    turn = rotation_vector(Heading(math.radians(350.0)))
    assert turn == pytest.approx([math.radians(-10.0)], abs=1e-12)


@pytest.mark.parametrize("long_way", [False, True])
@pytest.mark.parametrize("dimension", [2, 3])
def test_guess_is_a_motion_from_start_to_goal(dimension: int, long_way: bool) -> None:
    duration, count = 7.0, 2000
    start = scenario(GoToPose(), dimension, 1, 4)  # type: ignore[arg-type]
    path = rest_to_rest(start.start, start.goal, duration, count, long_way)
    places = dimension + (1 if dimension == 2 else 4)
    p, attitude, v, w = np.split(path, [dimension, places, places + dimension])
    np.testing.assert_allclose(p[:, -1], start.goal.p.columns(), atol=1e-12)  # type: ignore[union-attr]
    step = duration / count
    # central differences are off by step^2 / 6 times the third derivative, below 1e-5 here
    np.testing.assert_allclose((p[:, 2:] - p[:, :-2]) / (2 * step), v[:, 1:-1], atol=1e-5)
    rotation = _rotations(attitude)
    turned = (rotation[:-2].inv() * rotation[2:]).as_rotvec()[:, -len(w):].T
    np.testing.assert_allclose(turned / (2 * step), w[:, 1:-1], atol=1e-5)
    goal = _rotations(np.array([_entries(start.goal.attitude)]).T)
    assert (rotation[-1:].inv() * goal).magnitude()[0] < 1e-7  # arccos halves the digits
    angle = np.linalg.norm(w, axis=0).sum() * step
    assert (angle > math.pi) == long_way


def _entries(attitude: Heading | Quat) -> tuple[float, ...]:
    if isinstance(attitude, Heading):
        return (attitude.angle,)
    return attitude.w, attitude.x, attitude.y, attitude.z


def _rotations(rows: np.ndarray) -> Rotation:
    if len(rows) == 1:
        return Rotation.from_rotvec(np.array([0.0 * rows[0], 0.0 * rows[0], rows[0]]).T)
    return Rotation.from_quat(np.roll(rows, -1, axis=0).T)


def test_turning_alone_takes_time() -> None:
    platform = load_spacecraft("floating-platform")
    goal = PlanarState(Vec2(0.0, 0.0), Heading(0.0), Vec2(0.0, 0.0), 0.0)
    least = 2 * math.sqrt(math.pi / 2 * 0.2045008 / 1.24)
    assert transfer_time(platform, replace(goal, attitude=Heading(math.pi / 2)), goal) > least
