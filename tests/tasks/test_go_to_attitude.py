"""Turns to an attitude: rewards by hand, and flights of a craft that has wheels and no thruster."""

import math

import pytest
from rans_assurance.stress.effects import applicable_effects

from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import GoToAttitude, observation
from rans.tasks.rewards import Transition

INNOCUBE = load_spacecraft("innocube")
ORIGIN = Vec3(0.0, 0.0, 0.0)
HALF = math.sqrt(0.5)
QUARTER_TURN = SpatialState(ORIGIN, Quat(HALF, 0.0, 0.0, HALF), ORIGIN, Vec3(0.0, 0.03, 0.04))
"""A quarter turn about z, at 0.05 rad/s (3-4-5)."""
UPRIGHT = SpatialState(ORIGIN, Quat(1.0, 0.0, 0.0, 0.0), ORIGIN, ORIGIN)


def test_a_quarter_turn_by_hand():
    task = GoToAttitude(torque_weight=0.1)
    shut = (0.0, 0.0, 0.0)
    angle = math.pi / 2
    assert task.errors(QUARTER_TURN, UPRIGHT) == pytest.approx({"attitude": angle, "spin": 0.05})
    # The goal's axes in the body: x lies along -y of the body, y along x.
    expected = [0, -1, 0, 1, 0, 0, 0, 0, 0, 0, 0.03, 0.04, -1, 0, 1, 0, -1, 0, 0, 0, 0, 0]
    assert observation(task, QUARTER_TURN, UPRIGHT) == pytest.approx(expected, abs=1e-15)

    reward = task.reward(Transition(QUARTER_TURN, UPRIGHT, (0.5, -1.0, 0.0), shut, forces=()))
    assert reward == pytest.approx(
        {
            "turn": math.exp(-angle),
            "attitude": math.exp(-angle / 0.25),
            "fine attitude": math.exp(-angle / 0.02),
            "rest": math.exp(-angle / 0.25 - 0.05 / 0.02),
            "torque": -0.1 * (0.25 + 1.0),
        }
    )
    # Thrusters are priced by themselves: the first command is one's, the others are of wheels.
    reward = task.reward(Transition(QUARTER_TURN, UPRIGHT, (1.0, -1.0, 0.0), shut, forces=(2.0,)))
    assert (reward["torque"], reward["thrust"]) == pytest.approx((-0.1, -0.02))


def test_torques_of_a_stress_test_are_those_of_the_strongest_wheel():
    """A tenth to 0.7 of 0.6 mN m; nothing gives a force that could be a measure of forces."""
    effects = applicable_effects(INNOCUBE, GoToAttitude.timing)
    sizes = {effect.name: effect.sizes for effect in effects}
    assert sizes["torque"] == pytest.approx((6e-5, 1.2e-4, 1.8e-4, 3e-4, 4.2e-4))
    assert "force" not in sizes
