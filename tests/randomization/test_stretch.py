"""Stretched bodies: moments of inertia of point masses, and the same motion in Drake."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rans
from rans.errors import ConfigError
from rans.flight import fly
from rans.model.fields import leaves
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions
from rans.randomization.parameters import _stretched, examples
from rans.reference.flight import fly_in_drake
from rans.scenario import draws, scenarios
from tests.support.played import Played

CRAFT = rans.load_spacecraft("free-flyer")
STRETCHED = Conditions(rans.BodyConditions(stretch=(0.6, 1.5)))


def test_moments_are_those_of_point_masses_that_move() -> None:
    random = np.random.default_rng(0)
    points = random.normal(size=(9, 3))
    masses = random.random(9)

    def moments(at: np.ndarray) -> list[float]:
        tensor = np.zeros((3, 3))
        for mass, point in zip(masses, at, strict=True):
            tensor += mass * (point @ point * np.eye(3) - np.outer(point, point))
        return [float(tensor[i, j]) for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]

    factors = [0.5, 1.25, 2.0]
    assert _stretched(moments(points), factors) == pytest.approx(moments(points * factors))


def test_bodies_remain_rigid_and_their_ratios_differ() -> None:
    drawn = examples(STRETCHED, CRAFT, 10).body.inertia
    xx, xy, xz, yy, yz, zz = drawn
    assert (xy, xz, yz) == (0.0, 0.0, 0.0)
    assert ((xx < yy + zz) & (yy < xx + zz) & (zz < xx + yy)).all()
    # The moments of a stretched sphere: b^2 + c^2 over a^2 + b^2 has these bounds.
    assert 2.0 < (xx / zz).max() < (1.5**2 + 0.6**2) / (2.0 * 0.6**2) + 1e-9


def test_drake_flies_stretched_bodies_likewise() -> None:
    timing = Timing(0.2, 8, 5)
    count = 3
    starts = scenarios(rans.GoToPose(), CRAFT, 0, count)
    opened = np.random.default_rng(1).integers(0, 2, (5, count, CRAFT.command_count)) * 1.0
    setup: Any = CRAFT, rans.GoToPose(), Played(opened), starts, timing
    flights = [
        how(*setup, conditions=given, draws=draws(0, count))
        for how, given in ((fly, STRETCHED), (fly_in_drake, STRETCHED), (fly, None))
    ]
    ours, judged, designed = (np.array(leaves(flight.states)[:13]) for flight in flights)
    # Steps of 0.025 s, and Drake's of 0.01 s.
    assert np.abs(ours - judged).max() < 1e-7
    assert np.abs(ours - designed).max() > 1e-3


def test_craft_that_cannot_be_stretched_are_refused() -> None:
    with pytest.raises(ConfigError, match="moves in the plane"):
        STRETCHED.check_craft(rans.load_spacecraft("floating-platform"))
    with pytest.raises(ConfigError, match="stretch"):
        replace(STRETCHED, body=rans.BodyConditions(stretch=0.0))
