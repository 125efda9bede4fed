"""Bags as logs of flights, of several kinds of robots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rans.deploy.robot.bag import BagMessage, BagWriter
from rans.deploy.robot.frames import Motion
from rans.deploy.robot.interfaces import RobotName, interface
from rans.deploy.robot.logs import read_bag
from rans.deploy.robot.messages import JOINTS, TEXT, text_message
from rans.deploy.robot.node import FLIGHT_TOPIC
from rans.errors import ConfigError
from rans.model.spacecraft_file import load_spacecraft

PLATFORM = load_spacecraft("floating-platform")


@pytest.mark.parametrize("robot", ["ros", "pose", "odometry", "px4", "roboran", "pingu"])
def test_what_a_robot_said_comes_back(robot: RobotName, tmp_path: Path) -> None:
    ends = interface(robot, 8, 8)
    bag = BagWriter(tmp_path / "flight.mcap")
    rows = []
    for k in range(5):
        angle = 0.3 * k
        half = 0.5 * angle
        motion = Motion(
            np.array([0.1 * k, -0.2 * k, 0.0]),
            np.array([np.cos(half), 0.0, 0.0, np.sin(half)]),
            np.array([0.5, 0.25, 0.0]),
            np.array([0.0, 0.0, 0.125]),
        )
        command = (np.arange(8) == k).astype(float)
        now = (k + 1) * 200_000_000
        for message in (*ends.state(motion, now), *ends.command(command.tolist(), now)):
            bag.write(BagMessage(now, message.topic, message.kind, message.data))
        rows.append((0.2 * k, 0.1 * k, -0.2 * k, angle, command))
    bag.close()
    log = read_bag(tmp_path / "flight.mcap", PLATFORM, robot)
    assert log.times == pytest.approx([row[0] for row in rows])
    assert log.position == pytest.approx(np.array([row[1:3] for row in rows]), abs=1e-6)
    assert log.attitude == pytest.approx([row[3] for row in rows], abs=1e-6)
    assert log.commands == pytest.approx(np.array([row[4] for row in rows]))
    if ends.has_velocity:
        assert log.velocity == pytest.approx(np.tile([0.5, 0.25], (5, 1)), abs=1e-6)
        assert log.spin == pytest.approx(np.full(5, 0.125), abs=1e-6)
    else:
        assert np.isnan(log.velocity).all()


def test_speeds_of_wheels_come_back_beside_poses(tmp_path: Path) -> None:
    """A sensor_msgs/JointState as rosbags' own classes write it; one of other joints is left out."""
    from rosbags.typesys import Stores, get_typestore

    craft = load_spacecraft("pingu")
    ends = interface("ros", 9, 8)
    still = Motion(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.zeros(3))
    store = get_typestore(Stores.ROS2_JAZZY)
    kinds = store.types
    bag = BagWriter(tmp_path / "flight.mcap")
    for k in range(6):
        now = (k + 1) * 200_000_000
        for message in (*ends.state(still, now), *ends.command([0.0] * 8 + [0.1 * k], now)):
            bag.write(BagMessage(now, message.topic, message.kind, message.data))
        velocity = np.array([2.5 * k]) if k != 3 else np.array([7.0, 8.0])  # of two joints
        header = kinds["std_msgs/msg/Header"](kinds["builtin_interfaces/msg/Time"](0, now), "")
        joints = kinds[JOINTS](header, ["flywheel"], np.zeros(0), velocity, np.zeros(0))
        bag.write(
            BagMessage(
                now + 10**6, "joint_states", JOINTS, bytes(store.serialize_cdr(joints, JOINTS))
            )
        )
    bag.close()
    log = read_bag(tmp_path / "flight.mcap", craft)
    assert log.wheel_speeds is not None
    read = np.isfinite(log.wheel_speeds[:, 0])
    assert log.times[read] == pytest.approx([0.001, 0.201, 0.401, 0.801, 1.001])
    assert log.wheel_speeds[read, 0] == pytest.approx([0.0, 2.5, 5.0, 10.0, 12.5])
    assert np.isnan(log.position[read]).all()
    assert log.commands[:, 8] == pytest.approx(0.1 * np.arange(6))


def test_a_bag_of_other_topics_is_refused(tmp_path: Path) -> None:
    ends = interface("odometry", 8, 8)
    bag = BagWriter(tmp_path / "flight.mcap")
    for message in ends.command([0.0] * 8, 0):
        bag.write(BagMessage(0, message.topic, message.kind, message.data))
    bag.close()
    with pytest.raises(ConfigError, match=r"0 readings and 1 commands .* --robot"):
        read_bag(tmp_path / "flight.mcap", PLATFORM, "ros")


def test_a_flight_without_its_robot_is_told_apart_from_other_topics(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "flight.mcap")
    plan = text_message('{"robot": "ros"}')
    bag.write(BagMessage(0, FLIGHT_TOPIC, TEXT, plan))
    for message in interface("ros", 8, 8).command([0.0] * 8, 0):
        bag.write(BagMessage(0, message.topic, message.kind, message.data))
    bag.close()
    with pytest.raises(ConfigError, match=r"0 readings and 1 commands .* no state came"):
        read_bag(tmp_path / "flight.mcap", PLATFORM)
