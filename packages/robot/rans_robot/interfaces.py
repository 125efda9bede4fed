"""What robots publish and take: topics, message types and frames of each kind of robot, for both of its ends.

Each kind of robot is a row of a table for both ends, so that pilot and twin cannot differ in units or frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from rans.extend import ConfigError, brief
from rans_robot.frames import Motion, rotation, swapped
from rans_robot.messages import (
    FLOATS,
    INTEGERS,
    ODOMETRY,
    POSE,
    PX4_MODE,
    PX4_MOTORS,
    PX4_ODOMETRY,
    TWIST,
    numbers,
    pack,
    unpack,
)
from rans_robot.monitor import (
    Reading,
    command,
    command_row,
    finite_vector,
    frame_of_twist,
    require_ned,
    unit,
)

RobotName = Literal["ros", "pose", "odometry", "px4", "roboran", "pingu"]
PX4_MOTOR_COUNT = 12
_PX4_MODE_TOPIC = "fmu/in/offboard_control_mode"


class Message(NamedTuple):
    """What goes over a bus."""

    topic: str
    kind: str
    data: bytes


_MOTION_FIELDS = {
    POSE: {"position": "pose.position", "attitude": "pose.orientation"},
    TWIST: {"velocity": "twist.linear", "spin": "twist.angular"},
    ODOMETRY: {
        "position": "pose.pose.position",
        "attitude": "pose.pose.orientation",
        "velocity": "twist.twist.linear",
        "spin": "twist.twist.angular",
    },
    PX4_ODOMETRY: {
        "position": "position",
        "attitude": "q",
        "velocity": "velocity",
        "spin": "angular_velocity",
    },
}
"""Paths of the fields of a `Motion` in each type."""
_NAMES = {"position": "position", "velocity": "velocity", "spin": "angular velocity"}


class _Row(NamedTuple):
    """The message with a command: where in its array the numbers of thrusters and wheels stand."""

    topic: str
    kind: str
    size: int
    """Numbers of the array; 0: as many as the craft takes commands."""
    thrusters: Sequence[int] = ()
    wheels: Sequence[int] = ()
    ones: Sequence[int] = ()
    """Places that are always 1: air bearing and enable."""
    fewest: int = 0
    """Least number of thrusters."""
    field: str = "data"


_PLATFORM_INPUTS = {"pose": POSE}
_FLOATS = _Row("commands", FLOATS, 0)
_ROBOTS: dict[str, tuple[dict[str, str], _Row]] = {
    # Linear velocities in the world, angular ones in the body.
    "ros": ({"pose": POSE, "twist": TWIST}, _FLOATS),
    "pose": (_PLATFORM_INPUTS, _FLOATS),
    "odometry": ({"odom": ODOMETRY}, _FLOATS),
    # Direct actuators of the offboard mode: NED and FRD, motors from 0 to 1, NaN is off.
    "px4": (
        {"fmu/out/vehicle_odometry": PX4_ODOMETRY},
        _Row(
            "fmu/in/actuator_motors",
            PX4_MOTORS,
            PX4_MOTOR_COUNT,
            range(PX4_MOTOR_COUNT),
            field="control",
        ),
    ),
    # Air bearing and valves: the deployment code wires valve 5 to thruster 0 of the agent, and so on
    # (snt-spacer/RobRAN-Code, 2025).
    "roboran": (
        _PLATFORM_INPUTS,
        _Row(
            "fp_cmd_mux/autonomous_control_input",
            INTEGERS,
            9,
            (6, 2, 4, 8, 1, 5, 7, 3),
            ones=(0,),
            fewest=8,
        ),
    ),
    # Air bearing, enable, 8 thrusters, 4 joints and a wheel (snt-spacer/UniLuFP).
    "pingu": (
        _PLATFORM_INPUTS,
        _Row("autonomous_control_input", FLOATS, 15, range(2, 10), (14,), (0, 1), 8),
    ),
}


class Interface:
    """Topics of one kind of robot.

    Args:
        name: kind of robot, one of `RobotName`.
        commands: how many commands the craft takes.
        thrusters: how many of them are of thrusters; the others are of wheels.

    Raises:
        ConfigError: there is no such kind, or its messages have no room for the craft's commands.
    """

    def __init__(self, name: str, commands: int, thrusters: int) -> None:
        if not isinstance(name, str) or name not in _ROBOTS:
            raise ConfigError(
                f"robot must be one of {', '.join(get_args(RobotName))}, got {brief(name)}."
            )
        self.inputs, self._row = _ROBOTS[name]
        row = self._row
        wheels = commands - thrusters
        if row.size and (
            not row.fewest <= thrusters <= len(row.thrusters) or wheels > len(row.wheels)
        ):
            raise ConfigError(
                f"the message of --robot {name} has {len(row.thrusters)} thrusters and "
                f"{'a' if row.wheels else 'no'} wheel, but the spacecraft takes {commands} commands, {wheels} of "
                "them of wheels."
            )
        self._size = row.size or commands
        self._places = list(range(commands))
        if row.size:
            self._places = [*row.thrusters[:thrusters], *row.wheels[:wheels]]
        self._low = np.where(np.arange(commands) < thrusters, 0.0, -1.0)
        self._is_px4 = row.kind == PX4_MOTORS
        self.outputs = {row.topic: row.kind}
        """Topics and types that the robot takes."""
        if self._is_px4:
            self.outputs = {_PX4_MODE_TOPIC: PX4_MODE} | self.outputs
        self.has_velocity = "pose" not in self.inputs or "twist" in self.inputs
        """Whether the robot says how fast it is; otherwise velocities are filtered from its poses."""

    def read(self, topic: str, data: bytes) -> Reading:
        """Motion in a message of one of the inputs (`read_motion`)."""
        return read_motion(self.inputs[topic], data)

    def state(self, motion: Motion, now: int) -> list[Message]:
        """Messages that the robot publishes of its motion at a time, ns: what a twin sends."""
        sent = []
        # A pose comes last, so that it completes a state.
        for topic, kind in reversed(self.inputs.items()):
            head: dict[str, Any] = {"header.stamp": now, "header.frame_id": "world"}
            published = motion
            if kind == PX4_ODOMETRY:
                published = swapped(motion)
                head = _microseconds(now) | {"pose_frame": 1, "velocity_frame": 1, "quality": 100}
            elif kind == ODOMETRY:
                # As ROS has it, the twist is in the body's frame.
                velocity = rotation(motion.attitude).inv().apply(motion.velocity)
                published = motion._replace(velocity=velocity)
                head["child_frame_id"] = "body"
            for name, path in _MOTION_FIELDS[kind].items():
                head[path] = getattr(published, name)
            sent.append(Message(topic, kind, pack(kind, head)))
        return sent

    def command(self, values: Sequence[float], now: int) -> list[Message]:
        """Messages that give a command at a time, ns.

        PX4's mode comes with every command, since PX4 leaves offboard mode where its stream stops.
        """
        row = np.zeros(self._size)
        row[list(self._row.ones)] = 1.0
        row[self._places] = values
        if self._row.kind == INTEGERS:
            row = np.rint(row)
        fields: dict[str, Any] = {self._row.field: row}
        sent = []
        if self._is_px4:
            row[row == 0.0] = np.nan
            fields |= _microseconds(now)
            mode = pack(PX4_MODE, {"timestamp": now // 1000, "direct_actuator": True})
            sent = [Message(_PX4_MODE_TOPIC, PX4_MODE, mode)]
        data = pack(self._row.kind, fields)
        return [*sent, Message(self._row.topic, self._row.kind, data)]

    def commanded(self, topic: str, data: bytes) -> np.ndarray | None:
        """Command in a message of one of the outputs; None: it has none. `ValueError` if it is no command.

        Thrusters are from 0 to 1, wheels from -1 to 1.
        """
        if topic == _PX4_MODE_TOPIC:
            return None
        message = unpack(self._row.kind, data)
        values = command_row(numbers(message, self._row.field), self._size)[self._places]
        if self._is_px4:
            values[np.isnan(values)] = 0.0
        return command(values, self._low, np.ones(len(self._low)))


def read_motion(kind: str, data: bytes) -> Reading:
    """Motion in a message of a type, in RANS's frames; `ValueError` if it is none."""
    message = unpack(kind, data)
    found = {}
    for name, path in _MOTION_FIELDS[kind].items():
        values = numbers(message, path)
        is_turn = name == "attitude"
        found[name] = unit(values) if is_turn else finite_vector(_NAMES[name], values)
    if kind == PX4_ODOMETRY:
        require_ned(message.pose_frame, message.velocity_frame)
        return Reading(int(message.timestamp_sample) * 1000, *swapped(Motion(**found)))
    head = message.header
    if kind == ODOMETRY:
        turn = rotation(found["attitude"])
        if frame_of_twist(head.frame_id, message.child_frame_id) == "body":
            found["velocity"] = turn.apply(found["velocity"])
        else:
            found["spin"] = turn.inv().apply(found["spin"])
    measured = head.stamp.sec * 10**9 + head.stamp.nanosec
    return Reading(measured, **found, frame=head.frame_id)


def _microseconds(now: int) -> dict[str, int]:
    """Time stamps of PX4's messages at a time, ns."""
    return dict.fromkeys(("timestamp", "timestamp_sample"), now // 1000)
