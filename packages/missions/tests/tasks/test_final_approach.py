"""Final approach: where the port is, hand-worked margins, and a guidance that flies through the corridor."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_missions.tasks import FinalApproach
from scipy.spatial.transform import Rotation

from rans.episode.drawing import columns, rotations
from rans.episode.scenario import scenarios
from rans.model.spacecraft_file import load_spacecraft
from tests.support.orbit_states import at

CHASER = load_spacecraft("vbar-chaser")
N = FinalApproach().mean_motion


def along_orbit(task: FinalApproach, spin: tuple[float, float, float]) -> Any:
    """A port on the orbit behind the target, whose x axis is along -y, with a spin about W's z axis."""
    goal = scenarios(task, CHASER, seed=1, count=1).goal
    x, y, z, w = Rotation.from_euler("z", -90.0, degrees=True).as_quat()
    turned = type(goal.attitude)(*(np.array([one]) for one in (w, x, y, z)))
    rate = type(goal.p)(*(np.array([one]) for one in spin))
    return task.later(replace(goal, attitude=turned, w=rate), 0.0)


def test_the_port_turns_about_the_target():
    """After 500 s it is where SciPy's rotation takes it; its velocity is how its place changes."""
    task = FinalApproach()
    goal = scenarios(task, CHASER, seed=2, count=32).goal
    spin = np.einsum("nij,nj->ni", rotations(goal), columns(goal.w))
    turn = Rotation.from_rotvec(spin * 500.0)
    np.testing.assert_allclose(
        columns(task.later(goal, 500.0).p), turn.apply(columns(goal.p)), atol=1e-12
    )
    np.testing.assert_allclose(columns(goal.v), np.cross(spin, columns(goal.p)), atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(columns(goal.p), axis=1), 2.0, atol=1e-12)


def test_margins_worked_out_by_hand():
    """30 m behind the target on its orbit, 4 m beside it at 0.2 m/s, with the port there."""
    task = FinalApproach()
    goal = along_orbit(task, (0.0, 0.0, 0.0))
    np.testing.assert_allclose(np.ravel(columns(goal.p)), [0.0, -2.0, 0.0], atol=1e-12)
    state = at((4.0, -30.0, 0.0), (0.0, 0.2, 0.0))
    margins = task.constraints(state, goal)
    # The apex is 0.1 m / tan 10 degrees behind the port.
    apex = 28.0 + 0.1 / math.tan(math.radians(10.0))
    inside = math.sin(math.radians(10.0) - math.atan2(4.0, apex)) * math.hypot(4.0, apex)
    assert margins["cone"].item() == pytest.approx(inside, abs=1e-8)
    distance = math.hypot(4.0, 30.0)
    assert margins["target"].item() == pytest.approx(distance - 1.9, abs=1e-8)
    assert margins["speed"].item() == pytest.approx(0.1 + 4.0 * N * distance - 0.2, abs=1e-8)
    # Farther than 50 m from the apex the cone does not count: there 6 m beside the axis is allowed.
    assert task.constraints(at((60.0, -30.0, 0.0), (0.0,) * 3), goal)["cone"].item() > 0.0
    assert task.constraints(at((20.0, -30.0, 0.0), (0.0,) * 3), goal)["cone"].item() < 0.0


def test_who_is_at_a_port_that_turns_must_turn_with_it():
    """At 0.05 rad/s the port moves at 0.1 m/s: at rest there it is as fast as the tolerance."""
    task = FinalApproach()
    goal = along_orbit(task, (0.0, 0.0, 0.06))
    still = at((0.0, -2.0, 0.0), (0.0,) * 3)
    assert not task.done(still, goal).item()
    assert task.done(at((0.05, -2.0, 0.0), (0.1, 0.0, 0.0)), goal).item()
    assert not task.done(at((0.11, -2.0, 0.0), (0.1, 0.0, 0.0)), goal).item()
