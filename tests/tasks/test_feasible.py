"""What a craft cannot do at all: units mistaken on the slow side, and nozzles that all push through the centre."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rans import ConfigError, Engine, GoToPose, GoToPosition, Timing
from rans.model.pace import misfits, seconds_for_a_metre, seconds_for_half_a_turn
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import SPACECRAFT
from rans.tasks.feasible import warn_of_obstacles
from tests.support.engines import PLATFORM
from tests.support.training import CONFIG, tiny_trainer


def radial(centre: tuple[float, float] = (0.0, 0.0)) -> Spacecraft:
    """The platform with every direction along its position, as the usual slip writes it."""
    nozzles = tuple(
        replace(
            one,
            position=(0.31 * math.cos(angle) + centre[0], 0.31 * math.sin(angle) + centre[1], 0.0),
            direction=(math.cos(angle), math.sin(angle), 0.0),
        )
        for one, angle in zip(PLATFORM.thrusters, np.arange(8) * math.pi / 4 + 0.3, strict=True)
    )
    return replace(PLATFORM, thrusters=nozzles, centre_of_mass=(*centre, 0.0))


def warned(craft: Spacecraft, task: Any, timing: Timing | None = None) -> list[str]:
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        warn_of_obstacles(craft, task, timing or Timing())
    return [str(one.message) for one in found]


def test_an_attitude_that_cannot_be_had():
    (text,) = warned(radial(), GoToPose())
    assert "cannot turn" in text
    assert not warned(radial(), GoToPosition())  # which asks for none
    assert not warned(PLATFORM, GoToPose())


@pytest.mark.parametrize("centre", [(0.0, 0.0), (0.7, -0.3), (12.0, 5.0)])
def test_forces_through_the_centre_have_no_torque(centre):
    """Rounding left 1e-17 N m, of which a certificate said that they are no multiples of one number."""
    craft = radial(centre)
    assert [row[2] for row in craft.wrench_map] == [0.0] * 8
    assert not craft.can_turn
    # A torque of a micrometre of lever arm is none of rounding.
    moved = tuple(
        replace(one, position=(x - 1e-6 * b, y + 1e-6 * a, 0.0))
        for one in craft.thrusters
        for (x, y, _), (a, b, _) in [(one.position, one.direction)]
    )
    with pytest.warns(UserWarning, match="cannot push and turn"):  # they all turn it one way
        torques = [row[2] for row in replace(craft, thrusters=moved).wrench_map]
    assert torques == pytest.approx([-1e-6 * one.force for one in moved], rel=1e-6)


def test_times_by_hand():
    """1 m and half a turn from rest to rest: half of each way speeding up, half braking."""
    nozzle = PLATFORM.thrusters[0]
    pair = (
        replace(nozzle, position=(0.0, 0.2, 0.0), direction=(1.0, 0.0, 0.0), force=2.0),
        replace(nozzle, position=(0.0, -0.2, 0.0), direction=(-1.0, 0.0, 0.0), force=2.0),
    )
    inertia = ((0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1))
    with pytest.warns(UserWarning, match="cannot push and turn"):
        craft = replace(PLATFORM, thrusters=pair, mass=8.0, inertia=inertia)
    # 2 N on 8 kg: 0.5 m at 0.25 m/s^2 take 2 s. 0.8 N m on 0.1 kg m^2: pi / 2 rad at 8 rad/s^2.
    assert seconds_for_a_metre(craft) == pytest.approx(4.0)
    assert seconds_for_half_a_turn(craft) == pytest.approx(2.0 * math.sqrt(math.pi / 8.0))
    # Two of its eight thrusters of 1 N push each of two ways at right angles: sqrt(8) N.
    assert seconds_for_a_metre(PLATFORM) == pytest.approx(2.0 * math.sqrt(5.32 / math.sqrt(8.0)))
    assert seconds_for_half_a_turn(radial()) == math.inf
    # Half of an eight-pointed star pushes midway between two points, along no axis of the craft.
    assert seconds_for_a_metre(radial()) == pytest.approx(
        2.0 * math.sqrt(5.32 * math.sin(math.pi / 8.0))
    )


SLOW: dict[str, Any] = {
    "mass in g": {"mass": 5320.0},
    "force in kN": {"thrusters": tuple(replace(t, force=0.001) for t in PLATFORM.thrusters)},
    "inertia in kg mm^2": {"inertia": tuple(tuple(1e6 * x for x in y) for y in PLATFORM.inertia)},
}


@pytest.mark.parametrize("slip", SLOW)
def test_units_mistaken_on_the_slow_side(slip):
    assert any(
        "needs at least" in text for text in warned(replace(PLATFORM, **SLOW[slip]), GoToPose())
    )
    # A longer episode has time for it.
    long = Timing(episode_steps=10**6)
    assert not warned(replace(PLATFORM, **SLOW[slip]), GoToPose(), long)


def test_an_engine_of_a_slow_file_warns_and_a_training_of_what_cannot_turn_is_refused(tmp_path):
    text = SPACECRAFT["floating-platform"].text.replace("mass = 5.32", "mass = 5320")
    (tmp_path / "grams.toml").write_text(text)
    with (
        pytest.warns(UserWarning, match="a mass in g, or an inertia"),
        pytest.warns(UserWarning, match="for 1 m from rest to rest"),
    ):
        Engine(tmp_path / "grams.toml", GoToPosition(), 2)
    with pytest.raises(ConfigError, match="cannot turn"):
        tiny_trainer(tmp_path / "run", replace(CONFIG, spacecraft="afrl-deputy"))


def test_a_radius_that_no_file_has_is_not_suspected():
    """Thrusters 0.7 m from the centre, and a ball of 2 kg m^2 and 100 kg: r = sqrt(2.5 * 2 / 100)."""
    sides = ((1, 0), (-1, 0), (0, 1), (0, -1))
    far = [((0.7 * x, 0.7 * y), (-y * turn, x * turn), 1.0) for x, y in sides for turn in (1, -1)]
    craft = Spacecraft.planar("servicer", 100.0, 2.0, far)
    assert craft.radius == pytest.approx(0.7)
    assert not misfits(craft)
    near = [((0.1 * x, 0.1 * y), way, 1.0) for (x, y), way, _ in far]
    assert Spacecraft.planar("ball", 100.0, 2.0, near).radius == pytest.approx(0.2236, rel=1e-3)


def test_shipped_craft_are_not_suspected():
    for name in SPACECRAFT:
        assert not misfits(SPACECRAFT[name].craft), name
