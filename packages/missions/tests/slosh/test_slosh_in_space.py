"""Sloshing liquid as a spherical pendulum: against Drake, by what a free pair conserves, and in every engine."""

from __future__ import annotations

from dataclasses import replace

import pytest

import rans
from rans.errors import ConfigError
from rans.randomization.conditions import (
    BodyConditions,
    Conditions,
)
from tests.support.slosh import IN_SPACE, IN_SPACE_SLOSH


@pytest.mark.parametrize("is_alone", [True, False])
def test_bodies_for_which_friction_is_too_fast_are_refused(is_alone: bool) -> None:
    """Steps are those of the designed craft; this flight would end in NaN."""
    slosh = replace(IN_SPACE_SLOSH, length=0.5, hinge=(0.0, -0.5, 0.0), direction=(0.0, 1.0, 0.0))
    craft = replace(IN_SPACE, further_effectors=(replace(slosh, damping=2.0),))
    rans.Engine(craft, "go-to-pose", 2)
    conditions = Conditions(body=BodyConditions(inertia=(0.05, 1.0)))
    conditions = conditions if is_alone else replace(Conditions(), others=(conditions,))
    with pytest.raises(ConfigError, match=r"stop the rod of .*narrow the ranges"):
        rans.Engine(craft, "go-to-pose", 2, conditions=conditions)


def test_a_mass_that_leaves_no_rigid_craft_is_refused() -> None:
    far = replace(IN_SPACE_SLOSH, hinge=(0.3, 0.0, 0.0))
    with pytest.raises(ConfigError, match=r"slosh mass must be .* adds"):
        replace(IN_SPACE, further_effectors=(far,))
    light = Conditions(body=BodyConditions(inertia=0.1))
    with pytest.raises(ConfigError, match=r"leaves no inertia to 'sloshing in space'"):
        rans.Engine(IN_SPACE, "go-to-pose", 2, conditions=light)
