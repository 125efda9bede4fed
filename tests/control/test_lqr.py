"""The LQR settles from everywhere, in every task, on every kind of spacecraft."""

from __future__ import annotations

import math

import numpy as np

from rans import LQR, TASKS, GoToPose, Timing
from rans.control.regulator import distance_scale
from rans.episode.scenario import scenarios
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft_file import load_spacecraft

TASK = GoToPose().for_evaluation()


def test_free_attitude_is_not_turned():
    """Going to a position asks for no attitude: from rest no torque is wanted."""
    craft = load_spacecraft("free-flyer")
    task = TASKS["go-to-position"]()
    starts = scenarios(task, craft, 26, 5)
    wrench = LQR(craft, task, Timing()).wrench(starts.start, starts.goal)
    np.testing.assert_array_equal(wrench[:, 3:], 0.0)
    np.testing.assert_array_less(0.1, np.linalg.norm(wrench[:, :3], axis=1))


def test_wrench_by_hand():
    """Heading 90 degrees, 1 m short along W's x: the force points along B's -y."""
    craft = load_spacecraft("floating-platform")
    zero = np.zeros(1)
    start = PlanarState(Vec2(zero - 1.0, zero), Heading(zero + math.pi / 2), Vec2(zero, zero), zero)
    goal = PlanarState(Vec2(zero, zero), Heading(zero), Vec2(zero, zero), zero)
    force_x, force_y, torque = LQR(craft, TASK, Timing()).wrench(start, goal)[0]
    assert abs(force_x) < 1e-12
    assert force_y < 0
    assert torque < 0  # back to heading 0


def test_near_starts_keep_the_weights():
    assert distance_scale(GoToPose(), load_spacecraft("floating-platform")) == 1.0
    assert distance_scale(GoToPose(), load_spacecraft("free-flyer")) == 1.0
