"""Propellant: Tsiolkovsky's equation, an independent integration, Drake, and the end of a tank."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import rans
from rans import BodyConditions, Conditions, ConfigError, Timing
from rans.effectors.propellant import Tank
from rans.model.accuracy import chosen
from rans.model.actuators import Propellant
from rans.model.body import Body
from rans.model.dynamics import Wrench
from rans.model.fields import Vec2
from tests.support.effector_crafts import BURNING, LANDER, commands

LIGHT = replace(BURNING, propellant=Propellant(3.0, 0.5))
"""3 of 5.32 kg are propellant, which its thrusters burn within a second or two."""


@pytest.mark.filterwarnings("ignore:.*can hardly be controlled:UserWarning")
@pytest.mark.parametrize("dimension", [2, 3])
def test_conditions_leave_mass_to_a_craft_with_an_empty_tank(dimension):
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
def test_the_lightest_craft_that_conditions_may_have_flies_on_an_empty_tank():
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
def test_substeps_are_for_the_lightest_craft():
    """An empty craft of a body with half the mass has less than half of the designed one's inertia."""
    body = Body.of(LIGHT)
    light = replace(body, mass=0.6 * body.mass, inertia=(0.6 * body.inertia[0],))
    timing = Timing(control_period=0.2)
    few, many = (chosen(LIGHT, timing, x).substeps or 0 for x in (body, light))
    # Empty they weigh 2.32 and 0.192 kg, and their inertia is in proportion.
    assert many > 5 * few


@pytest.mark.parametrize("last", [None, -2e-3])
def test_no_thrust_fills_a_tank(last):
    """Sums of forces in shut valves are roundings of either sign, here made large."""
    shut = Wrench(Vec2(0.0, 0.0), 0.0, exhaust=-1e-3)
    end = None if last is None else replace(shut, exhaust=last)
    tank = Tank(Propellant(3.0, 0.5), Body.of(LIGHT), None)
    assert [left for _, left in tank.burned((0.2, shut, end, 0.2), 1.0)] == [1.0, 1.0]
