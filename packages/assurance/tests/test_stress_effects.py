"""Troubles by size: each is what its name says, and each craft meets those that it can."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rans_assurance.stress.effects import Level, applicable_effects, failure_levels

from rans import Conditions, GoToPose, Timing
from rans.episode.flight import fly
from rans.episode.scenario import draws, scenarios
from rans.evaluation.fly.user_policy import UserPolicy
from rans.model.fields import leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.randomization.conditions_file import load_conditions

PLATFORM = load_spacecraft("floating-platform")
TASK = GoToPose()
SHORT = Timing(episode_steps=2)
FULL = UserPolicy(
    "half open",
    lambda seen, memory, starts: (np.tile([1, 0, 0, 0, 1, 0, 0, 0], (len(seen), 1)), None),
    PLATFORM,
    TASK,
)
FOUND = {effect.name: effect for effect in applicable_effects(PLATFORM, Timing())}


def test_sizes_are_what_they_are_called():
    """One of each unit, by hand."""
    assert made("latency", 0.1).thrusters.latency == 0.1
    assert made("thrust of each off by", 25.0).thrusters.thrust == (0.75, 1.25)
    assert made("one thruster weaker by", 75.0).faults.share == 0.25
    assert made("less inertia", 0.5).body.inertia == 0.5
    assert made("centre of mass", 3.0).body.centre == pytest.approx(0.03)
    assert made("torque", 0.031).disturbances.torque == 0.031
    assert made("noise of spin", 2.0).sensors.spin.noise == pytest.approx(math.pi / 90.0)
    assert made("readings late by", 1.0).sensors.delay == 1.0
    half = made("all of lab", 0.5)
    assert (half.body.mass, half.thrusters.latency) == ((0.875, 1.125), (0.0, 0.05))
    assert half.sensors.position.noise == pytest.approx((0.0025, 0.0025))
    assert made("all of lab", 1.0).disturbances == load_conditions("lab").disturbances


def made(name: str, size: float) -> Conditions:
    assert size in FOUND[name].sizes
    return FOUND[name].make(size)


@pytest.mark.parametrize("effect", FOUND.values(), ids=FOUND)
def test_nothing_at_the_nominal_size_and_always_more(effect):
    """Flown, as some do draw then: least on-times of a period, which every valve keeps, and full shares."""
    world = effect.make(effect.nominal)
    states = [
        fly(
            PLATFORM,
            TASK,
            FULL,
            scenarios(TASK, PLATFORM, 1, 2),
            SHORT,
            conditions=conditions,
            draws=draws(1, 2),
        ).states
        for conditions in (None, world)
    ]
    np.testing.assert_allclose(*map(leaves, states), rtol=0, atol=1e-12)
    away = [abs(size - effect.nominal) for size in effect.sizes]
    assert away == sorted(set(away))
    assert away[0] > 0.0
    assert all(level.conditions.or_none for level in effect.levels())


def test_names_of_conditions_are_files_apart():
    """Also of users' files in folders."""
    names = [level.name for effect in FOUND.values() for level in effect.levels()]
    given = "lab", "lab.toml", "a/lab.toml", "a-lab.toml"
    names += [Level(name_or_file, None, Conditions()).name for name_or_file in given]
    names += [level.name for level in failure_levels(PLATFORM)]
    assert len(set(names)) == len(names)
    assert all(name.replace("-", "").replace(".", "").isalnum() for name in names)


def test_effects_are_those_that_a_craft_can_have():
    """Wheels alone have no valves, and hold none of the forces of `lab`."""
    craft = load_spacecraft("innocube")
    found = {effect.name: effect for effect in applicable_effects(craft, Timing())}
    strongest = max(wheel.max_torque for wheel in craft.wheels)
    assert found["torque"].sizes[-1] == pytest.approx(0.7 * strongest, rel=0.05)
    assert {"force", "latency", "one thruster weaker by", "all of lab"}.isdisjoint(found)
    assert failure_levels(craft) == []


def test_pushes_are_shares_of_the_strongest_thruster():
    """atmos: 1.5 N at 0.12 m across and 0.12 m along, so 0.18 N m; valves that pulse have no least time."""
    found = {
        effect.name: effect for effect in applicable_effects(load_spacecraft("atmos"), Timing())
    }
    assert found["force"].sizes == (0.15, 0.3, 0.45, 0.75, 1.0)
    assert found["torque"].sizes == (0.018, 0.036, 0.054, 0.09, 0.13)
    assert "least on-time" not in found
