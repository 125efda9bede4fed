"""Many episodes at once, begun under conditions: what they drew."""

from __future__ import annotations

from typing import Any

import pytest

from rans import Conditions, GoToPose
from rans.episode.scenario import draws, scenarios
from rans.episode.step import Episode, Setup, World
from rans.model.random import Draws
from rans.model.spacecraft_file import load_spacecraft

PLATFORM = load_spacecraft("floating-platform")
FLYER = load_spacecraft("free-flyer")
CRAFTS = {2: PLATFORM, 3: FLYER}
BOTH = pytest.mark.parametrize("dimension", [2, 3])
COUNT = 10_000
LIKELY = 1e-4
"""Least probability of what is seen, if drawn as stated; the seed is fixed, so nothing is left to luck."""
TASK = GoToPose(fail_distance=1e3, fail_spin=1e3)


def begun(
    conditions: Conditions, dimension: int = 2, count: int = COUNT
) -> tuple[World, Draws, Episode]:
    world = World(Setup(CRAFTS[dimension], TASK, conditions=conditions))
    own = draws(11, count)
    starts = scenarios(TASK, world.craft, 11, count)
    return world, own, world.begin(starts.start, starts.goal, 0, own)


def parameters(conditions: Conditions, dimension: int = 2, count: int = COUNT) -> Any:
    return begun(conditions, dimension, count)[2].parameters
