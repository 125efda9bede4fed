"""Reaction wheels: the laws of mechanics, an independent integration, Drake, and their limits."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from rans import Spacecraft, Timing
from rans.effectors.motion import held, states_at_checks
from rans.effectors.wheels import wheel_speeds
from rans.model.actuators import Wheel
from rans.model.body import Body
from rans.model.dynamics import PlanarState, SpatialState, Wrench
from rans.model.fields import Heading, Quat, Vec2, Vec3
from rans.model.spacecraft_file import load_spacecraft
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


def test_momenta_of_wheels_are_those_of_each_check():
    """Half of 0.05 N m for 0.2 s gives 5 mN m s, a quarter of it in each quarter."""
    rest = PlanarState(Vec2(0.0, 0.0), Heading(0.0), Vec2(0.0, 0.0), 0.0, stores=(0.0,))
    command = (0.0,) * 8 + (0.5,)
    timing = Timing(0.2, checks=4)
    states = states_at_checks(rest, WHEELED, Body.of(WHEELED), command, timing)
    held = [abs(float(state.stores[0])) for state in states]
    assert held == pytest.approx([0.00125, 0.0025, 0.00375, 0.005])
    # The craft has as much the other way.
    spins = np.array([float(state.w) for state in states]) * WHEELED.inertia[2][2]
    assert np.abs(spins) == pytest.approx(held)


def test_a_ball_with_a_spinning_wheel_precesses_under_a_torque_of_the_world():
    """Against SciPy: J w' = R^T torque - w x (J w + h), of equal moments, whose spin has a form of its own."""
    flyer = load_spacecraft("free-flyer")
    craft = replace(flyer, wheels=(Wheel((0.0, 0.0, 1.0), 0.05, 0.2, 1e-3),))
    moment = flyer.inertia[0][0]
    torque = np.array([0.02, -0.03, 0.01])
    momentum = np.array([0.0, 0.0, 0.15])
    still = Vec3(0.0, 0.0, 0.0)
    start = SpatialState(
        still, Quat(1.0, 0.0, 0.0, 0.0), still, Vec3(0.3, -0.2, 0.1), stores=(0.15,)
    )

    def rates(_: float, y: np.ndarray) -> np.ndarray:
        turn = Rotation.from_quat(y[:4])
        w = y[4:]
        rate = (turn.inv().apply(torque) - np.cross(w, moment * w + momentum)) / moment
        a, b, c = 0.5 * w
        x, q, z, s = y[:4]
        spun = [s * a + q * c - z * b, s * b + z * a - x * c, s * c + x * b - q * a]
        return np.array([*spun, -x * a - q * b - z * c, *rate])

    begun = [0.0, 0.0, 0.0, 1.0, 0.3, -0.2, 0.1]
    expected = solve_ivp(rates, (0.0, 0.2), begun, rtol=1e-11, atol=1e-13).y[4:, -1]
    load = Wrench(still, Vec3(*torque.tolist()))
    command = (0.0,) * len(craft.commands)
    end = held(start, craft, Body.of(craft), command, Timing(0.2, substeps=4), disturbance=load)
    np.testing.assert_allclose(np.ravel(end.w.columns()), expected, rtol=0, atol=1e-9)
