"""Reaction wheels: the laws of mechanics, an independent integration, Drake, and their limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rans.effectors.motion import held
from rans.model.body import Body
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from tests.support.effector_crafts import CUBESAT, WHEELED, states


def test_a_wheel_at_its_limit_only_slows_down() -> None:
    """By hand: 0.08 N m s at most, 0.05 N m, one second: from 0.06 it takes up 0.02, from 0.08 nothing."""
    still = (0.0,) * 8
    start = states(WHEELED, 4, spin=0.0)
    start = replace(start, stores=(np.array([0.06, 0.08, 0.08, -0.07]),))
    motor = np.array([1.0, 1.0, -1.0, -1.0])
    timing = Timing(control_period=1.0, substeps=1)
    after = held(start, WHEELED, Body.of(WHEELED), (*still, motor), timing)
    np.testing.assert_allclose(after.stores[0], [0.08, 0.08, 0.03, -0.08], rtol=0, atol=1e-15)
    inertia = WHEELED.inertia[2][2]
    gained = np.array([-0.02, 0.0, 0.05, 0.01]) / inertia
    np.testing.assert_allclose(after.w, gained, rtol=0, atol=1e-14)


def test_a_wheel_turns_a_craft_whose_thrusters_cannot() -> None:
    from rans.model.spacecraft import can_turn, controls_every_direction

    assert can_turn(CUBESAT)
    assert controls_every_direction(CUBESAT)
    assert not can_turn(replace(CUBESAT, wheels=()))


def test_a_wheel_makes_up_for_thrusters_that_turn() -> None:
    """Four thrusters through the centre of mass: with a wheel no dead one leaves it steerable, whole it is."""
    from rans.randomization.faults import margin

    pushes = [((0.0, 0.0), way, 1.0) for way in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    craft = Spacecraft.planar("cross", 5.0, 0.1, pushes, wheels=WHEELED.wheels)
    assert margin(craft, ()) > 0.0
    assert margin(craft, (0,)) == 0.0
