"""The frame of guidance that changes velocities, with a law that is a number, against SciPy's rotations."""

from __future__ import annotations

from typing import Any

import numpy as np
from rans_missions.control.velocity_guidance import VelocityGuidance
from rans_missions.tasks import Hold
from scipy.spatial.transform import Rotation

from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3

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


def test_commands_give_the_change_in_the_world_frame():
    law = Constant()
    law.reset(3)
    rotations = Rotation.random(3, rng=np.random.default_rng(1))
    command = law.act(turned(rotations), turned(rotations), np.zeros((3, 1)))
    forces = np.array([np.multiply(t.force, t.direction) for t in law.craft.thrusters])
    change = rotations.apply(command @ forces) * TASK.timing.control_period / law.craft.mass
    np.testing.assert_allclose(change[:2], CHANGE[:2], atol=1e-12)  # rounding
    assert not command[2].any()
