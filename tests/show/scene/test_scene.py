"""What is drawn of an episode, against the states it was made of and geometry worked by hand."""

from __future__ import annotations

import numpy as np
import pytest

from rans.flight import Flight
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2, leaves, map_leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.show.scene.scene import (
    STARS,
    SceneMotion,
    goal_parts,
    ground_parts,
    trail_parts,
    velocity_arrow,
    velocity_parts,
)
from rans.tasks import GoToPose, GoToPosition
from tests.support.drawings import corners
from tests.support.reference_flights import FLYER, TRACKING, drifting, lqr_flight

PLATFORM = load_spacecraft("floating-platform")


def test_poses_are_the_states() -> None:
    """Drake builds the rotation from the quaternion by itself."""
    flight = lqr_flight(steps=30)
    motion = SceneMotion.of(flight, 1)
    rows = np.array(leaves(flight.states))[:, :, 1].T
    np.testing.assert_array_equal(motion.path, rows[:, :3])
    np.testing.assert_array_equal(motion.velocities, rows[:, 7:10])
    for pose, wxyz in zip(motion.poses, rows[:, 3:7], strict=True):
        quaternion = pose.rotation().ToQuaternion().wxyz()
        assert abs(quaternion @ wxyz) == pytest.approx(
            1.0, abs=1e-12
        )  # both signs are one rotation
    goal = np.array(leaves(flight.goals))[:, 1]
    np.testing.assert_array_equal(motion.goals[0].translation(), goal[:3])


def test_a_planar_pose_turns_about_z() -> None:
    full = lambda value: np.full((2, 1), value)  # noqa: E731
    turned = Heading(full(np.pi / 2))
    state = PlanarState(Vec2(full(1.0), full(2.0)), turned, Vec2(full(0.5), full(0.0)), full(0.0))
    goal = map_leaves(lambda x: x[0], state)
    flight = Flight(
        PLATFORM, GoToPose(), Timing(episode_steps=1), state, goal, np.zeros((1, 1, 8)), "nobody"
    )
    motion = SceneMotion.of(flight, 0)
    np.testing.assert_allclose(motion.poses[0] @ [1.0, 0.0, 0.0], [1.0, 3.0, 0.0], atol=1e-15)
    np.testing.assert_array_equal(motion.velocities[0], [0.5, 0.0, 0.0])


def test_flames_belong_to_the_period_that_follows() -> None:
    motion = SceneMotion.of(drifting(TRACKING), 0)
    assert [list(np.flatnonzero(row)) for row in motion.opening[:4]] == [[], [11], [], []]
    assert not motion.opening[-1].any()


def test_a_failed_episode_ends_where_it_failed() -> None:
    """At 0.5 m/s from the origin, the goal at (9, 9, 9): 9 sqrt(3) = 15.6 m is beyond 8 m at once."""
    assert len(SceneMotion.of(drifting(GoToPose()), 0).poses) == 1
    assert len(SceneMotion.of(drifting(GoToPose(fail_distance=100.0)), 0).poses) == 11


def test_a_goal_without_a_place_stays_with_the_spacecraft() -> None:
    motion = SceneMotion.of(drifting(TRACKING), 0)
    np.testing.assert_allclose(motion.goal_at(10).translation(), [1.0, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(
        motion.goal_at(10).rotation().matrix(), np.diag([-1.0, -1.0, 1.0]), atol=1e-15
    )
    np.testing.assert_array_equal(motion.goal_velocities[-1], [0.0, 0.25, 0.0])
    # 2.2 radii of 0.31 m beyond the way, and beyond the arrows of 2 s: 1 m on along x, 0.5 m along y
    np.testing.assert_allclose(motion.box()[1], np.array([2.0, 0.5, 0.0]) + 2.2 * 0.31, atol=1e-12)
    placed = SceneMotion.of(drifting(GoToPosition(fail_distance=100.0)), 0)
    np.testing.assert_array_equal(placed.goal_at(10).translation(), [9.0, 9.0, 9.0])


def test_a_floor_has_a_line_every_metre() -> None:
    parts = ground_parts(np.array([-1.2, 0.1, -0.2]), np.array([1.0, 0.9, 1.0]), space=False)
    assert len({part.name for part in parts}) == len(parts)
    # a metre more on every side: x = -3 ... 2 and y = -1 ... 2
    assert sum(part.name.startswith("line") for part in parts) == 6 + 4
    floor = parts[0]
    assert floor.shape.size().tolist() == [5.0, 3.0, pytest.approx(0.1)]  # type: ignore[attr-defined]
    assert floor.pose.translation()[2] + 0.05 == pytest.approx(
        -0.2
    )  # its surface is the lowest place


def test_stars_are_far_beyond_all_that_flies() -> None:
    low = np.zeros(3)
    high = np.array([3.0, 4.0, 0.0])
    (stars,) = ground_parts(low, high, space=True)
    np.testing.assert_array_equal(stars.pose.translation(), [1.5, 2.0, 0.0])
    distances = np.linalg.norm(corners(stars), axis=1)
    assert distances.min() > 0.99 * STARS * 5.0


@pytest.mark.parametrize(
    ("wanted", "names"),
    [
        ({"position"}, {"needle", "head"}),
        ({"position", "attitude"}, {"ghost", "x axis", "y axis", "z axis"}),
        ({"velocity", "attitude"}, {"x axis", "y axis", "z axis"}),
        ({"velocity", "spin"}, set()),
    ],
)
def test_the_goal_shows_what_the_task_wants(wanted: set[str], names: set[str]) -> None:
    """The ghost has many parts."""
    shown = {part.name for part in goal_parts(FLYER, wanted)}
    assert {"ghost" if name.startswith("ghost") else name for name in shown} == names


def test_a_trail_is_whole_and_leaves_nothing_out() -> None:
    """Along a circle of 1 m radius its pieces are as long as the circle, but for the last 3 cm at most."""
    angle = np.linspace(0.0, 2.0 * np.pi, 1000)
    way = np.stack((np.cos(angle), np.sin(angle), 0.0 * angle), axis=1)
    pieces = list(trail_parts(way))
    length = sum(part.shape.length() for _, part in pieces)  # type: ignore[attr-defined]
    assert 2.0 * np.pi - 0.04 < length < 2.0 * np.pi
    assert [k for k, _ in pieces] == sorted(k for k, _ in pieces)
    assert not list(trail_parts(np.zeros((5, 3))))


def test_an_arrow_points_along_the_velocity() -> None:
    turn, length = velocity_arrow(np.array([0.0, -0.3, 0.4]))
    np.testing.assert_allclose(turn.matrix()[:, 0], [0.0, -0.6, 0.8], atol=1e-12)
    assert length == pytest.approx(1.0)  # the way of 2 s
    assert velocity_arrow(np.zeros(3))[1] > 0.0  # Meshcat cannot invert a scale of 0


def test_an_arrow_is_as_long_as_it_is_told() -> None:
    """A shaft of four fifths along x, where the head goes on: 2 m in all."""
    shaft, head = velocity_parts(True, 2.0)
    np.testing.assert_allclose(head.pose.translation(), [1.6, 0.0, 0.0])
    for part in (shaft, head):
        np.testing.assert_allclose(part.pose.rotation().matrix()[:, 2], [1.0, 0.0, 0.0], atol=1e-12)
        assert part.shape.scale() == 2.0  # type: ignore[attr-defined]
