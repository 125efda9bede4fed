"""Docking with contact: hand-worked collisions, loads of latches, and the judge's plant where nothing touches."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rans_missions.contact import CaptureSystem, DockingPlant

from rans.errors import ConfigError
from rans.model.spacecraft_file import load_spacecraft
from rans.reference.plant import Plant

PLATFORM = load_spacecraft("floating-platform")
PORT = np.array([-0.65, 0.0, 0.0, 0.0, 0.0, 0.0])
"""Docked state at a port at rest, in the plane: the spacecraft is 0.65 m from the target and looks at it."""
SHUT = np.zeros(8)


def ahead_of_port(distance: float, speed: float) -> np.ndarray:
    """State this far in front of the docked position, which moves towards it."""
    return PORT + np.array([-distance, 0.0, 0.0, speed, 0.0, 0.0])


@pytest.mark.parametrize("name", ["floating-platform", "free-flyer"])
def test_it_moves_as_the_judge_does_where_nothing_touches(name: str) -> None:
    craft = load_spacecraft(name)
    random = np.random.default_rng(3)
    if craft.dimension == 2:
        docked, row = PORT, np.array([-3.0, 1.0, 0.4, 0.1, -0.2, 0.3])
    else:
        docked = np.array([-0.65, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0.02, 0.03, 0.01])
        row = np.array([-3, 1, 2, 0.8, 0, 0.6, 0, 0.1, -0.2, 0.1, 0.3, 0.2, -0.1])
    plant = DockingPlant(craft, docked, control_period=0.2, checks=2)
    commands = random.integers(0, 2, (10, len(craft.thrusters))).astype(float)
    judge = Plant(craft).rollout(row[None], commands[:, None], control_period=0.2)[:, 0]
    for command, expected in zip(commands, judge[1:], strict=True):
        row = plant.states_at_checks(row, command)[-1]
        # Runge-Kutta of order three in steps of 10 ms, which turn by 0.01 rad, errs by 1e-9 a step.
        assert row == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("speed", [0.02, 0.05])
def test_a_collision_takes_energy_and_its_force_is_that_of_a_spring(speed: float) -> None:
    """Without dissipation the largest force is v sqrt(k m), where k is that of two springs in a row."""
    system = CaptureSystem(contact_dissipation=0.5)
    plant = DockingPlant(PLATFORM, PORT, control_period=2.0, system=system)
    after = plant.states_at_checks(ahead_of_port(0.02, speed), SHUT)[-1]
    assert plant.touched
    assert plant.contact_speed == pytest.approx(speed, rel=1e-6)
    stiffness = 0.5 * system.contact_stiffness
    spring = speed * math.sqrt(stiffness * PLATFORM.mass)
    # Forces are read every 5 ms, a twentieth of half an oscillation: the peak is seen to within 1 %.
    assert 0.95 * spring < plant.contact_force < 1.03 * spring
    assert -speed < after[3] < -0.8 * speed  # Hunt and Crossley: e is about 1 - 2/3 d v = 0.98 here
    assert after[[1, 2, 4, 5]] == pytest.approx(0.0, abs=1e-9)  # head-on: nothing turns


def test_latches_draw_the_spacecraft_in_and_are_loaded_by_its_offset() -> None:
    """At rest 2 cm in front of the port, springs of 100 N/m pull with 2 N at first, which is the most."""
    plant = DockingPlant(PLATFORM, PORT, control_period=0.2)
    plant.states_at_checks(ahead_of_port(0.02, 0.0), SHUT)
    capture = plant.capture(seconds=6.0)
    assert capture.captured
    assert capture.load == pytest.approx(2.0, rel=1e-6)
    assert capture.distance < 1e-3


@pytest.mark.slow
def test_latches_that_are_too_weak_do_not_capture() -> None:
    plant = DockingPlant(PLATFORM, PORT, control_period=0.2, system=CaptureSystem(strength=1.0))
    plant.states_at_checks(ahead_of_port(0.02, 0.0), SHUT)
    assert not plant.capture(seconds=6.0).captured


@pytest.mark.slow
def test_a_spacecraft_follows_a_port_that_turns() -> None:
    """It is captured at the port's rate, on the port's circle."""
    rate = math.radians(3.0)
    docked = np.array([-0.65, 0.0, 0.0, 0.0, -0.65 * rate, rate])
    plant = DockingPlant(PLATFORM, docked, control_period=0.2)
    plant.states_at_checks(docked + np.array([-0.01, 0, 0, 0, 0, 0]), SHUT)
    assert plant.capture(seconds=10.0).captured
    end = plant.states_at_checks(plant.state(), SHUT)[-1]
    assert end[5] == pytest.approx(rate, abs=1e-4)
    assert np.hypot(*end[:2]) == pytest.approx(0.65, abs=2e-3)


def test_wheels_and_propellant_are_refused() -> None:
    with pytest.raises(ConfigError, match="pingu has them"):
        DockingPlant(load_spacecraft("pingu"), PORT, control_period=0.2)
