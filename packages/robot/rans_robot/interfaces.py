"""What robots publish and take: topics, message types and frames of each kind of robot, for both of its ends.

Each kind of robot is one class for both ends, so that pilot and twin cannot differ in units or frames.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np

from rans.extend import ConfigError, brief
from rans_robot.frames import Motion, conjugate, rotated, swapped
from rans_robot.messages import (
    FLOATS,
    INTEGERS,
    ODOMETRY,
    POSE,
    PX4_MODE,
    PX4_MOTORS,
    PX4_ODOMETRY,
    TWIST,
    array,
    make,
    measured_at,
    message_header,
    pack,
    pose,
    unpack,
    vector,
)
from rans_robot.validator import Reading, command, finite_vector, frame_of_twist, unit

RobotName = Literal["ros", "pose", "odometry", "px4", "roboran", "pingu"]
PX4_MOTOR_COUNT = 12


class Message(NamedTuple):
    """What goes over a bus."""

    topic: str
    kind: str
    data: bytes


class Interface(ABC):
    """Topics of one kind of robot.

    Args:
        commands: how many commands the craft takes.
        thrusters: how many of them are of thrusters; the others are of wheels.
    """

    has_velocity = True
    """Whether the robot says how fast it is; otherwise velocities are filtered from its poses."""
    inputs: dict[str, str]
    """Topics and types that the robot publishes."""
    outputs: dict[str, str]
    """Topics and types that it takes."""

    def __init__(self, commands: int, thrusters: int) -> None:
        self.commands = commands
        self.thrusters = thrusters

    @abstractmethod
    def read(self, topic: str, data: bytes) -> Reading:
        """Motion in a message of one of the inputs; `ValueError` if it is none."""

    @abstractmethod
    def command(self, values: Sequence[float], now: int) -> list[Message]:
        """Messages that give a command at a time, ns."""

    @abstractmethod
    def state(self, motion: Motion, now: int) -> list[Message]:
        """Messages that the robot publishes of its motion: what a twin sends."""

    @abstractmethod
    def commanded(self, topic: str, data: bytes) -> np.ndarray | None:
        """Command in a message of one of the outputs; None: it has none. `ValueError` if it is no message."""

    def checked(self, values: Sequence[float] | np.ndarray) -> np.ndarray:
        """A command, checked (`ValueError`) to be one: thrusters from 0 to 1, wheels from -1 to 1."""
        low = np.where(np.arange(self.commands) < self.thrusters, 0.0, -1.0)
        return command(values, low, np.ones(self.commands))


def point_numbers(message: object) -> tuple[float, float, float]:
    """Three numbers of a geometry_msgs point or vector."""
    return message.x, message.y, message.z  # type: ignore[attr-defined]


def wxyz(message: object) -> tuple[float, float, float, float]:
    """Four numbers of a geometry_msgs quaternion."""
    return message.w, message.x, message.y, message.z  # type: ignore[attr-defined]


class Floats(Interface):
    """Commands as std_msgs/Float32MultiArray: one number a command, in the contract's order."""

    def __init__(self, commands: int, thrusters: int) -> None:
        super().__init__(commands, thrusters)
        self.outputs = {"commands": FLOATS}

    def command(self, values: Sequence[float], now: int) -> list[Message]:
        """See `Interface`."""
        data = pack(FLOATS, array(FLOATS, values, np.float32))
        return [Message("commands", FLOATS, data)]

    def commanded(self, topic: str, data: bytes) -> np.ndarray | None:
        """See `Interface`."""
        return self.checked(unpack(FLOATS, data).data)


class Poses(Floats):
    """geometry_msgs/PoseStamped, such as that of a motion capture."""

    has_velocity = False
    inputs = {"pose": POSE}  # noqa: RUF012  (of every object)

    def read(self, topic: str, data: bytes) -> Reading:
        """Reading of a pose: m in W, unit quaternion (w first); `ValueError` for numbers that are none.

        See `Interface`.
        """
        message = unpack(POSE, data)
        return Reading(
            measured_at(message),
            position=finite_vector("position", point_numbers(message.pose.position)),
            attitude=unit(wxyz(message.pose.orientation)),
            frame=message.header.frame_id,
        )

    def state(self, motion: Motion, now: int) -> list[Message]:
        """See `Interface`."""
        head = message_header(now, "world")
        message = make(POSE, header=head, pose=pose(motion.position, motion.attitude))
        return [Message("pose", POSE, pack(POSE, message))]


