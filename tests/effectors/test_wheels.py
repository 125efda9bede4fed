"""Reaction wheels: the laws of mechanics, an independent integration, Drake, and their limits."""

from dataclasses import replace

import numpy as np
import pytest

from rans import Spacecraft
from rans.effectors.wheels import wheel_speeds
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from tests.support.effector_crafts import CUBESAT, WHEELED


def test_a_wheel_turns_a_craft_whose_thrusters_cannot():

    assert CUBESAT.can_turn
    assert CUBESAT.controls_every_direction
    assert not replace(CUBESAT, wheels=()).can_turn


def test_a_wheel_makes_up_for_thrusters_that_turn():
    """Four thrusters through the centre of mass: with a wheel no dead one leaves it steerable, whole it is."""
    from rans.randomization.faults import margin

    pushes = [((0.0, 0.0), way, 1.0) for way in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    craft = Spacecraft.planar("cross", 5.0, 0.1, pushes, wheels=WHEELED.wheels)
    assert margin(craft, ()) > 0.0
    assert margin(craft, (0,)) == 0.0


def test_a_wheel_that_turns_with_its_craft_stands_still_in_it():
    """Its whole momentum is that of the craft's spin along its axis; without that momentum it turns backwards."""
    spin = (0.3, -0.2, 0.5)
    along = np.array([np.dot(wheel.axis, spin) for wheel in CUBESAT.wheels])
    carried = along * [wheel.inertia for wheel in CUBESAT.wheels]
    still = Vec3(0.0, 0.0, 0.0)
    for momenta, speeds in ((carried, 0.0 * along), (0.0 * carried, -along)):
        state = SpatialState(
            still, Quat(1.0, 0.0, 0.0, 0.0), still, Vec3(*spin), stores=tuple(momenta)
        )
        assert wheel_speeds(CUBESAT, state) == pytest.approx(speeds)
