"""Messages of robots: motions and commands survive them, and their types are those of ROS."""

import numpy as np
import pytest
from rans_robot.frames import Motion
from rans_robot.interfaces import Interface
from rans_robot.messages import (
    FLOATS,
    PX4_MOTORS,
    unpack,
)

pytest.importorskip("rosbags")
pytest.importorskip("mcap")


@pytest.mark.parametrize("robot", ["ros", "odometry", "px4"])
def test_a_motion_survives_its_messages(robot):
    random = np.random.default_rng(3)
    q = random.normal(size=4)
    motion = Motion(
        random.normal(size=3), q / np.linalg.norm(q), random.normal(size=3), random.normal(size=3)
    )
    ends = Interface(robot, 8, 8)
    found = {}
    for message in ends.state(motion, 12_345_678_000):
        assert ends.inputs[message.topic] == message.kind
        reading = ends.read(message.topic, message.data)
        assert reading.measured == 12_345_678_000
        found |= {k: v for k, v in reading._asdict().items() if v is not None}
    assert found["position"] == pytest.approx(motion.position, abs=1e-6)
    assert found["velocity"] == pytest.approx(motion.velocity, abs=1e-6)
    assert found["spin"] == pytest.approx(motion.spin, abs=1e-6)
    assert abs(found["attitude"] @ motion.attitude) == pytest.approx(1.0)


def test_messages_of_laboratories():
    """By hand: RoboRAN's valve 5 is the agent's thruster 0; Pingu's thrusters follow bearing and enable."""
    row = unpack(
        "std_msgs/msg/Int16MultiArray",
        Interface("roboran", 8, 8).command([1.0] + [0] * 7, 0)[0].data,
    )
    assert row.data.tolist() == [1, 0, 0, 0, 0, 0, 1, 0, 0]
    row = unpack(FLOATS, Interface("pingu", 8, 8).command([0.0, 1.0] + [0] * 6, 0)[0].data)
    assert row.data.tolist() == [1, 1, 0, 1] + [0] * 11
    motors = Interface("px4", 8, 8).command([0.0, 0.5] + [0] * 6, 5_000)[1]
    assert len(motors.data) == 72  # as PX4's agent has it
    assert np.isnan(unpack(PX4_MOTORS, motors.data).control[0])
    assert unpack(PX4_MOTORS, motors.data).control[1] == 0.5
