"""Sloshing liquid as a spherical pendulum: against Drake, by what a free pair conserves, and in every engine."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import rans
from rans.effectors.motion import held
from rans.errors import ConfigError
from rans.model.body import Body
from rans.model.timing import Timing
from rans.randomization.conditions import (
    BodyConditions,
    Conditions,
    EffectorConditions,
)
from rans.structure import Range
from tests.support.effector_crafts import states
from tests.support.host_kernels import (
    engine_on_host,  # noqa: F401  (a fixture)
)
from tests.support.slosh import IN_SPACE, IN_SPACE_SLOSH


def test_small_swings_in_both_directions_have_the_frequency_of_a_pendulum() -> None:
    """A light mass in a heavy craft that accelerates along x swings with sqrt(a / l) along y and z."""
    slosh = rans.Slosh(1e-5, 0.1, (0.0, 0.0, 0.0), (-1.0, 0.0, 0.0))
    craft = replace(rans.load_spacecraft("free-flyer"), further_effectors=(slosh,))
    columns = np.array(craft.wrench_map)
    ahead = [i for i in range(craft.thruster_count) if columns[i, 0] > 0]
    total = columns[ahead].sum(axis=0)
    np.testing.assert_allclose(total[1:], 0.0, atol=1e-12)
    command = tuple(float(i in ahead) for i in range(craft.thruster_count))
    still = states(craft, 2, spin=0.0)
    # 0.01 rad towards y, and towards z.
    away = 0.01 * np.eye(2)
    zeros = (np.zeros(2),) * 3
    rod = (-np.sqrt(1.0 - (away**2).sum(axis=0)), *away)
    start = replace(
        still, w=replace(still.w, x=zeros[0], y=zeros[0], z=zeros[0]), stores=(*rod, *zeros)
    )
    period = 2.0 * math.pi / slosh.frequency(total[0] / craft.mass)
    state = held(start, craft, Body.of(craft), command, Timing(control_period=period, substeps=64))
    # The period of a swing of 0.01 rad is longer by 0.01^2 / 16.
    np.testing.assert_allclose(state.stores[1:3], away, rtol=1e-5, atol=1e-8)
    np.testing.assert_allclose(state.stores[3:], 0.0, atol=1e-5)


@pytest.mark.parametrize(
    ("inertia", "damping"), [((0.05, 1.0), 1.0), (1.0, (1.0, 20.0))], ids=["inertia", "damping"]
)
@pytest.mark.parametrize("is_alone", [True, False])
def test_bodies_for_which_friction_is_too_fast_are_refused(
    inertia: Range, damping: Range, is_alone: bool
) -> None:
    """Steps are those of the designed craft; this flight would end in NaN."""
    slosh = replace(IN_SPACE_SLOSH, length=0.5, hinge=(0.0, -0.5, 0.0), direction=(0.0, 1.0, 0.0))
    craft = replace(IN_SPACE, further_effectors=(replace(slosh, damping=2.0),))
    rans.Engine(craft, "go-to-pose", 2)
    usual = Conditions(effectors=(EffectorConditions("slosh damping"),))
    friction = EffectorConditions("slosh damping", damping)
    conditions = Conditions(body=BodyConditions(inertia=inertia), effectors=(friction,))
    conditions = conditions if is_alone else replace(usual, others=(conditions,))
    with pytest.raises(ConfigError, match=r"stop the rod of .*narrow the ranges"):
        rans.Engine(craft, "go-to-pose", 2, conditions=conditions)


def test_a_mass_that_leaves_no_rigid_craft_is_refused() -> None:
    far = replace(IN_SPACE_SLOSH, hinge=(0.3, 0.0, 0.0))
    with pytest.raises(ConfigError, match=r"slosh mass must be .* adds"):
        replace(IN_SPACE, further_effectors=(far,))
    light = Conditions(body=BodyConditions(inertia=0.1))
    with pytest.raises(ConfigError, match=r"leave no inertia to 'sloshing in space'"):
        rans.Engine(IN_SPACE, "go-to-pose", 2, conditions=light)
