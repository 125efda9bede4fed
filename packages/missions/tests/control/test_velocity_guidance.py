"""The frame of guidance that changes velocities, with a law that is a number, against SciPy's rotations."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from rans_missions.control.circumnavigation import Circumnavigation
from rans_missions.control.corridor import Corridor
from rans_missions.control.passive_approach import PassiveApproach
from rans_missions.control.velocity_guidance import VelocityGuidance, closed_ellipse, weaker
from rans_missions.tasks import Hold
from scipy.spatial.transform import Rotation

from rans.errors import ConfigError
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


def test_time_begins_with_the_reset() -> None:
    law = Constant()
    law.reset(3)
    state = turned(Rotation.identity(3))
    for _ in range(2):
        law.act(state, state, np.zeros((3, 1)))
    law.reset(3)
    law.act(state, state, np.zeros((3, 1)))
    assert law.times == [0.0, TASK.timing.control_period, 0.0]


@pytest.mark.parametrize(
    ("guidance", "sentence"),
    [
        (Circumnavigation, "flies inspections, and GoToPose is not one"),
        (Corridor, "flies final approaches, and GoToPose is not one"),
        (PassiveApproach, "flies to hold points, and GoToPose is not one"),
    ],
)
def test_another_task_is_refused_by_the_purpose(guidance: Any, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        guidance("floating-platform", "go-to-pose")


@pytest.mark.parametrize("quarter", [0.25, 0.5, 1.0])
def test_a_closed_ellipse_is_twice_as_long_as_wide_and_closes(quarter: float) -> None:
    """From (a, 0) it passes (0, -2 a) after a quarter of an orbit, and comes back after a whole one."""
    u, v = closed_ellipse(N, 30.0, 0.0)
    start = np.array([30.0, 0.0, 0.0, u, v, 0.0])
    end = transition(N, 2.0 * math.pi / N * quarter)[:6, :6] @ start
    expected = {0.25: (0.0, -60.0), 0.5: (-30.0, 0.0), 1.0: (30.0, 0.0)}[quarter]
    np.testing.assert_allclose(end[:2], expected, atol=1e-9)
    np.testing.assert_allclose(end[3:5], closed_ellipse(N, *expected), atol=1e-11)


def test_a_change_that_is_too_large_keeps_its_direction() -> None:
    """0.3 and -0.6 m/s become a third where 0.2 m/s is possible; what is small enough stays as it is."""
    changes = np.array([[0.3, -0.6, 0.0], [0.05, 0.0, -0.1]])
    given, largest = weaker(changes, 0.2)
    np.testing.assert_allclose(given, [[0.1, -0.2, 0.0], [0.05, 0.0, -0.1]], atol=1e-15)
    np.testing.assert_allclose(largest, [[0.6], [0.1]])


def test_what_a_period_can_give() -> None:
    """10 N for the control period along every axis, of 500 kg."""
    assert Constant()._most == pytest.approx(10.0 * TASK.timing.control_period / 500.0)
