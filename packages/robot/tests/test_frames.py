"""Frames of PX4 and of RANS: one pulse a thruster, and examples by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rans_robot.frames import Motion, quaternion_of, rotation, swapped
from rans_robot.interfaces import Interface
from rans_robot.messages import PX4_MOTORS, pack, unpack
from rans_robot.twin import Craft, TwinPlan

from rans.model.spacecraft_file import load_spacecraft

pytest.importorskip("rosbags")
pytest.importorskip("mcap")


PX4_THRUSTERS = [
    # x, y (m) and direction of the force in FRD: PX4-Space-Systems, airframe 70000, in PX4's order.
    ((-0.12, -0.12), (1, 0)),
    ((0.12, -0.12), (-1, 0)),
    ((-0.12, 0.12), (1, 0)),
    ((0.12, 0.12), (-1, 0)),
    ((0.12, -0.12), (0, 1)),
    ((0.12, 0.12), (0, -1)),
    ((-0.12, -0.12), (0, 1)),
    ((-0.12, 0.12), (0, -1)),
]
ATMOS = 17.8, 0.315, 1.5
"""Mass, kg, yaw inertia, kg m^2, and force, N."""


@pytest.mark.parametrize("thruster", range(8))
@pytest.mark.parametrize("heading", [0.0, 100.0])
def test_one_pulse_of_each_thruster_in_px4s_frames(thruster, heading):
    """ActuatorMotors in, VehicleOdometry out, against PX4's own table: Newton's law in NED and FRD by hand."""
    craft = load_spacecraft("atmos")
    plan = TwinPlan(craft, 0.1, robot="px4", start=(1.0, 2.0, heading))
    ends = Interface("px4", 8, 8)
    twin = Craft(plan)
    control = np.full(12, np.nan, np.float32)
    control[thruster] = 1.0
    motors = pack(PX4_MOTORS, {"control": control})
    command = ends.commanded("fmu/in/actuator_motors", motors)
    assert command is not None
    before = unpack(*_last(ends.state(twin.motion, 0)))
    twin.hold(command)
    for _ in range(10):  # 0.1 s, one pulse of full duty
        twin.advance()
    after = unpack(*_last(ends.state(twin.motion, 0)))

    mass, inertia, force = ATMOS
    (x, y), (fx, fy) = PX4_THRUSTERS[thruster]
    # PX4's heading is from north, clockwise from above; RANS's from east, the other way.
    yaw = np.pi / 2 - np.radians(heading)
    assert before.position[:2] == pytest.approx([2.0, 1.0])
    north = np.cos(yaw) * fx - np.sin(yaw) * fy
    east = np.sin(yaw) * fx + np.cos(yaw) * fy
    gained = np.subtract(after.velocity, before.velocity)[:2] / 0.1
    # It turns by 0.0029 rad meanwhile, which changes the direction of the force by 0.1 %.
    assert gained == pytest.approx(np.array([north, east]) * force / mass, abs=2e-4)
    rate = (after.angular_velocity[2] - before.angular_velocity[2]) / 0.1
    assert rate == pytest.approx((x * fy - y * fx) * force / inertia, rel=1e-4)


def _last(messages: list[Any]) -> tuple[str, bytes]:
    return messages[-1].kind, messages[-1].data


def test_frames_by_examples():
    """Facing east, moving north, rolling: by hand."""
    facing_east = Motion(
        np.array([3.0, 4.0, 5.0]),
        quaternion_of(0.0),
        np.array([0.0, 1.0, 0.0]),
        np.array([0.1, 0.2, 0.3]),
    )
    px4 = swapped(facing_east)
    assert px4.position == pytest.approx([4.0, 3.0, -5.0])
    assert px4.velocity == pytest.approx([1.0, 0.0, 0.0])
    assert px4.spin == pytest.approx([0.1, -0.2, -0.3])
    # In NED east is +y: a yaw of 90 degrees about down.
    assert np.abs(px4.attitude) == pytest.approx([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    assert rotation(px4.attitude).apply((1.0, 0.0, 0.0)) == pytest.approx([0.0, 1.0, 0.0])
    assert rotation(px4.attitude).apply((0.0, 0.0, 1.0)) == pytest.approx([0.0, 0.0, 1.0])
    for ours, theirs in zip(facing_east, swapped(px4), strict=True):
        assert theirs == pytest.approx(ours)