class PosesAndTwists(Poses):
    """geometry_msgs/PoseStamped and TwistStamped: linear velocity in the world, angular in the body."""

    has_velocity = True
    inputs = {"pose": POSE, "twist": TWIST}  # noqa: RUF012

    def read(self, topic: str, data: bytes) -> Reading:
        """Reading of a pose or a twist: m and m/s in W, rad/s in B; see `Interface`."""
        if topic == "pose":
            return super().read(topic, data)
        message = unpack(TWIST, data)
        return Reading(
            measured_at(message),
            velocity=finite_vector("velocity", point_numbers(message.twist.linear)),
            spin=finite_vector("angular velocity", point_numbers(message.twist.angular)),
            frame=message.header.frame_id,
        )

    def state(self, motion: Motion, now: int) -> list[Message]:
        """See `Interface`."""
        twist = make(
            "geometry_msgs/msg/Twist", linear=vector(motion.velocity), angular=vector(motion.spin)
        )
        message = make(TWIST, header=message_header(now, "world"), twist=twist)
        # The twist first, so that a pose completes a state.
        return [Message("twist", TWIST, pack(TWIST, message)), *super().state(motion, now)]


class Odometry(Floats):
    """nav_msgs/Odometry, whose twist is in the body's frame."""

    inputs = {"odom": ODOMETRY}  # noqa: RUF012

    def read(self, topic: str, data: bytes) -> Reading:
        """Reading of an odometry, whose twist is turned from the frame that the message names; see `Interface`."""
        message = unpack(ODOMETRY, data)
        frame = message.header.frame_id
        attitude = unit(wxyz(message.pose.pose.orientation))
        velocity = finite_vector("velocity", point_numbers(message.twist.twist.linear))
        spin = finite_vector("angular velocity", point_numbers(message.twist.twist.angular))
        if frame_of_twist(frame, message.child_frame_id) == "body":
            velocity = rotated(attitude, velocity)
        else:
            spin = rotated(conjugate(attitude), spin)
        position = finite_vector("position", point_numbers(message.pose.pose.position))
        return Reading(measured_at(message), position, attitude, velocity, spin, frame)

    def state(self, motion: Motion, now: int) -> list[Message]:
        """Odometry of a motion at a time (ns), its twist in the body's frame, as ROS has it; see `Interface`.

        `read` turns the twist back, so that the twin's motion comes to the pilot as it was.
        """
        unknown = np.zeros(36)
        linear = rotated(conjugate(motion.attitude), motion.velocity)
        twist = make("geometry_msgs/msg/Twist", linear=vector(linear), angular=vector(motion.spin))
        message = make(
            ODOMETRY,
            header=message_header(now, "world"),
            child_frame_id="body",
            pose=make(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=pose(motion.position, motion.attitude),
                covariance=unknown,
            ),
            twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=unknown),
        )
        return [Message("odom", ODOMETRY, pack(ODOMETRY, message))]


class PX4(Interface):
    """PX4's offboard mode with direct actuators: NED and FRD, twelve motors from 0 to 1, NaN is off."""

    inputs = {"fmu/out/vehicle_odometry": PX4_ODOMETRY}  # noqa: RUF012
    outputs = {"fmu/in/offboard_control_mode": PX4_MODE, "fmu/in/actuator_motors": PX4_MOTORS}  # noqa: RUF012

    def __init__(self, commands: int, thrusters: int) -> None:
        super().__init__(commands, thrusters)
        if commands > PX4_MOTOR_COUNT or commands != thrusters:
            raise ConfigError(
                f"PX4's ActuatorMotors has {PX4_MOTOR_COUNT} thrusters and no wheel, but the spacecraft takes "
                f"{commands} commands, {commands - thrusters} of them of wheels."
            )

    def read(self, topic: str, data: bytes) -> Reading:
        """Reading of PX4's odometry, turned from its frames (north, east, down) into ours; see `Interface`."""
        message = unpack(PX4_ODOMETRY, data)
        if message.pose_frame != 1 or message.velocity_frame != 1:
            raise ValueError(
                f"pose_frame is {message.pose_frame} and velocity_frame {message.velocity_frame}, but "
                "both must be 1, NED"
            )
        motion = swapped(
            Motion(
                finite_vector("position", message.position),
                unit(message.q),
                finite_vector("velocity", message.velocity),
                finite_vector("angular velocity", message.angular_velocity),
            )
        )
        return Reading(int(message.timestamp_sample) * 1000, *motion)

    def command(self, values: Sequence[float], now: int) -> list[Message]:
        """PX4's mode and motors for commands at a time (ns): a shut motor is NaN; see `Interface`.

        Both messages come with every command, since PX4 leaves offboard mode where its stream stops.
        """
        microseconds = now // 1000
        others = ("position", "velocity", "acceleration", "attitude", "body_rate")
        mode = make(
            PX4_MODE,
            timestamp=microseconds,
            **dict.fromkeys(others, False),
            thrust_and_torque=False,
            direct_actuator=True,
        )
        control = np.full(PX4_MOTOR_COUNT, np.nan, np.float32)
        control[: self.commands] = values
        control[control == 0.0] = np.nan
        motors = make(
            PX4_MOTORS,
            timestamp=microseconds,
            timestamp_sample=microseconds,
            reversible_flags=0,
            control=control,
        )
        return [
            Message("fmu/in/offboard_control_mode", PX4_MODE, pack(PX4_MODE, mode)),
            Message("fmu/in/actuator_motors", PX4_MOTORS, pack(PX4_MOTORS, motors)),
        ]

    def state(self, motion: Motion, now: int) -> list[Message]:
        """PX4's odometry of a motion at ``now``, ns: position and velocity in NED (1), q from FRD to NED, w first.

        Variances of 0 and a quality of 100 say that a twin knows its motion exactly.
        """
        mapped = swapped(motion)
        microseconds = now // 1000
        small = np.zeros(3, np.float32)
        message = make(
            PX4_ODOMETRY,
            timestamp=microseconds,
            timestamp_sample=microseconds,
            pose_frame=1,
            position=np.asarray(mapped.position, np.float32),
            q=np.asarray(mapped.attitude, np.float32),
            velocity_frame=1,
            velocity=np.asarray(mapped.velocity, np.float32),
            angular_velocity=np.asarray(mapped.spin, np.float32),
            position_variance=small,
            orientation_variance=small,
            velocity_variance=small,
            reset_counter=0,
            quality=100,
        )
        return [Message("fmu/out/vehicle_odometry", PX4_ODOMETRY, pack(PX4_ODOMETRY, message))]

    def commanded(self, topic: str, data: bytes) -> np.ndarray | None:
        """See `Interface`."""
        if topic != "fmu/in/actuator_motors":
            return None
        control = np.asarray(unpack(PX4_MOTORS, data).control, dtype=float)
        return self.checked(np.where(np.isnan(control), 0.0, control)[: self.commands])


