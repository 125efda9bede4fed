"""ROS 2 message types and their CDR, by `rosbags`; types of PX4 are registered from their definitions."""

from __future__ import annotations

from functools import cache
from typing import Any

from rans.extend import require
from rans.files import parse_json

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


def pack(kind: str, message: Any) -> bytes:
    """CDR of a message, little-endian."""
    return bytes(types().serialize_cdr(message, kind))


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


def stamp(nanoseconds: int) -> Any:
    """Time of a header, from a clock in ns."""
    time_type = types().types["builtin_interfaces/msg/Time"]
    return time_type(nanoseconds // 10**9 % 2**31, nanoseconds % 10**9)


def message_header(nanoseconds: int, frame: str) -> Any:
    """Header of a message that was measured then."""
    return types().types["std_msgs/msg/Header"](stamp(nanoseconds), frame)


def measured_at(message: Any) -> int:
    """When a message with a header was measured, by its sender's clock, ns."""
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def make(kind: str, **fields: Any) -> Any:
    """A message of its fields."""
    return types().types[kind](**fields)


def vector(values: Any) -> Any:
    """geometry_msgs/msg/Vector3 of three numbers."""
    x, y, z = (float(v) for v in values)
    return make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def pose(position: Any, quaternion: Any) -> Any:
    """geometry_msgs/msg/Pose of a position (3,), m, and a quaternion (w, x, y, z); ROS has w last."""
    x, y, z = (float(v) for v in position)
    w, i, j, k = (float(v) for v in quaternion)
    return make(
        "geometry_msgs/msg/Pose",
        position=make("geometry_msgs/msg/Point", x=x, y=y, z=z),
        orientation=make("geometry_msgs/msg/Quaternion", x=i, y=j, z=k, w=w),
    )


def array(kind: str, values: Any, dtype: Any) -> Any:
    """One of std_msgs' multi-arrays, without dimensions."""
    import numpy as np

    layout = make("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
    return make(kind, layout=layout, data=np.asarray(values, dtype))


def read_json_message(data: bytes, what: str) -> Any:
    """Value of the JSON in a std_msgs/msg/String.

    Raises:
        ValueError: it is no message.
        ConfigError: its text is no JSON; ``what`` names the message.
    """
    return parse_json(unpack(TEXT, data).data, what)


def text_message(text: str) -> bytes:
    """CDR of a std_msgs/msg/String."""
    return pack(TEXT, make(TEXT, data=text))
