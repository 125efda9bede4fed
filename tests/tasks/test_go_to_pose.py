"""Go to pose, by hand: one planar and one spatial state whose every number can be checked on paper."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from rans.model.dynamics import PlanarState, SpatialState
from rans.model.fields import Heading, Quat, Vec2, Vec3
from rans.tasks import GoToPose, observation
from rans.tasks.rewards import RestReward, Transition
from tests.support.states import planar, spatial

HALF = math.sqrt(0.5)

PLANAR = PlanarState(Vec2(0.3, -0.4), Heading(math.pi / 2), Vec2(0.1, 0.2), -0.5)
"""Half a metre from the origin, facing +y."""
PLANAR_GOAL = planar(heading=2 * math.pi / 3)
"""30 degrees further to the left."""

SPATIAL = SpatialState(
    Vec3(1.0, 2.0, -2.0), Quat(HALF, 0.0, 0.0, HALF), Vec3(0.1, 0.2, 0.3), Vec3(-0.1, 0.4, 0.5)
)
"""3 m from the origin, a quarter turn about z: body x is world y."""
SPATIAL_GOAL = spatial(attitude=(HALF, HALF, 0.0, 0.0))
"""A quarter turn about x instead: body y is world z."""


def test_errors():
    assert GoToPose().errors(PLANAR, PLANAR_GOAL) == pytest.approx(
        {"position": 0.5, "attitude": math.pi / 6}
    )
    # trace of R^T R_goal is 0 = 1 + 2 cos(angle): a third of a turn
    assert GoToPose().errors(SPATIAL, SPATIAL_GOAL) == pytest.approx(
        {"position": 3.0, "attitude": 2 * math.pi / 3}
    )


@dataclass(frozen=True)
class Soft(GoToPose):
    """Arrives slowly."""

    velocity_tolerance: float = 0.1


def test_one_tolerance_more_is_one_error_more():
    """By hand: 0.3 and 0.4 m/s towards a goal at rest."""
    state, goal = planar(v=(0.3, 0.4)), planar()
    assert Soft().errors(state, goal)["velocity"] == pytest.approx(0.5)
    assert not Soft().reached(state, goal)
    assert GoToPose().reached(state, goal)
    moved = Transition(state, goal, (), ())
    assert Soft().reward(moved) == GoToPose().reward(moved)


def test_reward():
    """exp(-0.5 / 0.25) = 0.1353353; exp(-(pi / 6) / 0.25) = 0.1231447; three open thrusters of 0.02.

    The wide copies: exp(-0.5 / 1.5) / 2 = 0.3582657; exp(-pi / 6) / 2 = 0.2961925.
    """
    task = GoToPose(thrust_weight=0.02)
    terms = task.reward(Transition(PLANAR, PLANAR_GOAL, (1.0, 0.0, 1.0, 1.0), (0.0,) * 4))
    expected = {
        "position": 0.1353353,
        "attitude": 0.1231447,
        "approach": 0.3582657,
        "turn": 0.2961925,
        "thrust": -0.06,
    }
    assert terms == pytest.approx(expected, abs=1e-7)

    class Far(GoToPose):
        position_scale = 3.0
        attitude_scale = 2 * math.pi / 3

    terms = Far().reward(Transition(SPATIAL, SPATIAL_GOAL, (1.0,), (0.0,)))
    assert [terms["position"], terms["attitude"]] == pytest.approx([0.3678794] * 2, abs=1e-7)


def paid(task: GoToPose, state: Any, command: tuple[float, ...] = (0.0,)) -> dict[str, Any]:
    """What the task pays for a state, and for thrust there, with the goal at the origin and all shut before."""
    return task.reward(Transition(state, planar(), command, (0.0,) * len(command)))


def test_only_those_who_have_arrived_in_all_four_get_that_reward():
    """Half of it in the middle of a side of the set, 1 / (1 + 4) in its corner, next to none at twice."""
    task = GoToPose(
        arrived=RestReward(weight=6.0, spin=0.3, sharpness=3),
        position_tolerance=0.04,
        attitude_tolerance=0.1,
    )

    def arrived(task, x, angle, v, spin):
        return paid(task, planar(0.0, x, angle, (v, 0.0), spin))["arrived"]

    assert arrived(task, 0.0, 0.0, 0.0, 0.0) == 6.0
    turned = (0.0, 0.0, 0.05, 0.0), (0.0, 0.0, 0.0, -0.3)
    for side in (
        (0.04, 0.0, 0.0, 0.0),
        (0.0, -0.1, 0.0, 0.0),
        *turned,
    ):
        assert arrived(task, *side) == pytest.approx(3.0)
        assert arrived(task, *(2.0 * x for x in side)) == pytest.approx(6.0 / 257.0)  # 2^8 + 1
    assert arrived(task, 0.04, 0.1, 0.05, 0.3) == pytest.approx(1.2)
    spare = replace(
        task, arrived=replace(task.arrived, within=0.5)
    )  # half of it at 2 cm instead of 4; rest is asked for as before
    for side in (
        (0.02, 0.0, 0.0, 0.0),
        (0.0, -0.05, 0.0, 0.0),
        *turned,
    ):
        assert arrived(spare, *side) == pytest.approx(3.0)
    fine = replace(
        task,
        arrived=replace(task.arrived, fine_weight=4.0),
        fine_scale=0.04 / math.log(2.0),
    )
    # Half of 6 + 4 (1/2 + 1), then half of 6 + 4 (1 + 1).
    assert arrived(fine, 0.04, 0.0, 0.0, 0.0) == pytest.approx(6.0)
    assert arrived(fine, 0.0, 0.0, 0.05, 0.0) == pytest.approx(7.0)
    assert "arrived" not in paid(GoToPose(), PLANAR)


def test_thrust_costs_those_who_have_arrived():
    """Two of three open at 0.5 each: 1 of 6 in the set, half on the middle of a side, next to none beyond."""
    task = GoToPose(arrived=RestReward(weight=6.0, thrust_weight=0.5), position_tolerance=0.04)
    for x, expected in ((0.0, 5.0), (0.04, 2.5), (0.4, 5.0 / 10_001.0)):
        assert paid(task, planar(x), (1.0, 0.0, 1.0))["arrived"] == pytest.approx(expected)


def test_stillness_is_worth_something_to_those_who_have_arrived():
    """ln 2 scales of 3 mm/s: half of 8 beside the 6; the speed is a 24th of what counts as rest."""
    task = GoToPose(arrived=RestReward(weight=6.0, still_weight=8.0, sharpness=3))
    for v, expected in ((0.0, 14.0), (0.003 * math.log(2.0), 10.0), (0.1, 6.0 / 257.0)):
        assert paid(task, planar(v=(0.0, -v)))["arrived"] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("x", "angle", "expected"),
    [
        (0.0, 0.0, 0.0),
        (0.04, 0.0, -4.0),
        (0.0, -0.1, -4.0),
        (0.08, 0.0, -4.0),
        (0.057, 0.0, -8.0),
        (8.0, 3.0, 0.0),
    ],
)
def test_who_is_nearly_there_pays_for_not_being_there(x, angle, expected):
    """Half of 8 at 1 and at 2 tolerances, all of it between; x^(2^6) is 1e-10 of it at the root of two."""
    task = GoToPose(
        arrived=RestReward(boundary_weight=8.0, sharpness=6),
        position_tolerance=0.04,
        attitude_tolerance=0.1,
    )
    state = planar(x, heading=angle)
    cost = paid(task, state)["boundary"]
    assert cost == pytest.approx(expected, abs=1e-6)
    spare = replace(
        task,
        position_tolerance=0.05,
        attitude_tolerance=0.125,
        arrived=replace(task.arrived, within=0.8),
    )
    assert paid(spare, state)["boundary"] == pytest.approx(cost, abs=1e-9)
    assert "boundary" not in paid(GoToPose(), state)


def test_edges_however_sharp_are_finite_in_single_precision():
    """160 tolerances away, to the power of 64, which single precision has no number for."""
    task = GoToPose(arrived=RestReward(boundary_weight=1.0, weight=1.0, sharpness=6))
    still = Vec2(np.zeros(1, np.float32), np.zeros(1, np.float32))
    far = PlanarState(Vec2(np.full(1, 8.0, np.float32), still.x), Heading(still.x), still, still.x)
    near = PlanarState(still, Heading(still.x), still, still.x)
    with np.errstate(over="raise", invalid="raise"):
        terms = task.reward(Transition(far, near, (still.x,), (still.x,)))
    assert float(terms["arrived"][0]) < 1e-30


def test_a_wrong_attitude_costs_at_the_goals_place_only():
    """Weight 8; ln 2 scales off in attitude, 8 (1 - 1/2) = 4; ln 2 scales off the place too, half of it."""
    task = GoToPose(misaligned_weight=8.0, fine_scale=0.1)

    def cost(x, angle):
        return paid(task, planar(x, heading=angle))["misaligned"]

    half = math.log(2.0)
    assert cost(0.0, 0.1 * half) == pytest.approx(-4.0)
    assert cost(0.1 * half, -0.1 * half) == pytest.approx(-2.0)
    assert cost(0.1 * half, 0.0) == 0.0
    assert cost(5.0, math.pi) == pytest.approx(0.0, abs=1e-15)
    # In space 3 m and a third of a turn off; beyond the rests 2 m and 2 rad, ln 2 scales each: -8 / 2 / 2.
    far = GoToPose(
        misaligned_weight=8.0,
        fine_scale=2.0 / half,
        rest_position=1.0,
        rest_attitude=2 * math.pi / 3 - 2.0,
    )
    terms = far.reward(Transition(SPATIAL, SPATIAL_GOAL, (0.0,), (0.0,)))
    assert terms["misaligned"] == pytest.approx(-2.0)
    assert "misaligned" not in paid(GoToPose(), PLANAR)


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        (planar(4.8, 6.3), False),  # 7.92 m
        (planar(4.8, 6.5), True),  # 8.08 m
        (planar(w=50.0), False),
        (
            spatial((4.0, 4.0, 5.8)),
            True,
        ),  # 8.10 m
        (
            spatial(w=(2.4, 0.0, -3.3)),
            True,
        ),  # 4.08 rad/s
        (
            spatial(w=(2.4, 0.0, -3.1)),
            False,
        ),  # 3.92 rad/s
    ],
)
def test_fails_beyond_8_m_and_in_space_beyond_4_rad_per_s(state, expected):
    goal = PLANAR_GOAL if isinstance(state, PlanarState) else SPATIAL_GOAL
    assert bool(GoToPose().failed(state, goal)) is expected


def test_a_full_turn_away_is_no_turn():
    turned = PlanarState(PLANAR.p, Heading(PLANAR.attitude.angle + 6 * math.pi), PLANAR.v, PLANAR.w)
    flipped = SpatialState(SPATIAL.p, Quat(-HALF, 0.0, 0.0, -HALF), SPATIAL.v, SPATIAL.w)
    for a, b, goal in ((PLANAR, turned, PLANAR_GOAL), (SPATIAL, flipped, SPATIAL_GOAL)):
        np.testing.assert_allclose(
            observation(GoToPose(), a, goal), observation(GoToPose(), b, goal), atol=1e-14
        )
        assert GoToPose().errors(a, goal) == pytest.approx(GoToPose().errors(b, goal), abs=1e-14)
