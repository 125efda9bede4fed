"""The optimiser's first guess is a real motion: its rates are the derivatives of its path."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rans.model.body import Body
from rans.model.dynamics import advance, wrench
from rans.model.fields import Heading, Quat, leaves, unflatten
from rans.model.spacecraft_file import load_spacecraft
from rans.optimal.trajectory.guess import guess, needed_wrenches, rotation_vector, transfer_time
from rans.scenario import scenario
from rans.tasks import TASKS, GoToPose, TrackTwist
from rans.tasks.goal_set import aims
from tests.support.states import planar


def test_rotation_vector_of_quaternions_is_scipys() -> None:
    rotations = Rotation.random(200, rng=np.random.default_rng(3))
    x, y, z, w = rotations.as_quat().T  # SciPy leaves the sign open, so both signs occur
    assert (w < 0).any()
    np.testing.assert_allclose(
        rotation_vector(Quat(w, x, y, z)).T, rotations.as_rotvec(), atol=1e-13
    )


def test_headings_turn_the_short_way() -> None:
    turn = rotation_vector(Heading(math.radians(350.0)))
    assert turn == pytest.approx([math.radians(-10.0)], abs=1e-12)


POSE = aims(GoToPose())


@pytest.mark.parametrize("number", [0, 1, 2, 3])
@pytest.mark.parametrize("dimension", [2, 3])
def test_guess_is_a_motion_from_start_to_goal(dimension: int, number: int) -> None:
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
    first = _entries(start.start.attitude)  # type: ignore[arg-type]
    if dimension == 2:
        assert (abs(attitude[0, -1] - first[0]) > math.pi) == (number in (1, 3))
    else:
        is_far = np.dot(attitude[:, -1], first) < 0.0
        assert is_far == (number in (1, 3))


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
    goal = planar()
    least = 2 * math.sqrt(math.pi / 2 * 0.2045008 / 1.24)
    assert transfer_time(platform, POSE, replace(goal, attitude=Heading(math.pi / 2)), goal) > least


@pytest.mark.parametrize("name", ["track-velocity", "track-twist", "track-velocity-heading"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_tracking_guesses_end_with_the_goals_rates(name: str, dimension: int) -> None:
    """And with no others: what a task does not ask for is left alone. Their rates are those of their path."""
    task = TASKS[name]()
    case = scenario(task, dimension, 3, 5)  # type: ignore[arg-type]
    duration = 4.0  # type: ignore[arg-type]
    count = 2000  # type: ignore[arg-type]
    path = guess(aims(task), case.start, case.goal, duration, count)
    p = path[:dimension]
    v = path[-2 * dimension if dimension == 3 else -3 :][:dimension]
    np.testing.assert_allclose(v[:, -1], case.goal.v.columns(), atol=1e-12)
    middle = (v[:, 1:] + v[:, :-1]) / 2  # exact for constant acceleration
    np.testing.assert_allclose(np.diff(p, axis=1) * count / duration, middle, atol=1e-9)
    w = path[-1:] if dimension == 2 else path[-3:]
    wanted = case.goal.spin() if name == "track-twist" else np.zeros(len(w))
    np.testing.assert_allclose(w[:, -1], wanted, atol=1e-12)
    attitude = _rotations(path[dimension : dimension + 1] if dimension == 2 else path[3:7])
    turned = (attitude[:-1].inv() * attitude[1:]).as_rotvec()[:, -len(w) :].T * count / duration
    # attitudes of goals are met at a pace whose rate changes by 1e-3 rad/s within an interval
    np.testing.assert_allclose(turned, (w[:, 1:] + w[:, :-1]) / 2, atol=1e-5)


def test_spinning_up_takes_the_change_of_speed_over_the_acceleration() -> None:
    """Four nozzles of 1 N at 0.31 m; a fifth is spare."""
    platform = load_spacecraft("floating-platform")
    rest = scenario(TrackTwist(), 2, 0, 0).start
    goal = replace(rest, w=0.5)
    least = 0.5 * platform.inertia[2][2] / (4 * 0.31)
    assert transfer_time(platform, aims(TrackTwist()), rest, goal) == pytest.approx(1.2 * least)


@pytest.mark.parametrize("dimension", [2, 3])
def test_needed_wrenches_move_along_the_path(dimension: int) -> None:
    """The engines' own flight under wrenches in B gives them back, up to the turn within a period."""
    craft = load_spacecraft("floating-platform" if dimension == 2 else "free-flyer")
    state: Any = scenario(GoToPose(), dimension, 1, 2).start  # type: ignore[arg-type]
    h = 0.02
    random = np.random.default_rng(0)
    states = [state]
    wrenches = []
    for command in random.random((20, len(craft.thrusters))):
        applied = wrench(craft, tuple(float(c) for c in command))
        wrenches.append(leaves(applied))
        states.append(advance(states[-1], applied, Body.of(craft), h))
    path = unflatten(state, np.array([leaves(s) for s in states]).T)
    # it spins by less than 1 rad/s: forces turn by 0.02 rad a period
    np.testing.assert_allclose(needed_wrenches(craft, path, h), wrenches, atol=0.05)
