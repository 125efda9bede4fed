"""ROS 2 message types and their CDR, by `rosbags`; types of PX4 are registered from their definitions."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache, reduce
from operator import attrgetter
from typing import Any

import numpy as np

from rans.base.files import parse_json
from rans.extend import ConfigError, brief, require

POSE = "geometry_msgs/msg/PoseStamped"
TWIST = "geometry_msgs/msg/TwistStamped"
ODOMETRY = "nav_msgs/msg/Odometry"
TEXT = "std_msgs/msg/String"
FLOATS = "std_msgs/msg/Float32MultiArray"
INTEGERS = "std_msgs/msg/Int16MultiArray"
PX4_ODOMETRY = "px4_msgs/msg/VehicleOdometry"
PX4_MODE = "px4_msgs/msg/OffboardControlMode"
PX4_MOTORS = "px4_msgs/msg/ActuatorMotors"

_PX4 = {
    PX4_MODE: """
uint64 timestamp
bool position
bool velocity
bool acceleration
bool attitude
bool body_rate
bool thrust_and_torque
bool direct_actuator
""",
    PX4_MOTORS: """
uint32 MESSAGE_VERSION = 0
uint64 timestamp
uint64 timestamp_sample
uint16 reversible_flags
uint8 ACTUATOR_FUNCTION_MOTOR1 = 101
uint8 NUM_CONTROLS = 12
float32[12] control
""",
    PX4_ODOMETRY: """
uint32 MESSAGE_VERSION = 0
uint64 timestamp
uint64 timestamp_sample
uint8 POSE_FRAME_UNKNOWN = 0
uint8 POSE_FRAME_NED = 1
uint8 POSE_FRAME_FRD = 2
uint8 pose_frame
float32[3] position
float32[4] q
uint8 VELOCITY_FRAME_UNKNOWN = 0
uint8 VELOCITY_FRAME_NED = 1
uint8 VELOCITY_FRAME_FRD = 2
uint8 VELOCITY_FRAME_BODY_FRD = 3
uint8 velocity_frame
float32[3] velocity
float32[3] angular_velocity
float32[3] position_variance
float32[3] orientation_variance
float32[3] velocity_variance
uint8 reset_counter
int8 quality
""",
}
"""Fields of px4_msgs 1.15 to 1.18 (PX4-Autopilot/msg/versioned), in their order, which is their form in CDR."""


@cache
def types() -> Any:
    """Type store with ROS 2's common interfaces and PX4's messages. Loaded once a process.

    Raises:
        MissingPackage: the package rosbags is not installed.
    """
    require("rosbags")
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    for kind, text in _PX4.items():
        store.register(get_types_from_msg(text, kind))
    return store


def pack(kind: str, values: Mapping[str, Any]) -> bytes:
    """CDR of a message, little-endian, with values by the paths of its fields, as in "pose.position".

    Other fields are 0 or empty. A geometry_msgs point, vector or quaternion (w first, though ROS has w last) takes
    a sequence of numbers; "header.stamp" takes ns.
    """
    message = _blank(kind)
    for path, value in values.items():
        *above, name = path.split(".")
        part = reduce(getattr, above, message)
        field = getattr(part, name)
        if name == "stamp":
            field.sec = value // 10**9 % 2**31
            field.nanosec = value % 10**9
        elif hasattr(field, "x"):
            for axis, number in zip(_axes(field), value, strict=True):
                setattr(field, axis, float(number))
        else:
            setattr(
                part, name, np.asarray(value, field.dtype) if hasattr(field, "dtype") else value
            )
    return bytes(types().serialize_cdr(message, kind))


def _blank(kind: str) -> Any:
    """A message whose numbers are 0 and whose texts and sequences are empty."""
    from rosbags.interfaces import Nodetype

    fields = {}
    for name, (node, content) in types().fielddefs[kind][1]:
        if node == Nodetype.NAME:
            fields[name] = _blank(content)
        elif node == Nodetype.BASE:
            fields[name] = "" if content[0] == "string" else 0
        else:
            (inner, of), length = content
            fields[name] = np.zeros(length, of[0]) if inner == Nodetype.BASE else []
    return types().types[kind](**fields)


def _axes(field: Any) -> str:
    return "wxyz" if hasattr(field, "w") else "xyz"


def numbers(message: Any, path: str) -> Any:
    """Numbers of an array, point, vector or quaternion (w first) in a message, by its path as in `pack`."""
    field = attrgetter(path)(message)
    return [getattr(field, axis) for axis in _axes(field)] if hasattr(field, "x") else field


def unpack(kind: str, data: bytes) -> Any:
    """Message of its CDR; `ValueError` where the bytes are no message of this type."""
    try:
        return types().deserialize_cdr(data, kind)
    except Exception as error:  # rosbags raises what its generated code does
        raise ValueError(f"{len(data)} bytes are no {kind}") from error


def definition(kind: str) -> str:
    """Text of a type and of all that it is made of, as ROS 2's bags hold it."""
    text, _ = types().generate_msgdef(kind, ros_version=2)
    return str(text)


def read_table(data: bytes) -> dict[str, Any]:
    """JSON object in a std_msgs/msg/String; `ValueError` if it is none."""
    text = unpack(TEXT, data).data
    try:
        table = parse_json(text, "the message")
    except ConfigError as error:
        raise ValueError(str(error).rstrip(".")) from error
    if not isinstance(table, dict):
        raise ValueError(f"the message must be a JSON object, {{...}}, got {brief(table)}")
    return table


def text_message(text: str) -> bytes:
    """CDR of a std_msgs/msg/String."""
    return pack(TEXT, {"data": text})
