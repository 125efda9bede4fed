"""Propellant: Tsiolkovsky's equation, an independent integration, Drake, and the end of a tank."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

import rans
from rans.effectors.motion import held
from rans.errors import ConfigError
from rans.model.accuracy import chosen
from rans.model.actuators import Propellant
from rans.model.body import Body
from rans.model.dynamics import PlanarState, undelayed
from rans.model.fields import Heading, Vec2
from rans.model.timing import Timing
from rans.randomization.conditions import BodyConditions, Conditions
from tests.support.effector_crafts import BURNING, LANDER, commands, platform, rocket, states

G0 = 9.80665


def at_rest(left: float) -> PlanarState:
    """In W's origin, with so much propellant, kg."""
    zero = np.zeros(1)
    return PlanarState(
        Vec2(zero, zero), Heading(zero), Vec2(zero, zero), zero, stores=(np.full(1, left),)
    )


@pytest.mark.slow
def test_a_rocket_gains_what_tsiolkovsky_says() -> None:
    """500 N at 200 s for 100 s use 25.493 kg of 100: 576.9 m/s, in periods of a tenth of a second."""
    craft = rocket()
    state = at_rest(60.0)
    timing = Timing(control_period=0.1)
    for _ in range(1000):
        state = held(state, craft, Body.of(craft), (1.0,), timing)
    used = 500.0 / (200.0 * G0) * 100.0
    assert state.stores[0][0] == pytest.approx(60.0 - used, rel=1e-12)
    expected = 200.0 * G0 * math.log(100.0 / (100.0 - used))
    assert state.v.x[0] == pytest.approx(expected, rel=1e-13)


def test_thrust_ends_when_the_tank_is_empty() -> None:
    """10 g left: 0.03923 s of thrust within the period of 1 s, and a straight way afterwards."""
    craft = rocket()
    ends = 0.01 / (500.0 / (200.0 * G0))
    state = held(at_rest(0.01), craft, Body.of(craft), (1.0,), Timing(control_period=1.0))
    assert state.stores[0][0] == 0.0
    speed = 200.0 * G0 * math.log(40.01 / 40.0)
    assert state.v.x[0] == pytest.approx(speed, rel=1e-6)
    assert state.p.x[0] == pytest.approx(speed * (1.0 - 0.5 * ends), rel=1e-5)
    after = held(state, craft, Body.of(craft), (1.0,), Timing(control_period=1.0))
    assert (after.v.x[0], after.stores[0][0]) == (state.v.x[0], 0.0)


def test_leaking_thrusters_use_propellant_and_dead_ones_none() -> None:
    craft = BURNING
    body = replace(Body.of(craft), gain=(0.0,) * 8, leak=(0.5, *(0.0,) * 7))
    start = states(craft, 1)
    timing = Timing(control_period=1.0, substeps=1)
    after = held(start, craft, body, (1.0,) * 8, timing)
    used = 0.5 * craft.thrusters[0].force / (5.0 * G0)
    assert start.stores[0] - after.stores[0] == pytest.approx(used, rel=1e-12)
    still = replace(body, leak=(0.0,) * 8)
    assert held(start, craft, still, (1.0,) * 8, timing).stores[0] == start.stores[0]


def test_craft_without_propellant_count_no_exhaust() -> None:
    craft = platform()
    ((_, first, _, _),) = undelayed(craft, Body.of(craft), (1.0,) * 8, 0.2)
    assert first.exhaust is None


LIGHT = replace(BURNING, propellant=Propellant(3.0, 0.5))
"""3 of 5.32 kg are propellant, which its thrusters burn within a second or two."""


@pytest.mark.filterwarnings("ignore:.*can hardly be controlled:UserWarning")
@pytest.mark.parametrize("dimension", [2, 3])
def test_conditions_leave_mass_to_a_craft_with_an_empty_tank(dimension: int) -> None:
    """Half of the mass is propellant: with 0.499 times the mass the empty craft would weigh less than nothing."""
    craft = LIGHT if dimension == 2 else LANDER
    tank = craft.propellant
    assert tank is not None
    craft = replace(craft, propellant=replace(tank, mass=0.5 * craft.mass))
    task = "go-to-pose"
    for low in (0.1, 0.499, 0.5):
        light = Conditions(body=BodyConditions(mass=(low, 1.0)))
        among_others = Conditions(others=(light,))
        for conditions in (light, among_others):
            with pytest.raises(ConfigError, match="propellant"):
                rans.Engine(craft, task, 2, conditions=conditions)
        with pytest.raises(ConfigError, match="propellant"):
            rans.Engine(
                craft,
                task,
                2,
                body=replace(Body.of(craft), mass=np.array([1.0, low]) * craft.mass),
            )
    for most in (0.501, 1.0):
        rans.Engine(craft, task, 2, conditions=Conditions(body=BodyConditions(mass=(0.501, most))))


@pytest.mark.filterwarnings("ignore:.*can hardly be controlled:UserWarning")
def test_the_lightest_craft_that_conditions_may_have_flies_on_an_empty_tank() -> None:
    """Of its 3.19 kg 0.19 are no propellant; its thrust lasts until that is gone and moves it no further."""
    conditions = Conditions(body=BodyConditions(mass=0.6))
    engine = rans.Engine(
        LIGHT, rans.GoToPose(fail_distance=1e9, fail_spin=1e9), 8, conditions=conditions
    )
    spin = []
    for k in range(40):
        result = engine.step(torch.from_numpy(commands(LIGHT, 8, seed=k)).float())
        assert torch.isfinite(torch.as_tensor(result.observation)).all()
        spin.append(np.array(engine.state.w))
    assert (np.array(engine.state.stores[0]) == 0.0).all()
    np.testing.assert_array_equal(spin[-1], spin[-2])


@pytest.mark.filterwarnings("ignore:.*can hardly be controlled:UserWarning")
def test_substeps_are_for_the_lightest_craft() -> None:
    """An empty craft of a body with half the mass has less than half of the designed one's inertia."""
    body = Body.of(LIGHT)
    light = replace(body, mass=0.6 * body.mass, inertia=(0.6 * body.inertia[0],))
    timing = Timing(control_period=0.2)
    few, many = (chosen(LIGHT, timing, x).substeps or 0 for x in (body, light))
    # Empty they weigh 2.32 and 0.192 kg, and their inertia is in proportion.
    assert many > 5 * few
