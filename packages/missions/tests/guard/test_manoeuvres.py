"""Which thrusters of a backup manoeuvre open: hand-worked angles from its direction, and spins."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rans_missions.guard.manoeuvres import Thrusters

from rans.episode.step import Setup, World
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import load_task

PLATFORM = load_spacecraft("floating-platform")
TASK = load_task("avoid")
THRUSTERS = Thrusters.of(World(Setup(PLATFORM, TASK, TASK.timing)))


def opened(push: float, spin: float = 0.0) -> bool:
    """Whether the first thruster opens, for an angle of the direction from its own, degrees, and a spin, rad/s."""
    x, y = THRUSTERS.directions[0]
    angle = math.atan2(y, x) + math.radians(push)
    still = Vec2(0.0, 0.0)
    state = PlanarState(still, Heading(0.0), still, spin)
    command = THRUSTERS.pushing(state, Vec2(math.cos(angle), math.sin(angle)))
    return bool(command[0] > 0.0)


def turn() -> float:
    """What a pulse of the first thruster adds to the spin, rad/s: force times arm by the inertia and the period."""
    first = PLATFORM.thrusters[0]
    arm = np.subtract(first.position, PLATFORM.centre_of_mass)
    torque = first.force * np.cross(arm, first.direction)[2]
    return float(torque / PLATFORM.inertia[2][2] * TASK.timing.control_period)


def test_thrusters_within_60_degrees_open():
    assert opened(59.0)
    assert opened(-59.0)
    assert not opened(61.0)


@pytest.mark.parametrize(("part", "opens"), [(0.9, False), (1.1, True), (-1.1, False)])
def test_across_the_direction_those_open_that_would_stop_the_spin(part, opens):
    """A spin that one pulse would stop scores 0.5, which is not enough yet."""
    assert abs(turn()) > 1e-3
    assert opened(90.0, -part * turn()) == opens


def test_no_spin_opens_a_thruster_that_pushes_the_wrong_way():
    """The score of a spin is at most 0.75: at cos 105 degrees = -0.26 less than 0.5 is left, at cos 104 more."""
    fast = -100.0 * turn()
    assert opened(104.0, fast)
    assert not opened(105.0, fast)
    # One along the direction that quickens such a spin stays shut: 1 - 0.75 is below 0.5.
    assert not opened(0.0, -fast)
