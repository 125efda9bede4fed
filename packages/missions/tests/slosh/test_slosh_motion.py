"""Sloshing liquid moves as in Drake, and alike in every engine; SciPy judges it too (`test_slosh_accuracy.py`)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest

import rans
from rans import BodyConditions, Conditions, DisturbanceConditions, Spacecraft, Timing
from rans.episode.flight import fly
from rans.episode.scenario import draws, scenarios
from rans.model.actuators import Wheel
from rans.model.fields import leaves
from rans.reference.flight import fly_in_drake
from tests.support.effector_flights import scripted
from tests.support.host_kernels import (
    engine_on_host,  # noqa: F401  (a fixture)
)
from tests.support.pairs import FallingInSpace, FallingInThePlane
from tests.support.slosh import IN_SPACE, SLOSHING


class Liquid(NamedTuple):
    """A craft with liquid, and what differs between the plane and space."""

    craft: Spacecraft
    wheels: tuple[Wheel, ...]
    stores: tuple[str, ...]
    """Names of the liquid's states."""
    falling: Any
    """Task with gravity."""
    period: float
    """Control period that the engine flies in single precision, s."""


PLANE = Liquid(
    SLOSHING,
    (Wheel((0.0, 0.0, 1.0), 0.05, 0.08, 1e-3),),
    ("slosh angle", "slosh rate"),
    FallingInThePlane(),
    0.2,
)
SPACE = Liquid(
    IN_SPACE,
    (Wheel((1.0, 0.0, 0.0), 0.02, 0.1, 4e-4), Wheel((0.0, 0.6, 0.8), 0.03, 0.2, 5e-4)),
    tuple(f"slosh {what} {axis}" for what in ("direction", "rate") for axis in "xyz"),
    FallingInSpace(),
    0.05,
)
UNEVEN = Conditions(
    body=BodyConditions(mass=(0.8, 1.1), inertia=(0.9, 1.2), centre=(0.0, 0.01)),
    disturbances=DisturbanceConditions(force=(0.1, 0.3), torque=(0.003, 0.01)),
)

both = pytest.mark.parametrize("liquid", [PLANE, SPACE], ids=["plane", "space"])


@both
@pytest.mark.parametrize("how", ["wheels and gravity", "drawn"])
def test_drake_flies_it_alike(liquid, how):
    """A point mass on a revolute or universal joint with friction, in Drake's own multibody equations."""
    is_falling = how == "wheels and gravity"
    craft = replace(liquid.craft, wheels=liquid.wheels if is_falling else ())
    task = liquid.falling if is_falling else rans.GoToPose()
    timing = Timing(episode_steps=12, checks=2)
    starts = scenarios(task, craft, 5, 2)
    seeds = draws(5, 2) if how == "drawn" else None
    given = {"conditions": UNEVEN if how == "drawn" else None, "draws": seeds}
    ours = fly(craft, task, scripted(craft), starts, timing, **given)
    drake = fly_in_drake(craft, task, scripted(craft), starts, timing, **given)
    pairs = [*zip(leaves(ours.states), leaves(drake.states), strict=True)]
    for number, (one, other) in enumerate(pairs):
        gap = np.abs(np.asarray(one) - np.asarray(other))
        # Rates of a liquid in space turn at some 9 rad/s.
        is_rate = craft.dimension == 3 and number >= len(pairs) - 3
        np.testing.assert_array_less(
            np.minimum(gap, abs(gap - 2.0 * np.pi)), 1e-4 if is_rate else 1e-5
        )
    assert np.ptp(ours.states.stores[-2 if craft.dimension == 2 else -4]) > 0.3
