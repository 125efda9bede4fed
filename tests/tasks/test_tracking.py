"""The tracking tasks by hand: states whose every number can be checked on paper."""

import math

import pytest

from rans import TrackTwist, TrackVelocity, TrackVelocityHeading
from rans.model.dynamics import PlanarState, SpatialState
from rans.model.fields import Heading, Quat, Vec2, Vec3
from rans.tasks.rewards import Transition
from tests.support.states import planar, spatial

HALF = math.sqrt(0.5)

PLANAR = PlanarState(Vec2(7.0, -9.0), Heading(math.pi / 2), Vec2(0.1, 0.2), -0.5)
"""Far from the origin, which is nobody's concern; facing +y."""
PLANAR_GOAL = PlanarState(Vec2(0.0, 0.0), Heading(2 * math.pi / 3), Vec2(0.4, -0.2), 0.25)
"""0.5 m/s away (3-4-5), 30 degrees to the left, 0.75 rad/s faster."""

SPATIAL = SpatialState(
    Vec3(9.0, 9.0, 9.0), Quat(HALF, 0.0, 0.0, HALF), Vec3(0.1, 0.2, 0.3), Vec3(-0.1, 0.4, 0.5)
)
"""A quarter turn about z."""
SPATIAL_GOAL = spatial(attitude=(HALF, HALF, 0.0, 0.0), v=(0.2, 0.0, 0.1), w=(0.1, 0.5, 0.3))
"""0.3 m/s away (1-2-2), a quarter turn about x instead, 0.3 rad/s away (2-1-2)."""


@pytest.mark.parametrize(
    ("task", "in_plane", "in_space"),
    [
        (
            TrackVelocity(),
            {"velocity": 0.5, "spin": 0.5},
            {"velocity": 0.3, "spin": math.sqrt(0.42)},
        ),
        (TrackTwist(), {"velocity": 0.5, "spin": 0.75}, {"velocity": 0.3, "spin": 0.3}),
        # the trace of R^T R_goal is 0 = 1 + 2 cos(angle): a third of a turn
        (
            TrackVelocityHeading(),
            {"velocity": 0.5, "attitude": math.pi / 6},
            {"velocity": 0.3, "attitude": 2 * math.pi / 3},
        ),
    ],
)
def test_errors(task, in_plane, in_space):
    assert task.errors(PLANAR, PLANAR_GOAL) == pytest.approx(in_plane)
    assert task.errors(SPATIAL, SPATIAL_GOAL) == pytest.approx(in_space)


@pytest.mark.parametrize(
    ("task", "expected"),
    [
        # exp(-0.5 / 0.25) = 0.1353353, exp(-0.5 / 0.1) = 0.0067379, both for velocity; 2 * 0.1353353
        (
            TrackVelocity(fine_scale=0.1, fine_weight=1.0, stillness_weight=2.0, thrust_weight=0.1),
            {"velocity": 0.1353353, "fine": 0.0067379, "stillness": 0.2706706, "thrust": -0.2},
        ),
        # exp(-0.75 / 0.25) = 0.0497871
        (
            TrackTwist(fine_scale=0.1, fine_weight=1.0, thrust_weight=0.1),
            {"velocity": 0.1353353, "rotation": 0.0497871, "fine": 0.0067379, "thrust": -0.2},
        ),
        # exp(-(pi / 6) / 0.25) = 0.1231447, exp(-pi / 6) / 2 = 0.2961925
        (
            TrackVelocityHeading(fine_scale=0.1, fine_weight=1.0, thrust_weight=0.1),
            {
                "velocity": 0.1353353,
                "attitude": 0.1231447,
                "fine": 0.0067379,
                "turn": 0.2961925,
                "thrust": -0.2,
            },
        ),
    ],
)
def test_reward(task, expected):
    terms = task.reward(Transition(PLANAR, PLANAR_GOAL, (1.0, 0.0, 1.0), (0.0, 0.0, 0.0)))
    assert terms == pytest.approx(expected, abs=1e-7)


def test_a_twist_is_reached_with_both_velocities():
    task = TrackTwist(velocity_tolerance=0.1, spin_tolerance=0.3)
    for dv, dw, expected in ((0.09, 0.29, True), (0.11, 0.0, False), (0.0, -0.31, False)):
        goal = PlanarState(PLANAR.p, PLANAR.attitude, PLANAR.v + Vec2(0.0, dv), PLANAR.w + dw)
        assert bool(task.reached(PLANAR, goal)) is expected


@pytest.mark.parametrize("task", [TrackVelocity(), TrackTwist(), TrackVelocityHeading()])
def test_fails_beyond_6_rad_per_s_wherever_it_is(task):
    for spin, expected in ((5.9, False), (-6.1, True)):
        state = planar(1e6, v=(30.0, 0.0), w=spin)
        assert bool(task.failed(state, PLANAR_GOAL)) is expected
    for spin, expected in (
        (Vec3(3.0, -3.0, 4.0), False),
        (Vec3(4.0, -3.0, 4.0), True),
    ):  # 5.83, 6.40
        state = SpatialState(SPATIAL.p, SPATIAL.attitude, SPATIAL.v, spin)
        assert bool(task.failed(state, SPATIAL_GOAL)) is expected


@pytest.mark.parametrize(
    ("task", "weight"),
    [
        # Half of each tolerance; one of them met exactly halves it; both, leave a third; twice one, 2^8 to 1.
        (
            TrackTwist(within_weight=6.0, velocity_tolerance=1.0, spin_tolerance=1.5),
            6.0 / (1 + 2 / 256),
        ),
        (TrackTwist(within_weight=6.0, velocity_tolerance=0.5, spin_tolerance=75.0), 3.0),
        (TrackTwist(within_weight=6.0, velocity_tolerance=0.5, spin_tolerance=0.75), 2.0),
        (
            TrackVelocityHeading(
                within_weight=6.0, velocity_tolerance=0.25, attitude_tolerance=5.0
            ),
            6.0 / 257,
        ),
        (
            TrackVelocity(within_weight=6.0, velocity_tolerance=0.5),
            3.0,
        ),  # which has none for the spin
    ],
)
def test_being_within_all_tolerances_is_worth_its_weight(task, weight):
    terms = task.reward(Transition(PLANAR, PLANAR_GOAL, (0.0,), (0.0,)))
    assert terms["within"] == pytest.approx(weight, rel=1e-9)
    assert "within" not in type(task)().reward(Transition(PLANAR, PLANAR_GOAL, (0.0,), (0.0,)))
