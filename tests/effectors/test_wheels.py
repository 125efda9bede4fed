"""Reaction wheels: the laws of mechanics, an independent integration, Drake, and their limits."""

from dataclasses import replace

from rans import Spacecraft
from rans.effectors.wheels import wheel_speeds
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
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
    (wheel,) = WHEELED.wheels
    still = Vec2(0.0, 0.0)
    state = PlanarState(still, Heading(0.0), still, 0.5, stores=(0.5 * wheel.inertia,))
    assert wheel_speeds(WHEELED, state) == (0.0,)