class RoboRAN(Poses):
    """RoboRAN's floating platform: Int16MultiArray of the air bearing and eight valves.

    Its deployment code wires valve ``VALVES[k]`` to thruster k of the agent (snt-spacer/RobRAN-Code, 2025).
    """

    VALVES = (5, 1, 3, 7, 0, 4, 6, 2)
    TOPIC = "fp_cmd_mux/autonomous_control_input"

    def __init__(self, commands: int, thrusters: int) -> None:
        super().__init__(commands, thrusters)
        self.outputs = {self.TOPIC: INTEGERS}
        if commands != len(self.VALVES):
            raise ConfigError(
                f"RoboRAN's message has {len(self.VALVES)} valves, but the spacecraft takes {commands} commands."
            )

    def command(self, values: Sequence[float], now: int) -> list[Message]:
        """See `Interface`."""
        row = np.zeros(1 + len(self.VALVES), np.int16)
        row[0] = 1
        for valve, value in zip(self.VALVES, values, strict=True):
            row[1 + valve] = round(float(value))
        return [Message(self.TOPIC, INTEGERS, pack(INTEGERS, array(INTEGERS, row, np.int16)))]

    def commanded(self, topic: str, data: bytes) -> np.ndarray | None:
        """See `Interface`."""
        row = np.asarray(unpack(INTEGERS, data).data, dtype=float)
        if len(row) != 1 + len(self.VALVES):
            raise ValueError(
                f"the message has {len(row)} numbers, but must have {1 + len(self.VALVES)}"
            )
        return self.checked(row[1 + np.array(self.VALVES)])


class Pingu(Poses):
    """Pingu: Float32MultiArray of air bearing, enable, 8 thrusters, 4 joints and a wheel (snt-spacer/UniLuFP)."""

    TOPIC = "autonomous_control_input"

    def __init__(self, commands: int, thrusters: int) -> None:
        super().__init__(commands, thrusters)
        self.outputs = {self.TOPIC: FLOATS}
        if thrusters != 8 or commands > 9:
            raise ConfigError(
                "Pingu's message has 8 thrusters and a wheel, but the spacecraft takes "
                f"{thrusters} of thrusters and {commands - thrusters} of wheels."
            )

    def command(self, values: Sequence[float], now: int) -> list[Message]:
        """See `Interface`."""
        row = np.zeros(15, np.float32)
        row[:2] = 1.0
        row[2:10] = values[:8]
        row[14] = values[8] if self.commands == 9 else 0.0
        return [Message(self.TOPIC, FLOATS, pack(FLOATS, array(FLOATS, row, np.float32)))]

    def commanded(self, topic: str, data: bytes) -> np.ndarray | None:
        """See `Interface`."""
        row = np.asarray(unpack(FLOATS, data).data, dtype=float)
        if len(row) != 15:
            raise ValueError(f"the message has {len(row)} numbers, but must have 15")
        return self.checked(np.array([*row[2:10], row[14]])[: self.commands])


_KINDS: dict[str, type[Interface]] = {
    "ros": PosesAndTwists,
    "pose": Poses,
    "odometry": Odometry,
    "px4": PX4,
    "roboran": RoboRAN,
    "pingu": Pingu,
}


def interface(name: RobotName, commands: int, thrusters: int) -> Interface:
    """Topics of a kind of robot, for a craft that takes so many commands.

    Raises:
        ConfigError: there is no such kind, or its messages have no room for the craft's commands.
    """
    if not isinstance(name, str) or name not in _KINDS:
        raise ConfigError(
            f"robot must be one of {', '.join(get_args(RobotName))}, got {brief(name)}."
        )
    return _KINDS[name](commands, thrusters)
