"""Controllers that know a dead thruster allocate without it."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rans
from rans import Conditions, FaultConditions, GoToPose
from rans.control.allocation import Allocation, Rounding
from rans.episode.step import Setup
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.fly.make_controller import controller
from rans.evaluation.measure.metrics import settling_times
from rans.model.spacecraft_file import load_spacecraft

DEAD = Conditions(faults=FaultConditions(thrusters=(3,), kinds=("dead",)))
"""Thruster 3 gives nothing from the start."""


def setup_of(craft: str, conditions: Conditions | None = DEAD) -> Setup:
    """Go-to-pose as evaluations fly it."""
    task = GoToPose().for_evaluation()
    return Setup(load_spacecraft(craft), task, task.timing, conditions)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lqr", "switching"])
def test_settles_without_a_dead_thruster(name):
    """Made by name it knows; made for nominal conditions it asks for a thruster that is not there."""
    setup = setup_of("floating-platform")
    knows = controller(name, setup)
    flight = fly_episodes(knows, setup, 2023, 4, "fast", workers=1)
    assert np.isfinite(settling_times(flight)).all()
    assert not flight.commands[:, :, 3].any()
    others = np.delete(flight.commands, 3, axis=2)
    assert others.any(axis=(0, 1)).all()

    nominal = controller(name, setup_of("floating-platform", None))
    blind = fly_episodes(nominal, setup, 2023, 4, "fast", workers=1)
    assert blind.commands[:, :, 3].any()


def test_a_dead_thruster_is_known_only_where_it_always_is_dead():
    setup = setup_of("floating-platform")
    knows: Any = controller("lqr", setup)
    assert repr(knows).endswith("without thrusters 3")
    drawn = Conditions(faults=FaultConditions(count=1.0, kinds=("dead",)))
    for conditions in (None, drawn):
        assert type(knows.expecting(conditions)) is rans.LQR
    moved = knows.expecting(Conditions(faults=FaultConditions(thrusters=(5,), kinds=("dead",))))
    assert repr(moved).endswith("without thrusters 5")


def test_flies_on_where_the_others_do_not_suffice():
    """SPHERES can lose none of its thrusters."""
    setup = setup_of("spheres")
    assert type(controller("lqr", setup)) is rans.LQR


def test_wheels_carry_the_torque_of_an_incomplete_layout():
    """Without one nozzle this CubeSat pushes along some axes only with a torque, which its wheels balance."""
    whole = load_spacecraft("cubesat-3u")
    with warnings.catch_warnings(action="ignore"):
        alone = replace(whole, thrusters=whole.thrusters[1:], wheels=())
    assert not alone.is_steerable
    craft = replace(whole, thrusters=whole.thrusters[1:])
    assert min(Allocation(craft).authority()) > 0.0

    ours = Rounding(craft, 0.5)
    columns = np.array(craft.wrench_map)
    turns = np.array(craft.wheel_map)
    for axis in range(3):
        for sign in (0.005, -0.005):
            wanted = np.zeros((1, 6))
            wanted[0, axis] = sign
            ours.reset(1)
            commands = ours.round(wanted, stores=(np.zeros(1),) * 3)[0]
            given = commands[:7] @ columns
            given[3:] += commands[7:] @ turns
            # Pulses are a thousandth of a period long.
            np.testing.assert_allclose(given, wanted[0], atol=1e-4)
