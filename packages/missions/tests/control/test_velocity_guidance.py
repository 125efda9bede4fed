"""The frame of guidance that changes velocities, with a law that is a number, against SciPy's rotations."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from rans_missions.control.velocity_guidance import VelocityGuidance, closed_ellipse
from rans_missions.tasks import Hold
from scipy.spatial.transform import Rotation

from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from tests.support.clohessy_wiltshire import transition

TASK = Hold()
N = TASK.mean_motion
CHANGE = np.array([[0.02, -0.01, 0.005], [0.0, 0.03, 0.0], [0.01, 0.01, 0.01]])
"""Changes of velocity in W, m/s, within what a control period can give."""


class Constant(VelocityGuidance[Hold]):
    """Asks for the same changes in every period, of all craft but the last."""

    name = "constant"
    mission = Hold
    purpose = "constant changes fly to hold points"

    def __init__(self) -> None:
        super().__init__("vbar-chaser", TASK)
        self.times: list[float] = []

    def velocity_change(self, state: Any, goal: Any, now: float) -> tuple[np.ndarray, np.ndarray]:
        self.times.append(now)
        return CHANGE, np.array([True, True, False])


def turned(rotations: Rotation) -> SpatialState:
    """States at rest with these attitudes."""
    zero = np.zeros(len(rotations))
    x, y, z, w = rotations.as_quat().T
    still = Vec3(zero, zero, zero)
    return SpatialState(still, Quat(w, x, y, z), still, still)


def test_commands_give_the_change_in_the_world_frame() -> None:
    law = Constant()
    law.reset(3)
    rotations = Rotation.random(3, rng=np.random.default_rng(1))
    command = law.act(turned(rotations), turned(rotations), np.zeros((3, 1)))
    forces = np.array([np.multiply(t.force, t.direction) for t in law.craft.thrusters])
    change = rotations.apply(command @ forces) * TASK.timing.control_period / law.craft.mass
    np.testing.assert_allclose(change[:2], CHANGE[:2], atol=1e-12)  # rounding
    assert not command[2].any()


@pytest.mark.parametrize("quarter", [0.25, 0.5, 1.0])
def test_a_closed_ellipse_is_twice_as_long_as_wide_and_closes(quarter: float) -> None:
    """From (a, 0) it passes (0, -2 a) after a quarter of an orbit, and comes back after a whole one."""
    u, v = closed_ellipse(N, 30.0, 0.0)
    start = np.array([30.0, 0.0, 0.0, u, v, 0.0])
    end = transition(N, 2.0 * math.pi / N * quarter)[:6, :6] @ start
    expected = {0.25: (0.0, -60.0), 0.5: (-30.0, 0.0), 1.0: (30.0, 0.0)}[quarter]
    np.testing.assert_allclose(end[:2], expected, atol=1e-9)
    np.testing.assert_allclose(end[3:5], closed_ellipse(N, *expected), atol=1e-11)
