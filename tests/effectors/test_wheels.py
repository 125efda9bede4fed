"""Reaction wheels: the laws of mechanics, an independent integration, Drake, and their limits."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rans.effectors.motion import held
from rans.model.body import Body
from rans.model.fields import Vec3
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.reference.flight import rows_from_states, states_from_rows
from rans.reference.plant import Plant
from tests.support.effector_crafts import CUBESAT, UNEVEN, WHEELED, commands, states

FINE = Timing(control_period=1.0, substeps=32)


def total_momentum(craft: Spacecraft, state: Any) -> np.ndarray:
    """Angular momentum of craft and wheels in W, (3, N) N m s, by matrices."""
    w = np.array(state.w.columns())
    axes = np.array([wheel.axis for wheel in craft.wheels]).T
    in_body = np.array(craft.inertia) @ w + axes @ np.array(state.stores)
    return np.array(state.attitude.rotate(Vec3(*in_body)).columns())


@pytest.mark.parametrize("craft", [CUBESAT, UNEVEN], ids=lambda craft: craft.name)
def test_motors_change_no_angular_momentum_of_craft_and_wheels(craft: Spacecraft) -> None:
    before = states(craft, 20)
    given = commands(craft, 20)
    given[:, : len(craft.thrusters)] = 0.0
    after = held(before, craft, Body.of(craft), tuple(given.T), FINE)
    assert np.abs(np.array(after.stores) - np.array(before.stores)).max() > 1e-3
    np.testing.assert_allclose(
        total_momentum(craft, after), total_momentum(craft, before), rtol=0, atol=1e-12
    )


def test_wheels_of_a_craft_that_burns_propellant_agree_with_drake() -> None:
    """Mass falls by 0.07 % in a period: with its mean the spin was off by 1e-6 rad/s."""
    craft = load_spacecraft("mars-lander-steered")
    before = states(craft, 16)
    engines, wheels = np.full((16, 6), 0.8), np.tile([-1.0, 1.0, 0.5], (16, 1))
    given = np.hstack([engines, wheels])
    timing = Timing(substeps=32)
    after = held(before, craft, Body.of(craft), tuple(given.T), timing)
    rows = Plant(craft, 16).advance(rows_from_states(before), given, timing.control_period)
    drake = states_from_rows(rows, before)
    np.testing.assert_allclose(after.w.columns(), drake.w.columns(), rtol=0, atol=5e-8)
    np.testing.assert_allclose(after.v.columns(), drake.v.columns(), rtol=0, atol=5e-8)


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
