"""Commands of a craft: their ranges, spaces, checks, and what a policy's outputs become."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest

from rans.effectors.commands import action_space
from rans.model.actuators import Propellant, Throttle
from rans.model.spacecraft_file import parse_spacecraft, to_toml
from tests.support.effector_crafts import BURNING, CUBESAT, LANDER, WHEELED, platform

SHUT = platform(actuators=Throttle(0.3, 0.8))
"""Engines of 30 to 80 % that may be shut."""


def test_ranges_follow_from_the_effectors():
    assert {(one.kind, one.low, one.high) for one in LANDER.commands} == {("throttle", 0.3, 0.8)}
    assert {(one.kind, one.low, one.high) for one in SHUT.commands} == {("throttle", 0.0, 0.8)}
    assert [one.name for one in WHEELED.commands[-2:]] == ["thruster 7", "wheel 0"]
    assert WHEELED.commands[-1][1:] == ("wheel", -1.0, 1.0)
    assert [store.name for store in replace(WHEELED, propellant=Propellant(1.0, 9.0)).stores] == [
        "propellant",
        "momentum of wheel 0",
    ]


def test_spaces_follow_from_the_ranges():
    assert action_space(LANDER) == gymnasium.spaces.Box(0.3, 0.8, (6,), np.float32)
    space = action_space(CUBESAT)
    assert isinstance(space, gymnasium.spaces.Box)
    np.testing.assert_array_equal(space.low, [0.0] * 6 + [-1.0] * 3)
    np.testing.assert_array_equal(space.high, [1.0] * 9)


@pytest.mark.parametrize("craft", [LANDER, CUBESAT, WHEELED, BURNING, SHUT], ids=lambda c: c.name)
def test_a_file_says_all_of_it(craft):
    read = parse_spacecraft(to_toml(craft), "x")
    assert (read.wheels, read.propellant) == (craft.wheels, craft.propellant)
    assert read.actuators == craft.actuators
