"""Attackers of the safety filter: the adversary pushes into the nearest zone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rans_missions.tasks import Avoid
from rans_missions.tasks.avoid import Zones

from campaigns.attackers import Adversary, Random
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks.shapes import Ball

CRAFT = load_spacecraft("floating-platform")
TASK = Avoid()


@pytest.mark.parametrize("turned", [0.0, 2.0])
def test_the_adversary_pushes_to_the_middle_of_the_zone(turned: float) -> None:
    """The zone is 1 m along y: whatever the attitude, the force in W points there."""
    one = np.ones(1)
    still = Vec2(0.0 * one, 0.0 * one)
    start = PlanarState(still, Heading(turned * one), still, 0.0 * one)
    goal: Any = PlanarState(
        Vec2(3.0 * one, 0.0 * one),
        Heading(0.0 * one),
        still,
        0.0 * one,
        notes=Zones((Ball(Vec2(0.0 * one, 1.0 * one), still, 0.4),)),
    )
    command = Adversary(CRAFT, TASK).act(start, goal, np.zeros((1, 1)))[0]
    force = command @ np.array(CRAFT.wrench_map)[:, :2]
    turn = np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]])
    x, y = turn @ force
    assert y > 2.0 * abs(x)
    assert set(command) == {0.0, 1.0}


def test_random_commands_begin_anew() -> None:
    pilot = Random(CRAFT, TASK)
    seen = []
    for _ in range(2):
        pilot.reset(5)
        seen.append(pilot.act(None, None, np.zeros((5, 1))))
    assert np.array_equal(seen[0], seen[1])
    assert set(seen[0].ravel()) == {0.0, 1.0}
