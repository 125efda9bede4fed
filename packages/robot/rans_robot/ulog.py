"""Logs of flights from PX4's ULog files, read by `pyulog`.

PX4's frames (north-east-down) become RANS's here and nowhere else; logs are strangers' files.
"""

from __future__ import annotations

import contextlib
import io
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rans.extend import ConfigError, Spacecraft, counted, first_line, read_bytes, require
from rans_robot.frames import swapped_attitude, swapped_body, swapped_world
from rans_robot.identify.log import FlightLog, unstamped, unstamped_note
from rans_robot.identify.motion import rotate
from rans_robot.logs import log_in_space

_ODOMETRIES = ("vehicle_mocap_odometry", "vehicle_visual_odometry", "vehicle_odometry")
"""Topics with poses, what was measured before what was estimated: a filter's errors are correlated."""
_ESTIMATES = ("vehicle_local_position", "vehicle_attitude", "vehicle_angular_velocity")
"""Topics of the estimator's position and velocity, attitude, and angular velocity."""
_MOTORS = "actuator_motors"
_LARGEST_ULOG = 2**30
"""Bytes: some hours of PX4's default topics."""
_LARGEST_MESSAGE = 2**16
"""Bytes of a ULog message, whose size is a number of two bytes."""
_MAGIC = b"ULog\x01\x12\x35"
_HEADER = 16
"""Bytes before the first message."""
_LEAST = dict(zip(b"BFIMPQARDLCSO", (40, 3, 3, 4, 3, 4, 4, 2, 3, 9, 11, 8, 2), strict=True))
"""Kinds of messages, and the least number of bytes that the fields of each take (docs.px4.io, ULog file format)."""
_FLAGS = 19
"""Byte at which the flags begin, which are the content of the first message: 8 of flags that a reader may ignore, 8
of others, the lowest bit of which says that data was appended, and three offsets of 8 bytes."""
_DEEPEST_FORMAT = 8
"""Levels of messages within messages; PX4's have two."""

Topics = Mapping[str, Mapping[str, np.ndarray]]
"""Fields of each topic of a ULog, each (M,)."""


def read_ulog(file: Path, craft: Spacecraft) -> FlightLog:
    """Log of a PX4 ULog file (.ulg): poses, and the commands of the topic ``actuator_motors``.

    Motor k is thruster k of the spacecraft file; NaN is off. Poses are those of a motion-capture system or a camera
    (``vehicle_mocap_odometry``, ``vehicle_visual_odometry``) if there are any, or else of the estimator
    (``vehicle_odometry``, or ``vehicle_local_position`` with ``vehicle_attitude``), in the frames of RANS: x east,
    y north, z up, and a body whose x is forward, y left, z up (`rans_robot.frames`). Where the
    estimator was reset, the longest stretch between two resets counts.

    Args:
        file: the log; it may end anywhere, as when the battery was unplugged.
        craft: spacecraft, in whose order commands are.

    Raises:
        MissingPackage: the package pyulog is not installed.
        ConfigError: the file is no ULog, is damaged, lost messages while commands were given, or lacks poses or
            commands.
    """
    topics, losses, appended = _ulog(file)
    motors = topics.get(_MOTORS)
    if motors is None:
        raise ConfigError(
            f"the log {file} lacks the topic {_MOTORS}; it has {_listed(topics)}. Set SDLOG_PROFILE to log it."
        )
    count = craft.command_count
    controls = [f"control[{k}]" for k in range(count)]
    recorded = sum(name in motors for name in controls)
    if recorded < count:
        raise ConfigError(
            f"the log {file} has {counted(recorded, 'motor')}, but {craft.name!r} takes {count} commands."
        )
    commands = np.nan_to_num(_stacked(motors, controls).T, nan=0.0)
    early = {"command": unstamped(1e-6 * motors["timestamp"])}
    commands = commands[early["command"] :]
    given = _ascending(file, _MOTORS, motors["timestamp"][early["command"] :])

    odometry = next((name for name in _ODOMETRIES if name in topics), None)
    try:
        if odometry is not None:
            times, readings, resets = _odometry(topics[odometry])
        elif all(name in topics for name in _ESTIMATES[:2]):
            odometry = _ESTIMATES[0]
            times, readings, resets = _estimates(topics)
        else:
            raise ConfigError(
                f"the log {file} has no poses: it needs one of {', '.join(_ODOMETRIES)}, or "
                f"{_ESTIMATES[0]} and {_ESTIMATES[1]}; it has {_listed(topics)}."
            )
    except KeyError as error:
        raise ConfigError(
            f"the log {file}: {odometry} has no field {error}; is it PX4's of version 1.13 or later?"
        ) from error

    # The longest stretch without a reset of the estimator.
    edges = np.flatnonzero(np.any(np.diff(resets, axis=0) != 0, axis=1)) + 1
    parts = np.split(np.arange(len(times)), edges)
    longest = max(parts, key=len)
    times = _ascending(file, odometry, times[longest])
    position, attitude, velocity, spin = (reading[longest] for reading in readings)

    # A command that was lost would be taken for the one before.
    period = float(np.median(np.diff(given))) if len(given) > 1 else 0.0
    for time, lasting in losses:
        if given[0] < time < given[-1] and lasting > 1.5 * period:
            raise ConfigError(
                f"the log {file} lost messages for {lasting:.2g} s at {time - given[0]:.1f} s, while commands were "
                "given: use a faster card or fewer topics, or cut the log there."
            )
    begin = min(given[0], times[0])
    readings = position, attitude, velocity, spin
    notes = [
        f"{file}: commands are those of {_MOTORS}, at their time; readings are those of {odometry} when they were "
        "sampled, turned from north, east, down to x east, y north, z up.",
        *unstamped_note(file, early),
    ]
    if edges.size:
        notes.append(
            f"{file}: the estimator was reset {counted(len(edges), 'time')}; {len(parts)} parts, of which the one "
            f"with most readings, {len(longest):,} of {len(resets):,}, was read."
        )
    further = [
        name
        for name in motors
        if name.startswith("control[") and name not in controls and np.any(motors[name] > 0.0)
    ]
    if further:
        notes.append(
            f"{file}: {craft.name} takes {count} commands; not read are {', '.join(sorted(further))}, which were "
            "given too."
        )
    if appended:
        notes.append(
            f"{file}: {appended:,} bytes that were appended to the log, as after a crash, were not read."
        )
    return log_in_space(
        file, craft, given - begin, commands, times - begin, readings, notes=tuple(notes)
    )


def _ulog(file: Path) -> tuple[Topics, list[tuple[float, float]], int]:
    """Topics that are needed, first instance of each, times and lengths of losses, s, and bytes appended."""
    pyulog = require("pyulog")
    names = [_MOTORS, *_ODOMETRIES, *_ESTIMATES]
    content = read_bytes(file, _LARGEST_ULOG, "the log ")
    if not content.startswith(_MAGIC) or len(content) < _HEADER:
        raise ConfigError(f"{file} is no ULog, or damaged: it does not begin with its mark.")
    main = _main_part(file, content)
    whole = _whole_messages(file, main)
    try:
        # It prints what it thinks of a damaged file.
        with contextlib.redirect_stdout(io.StringIO()):
            _check_formats(pyulog.ULog(io.BytesIO(whole), parse_header_only=True).message_formats)
            log = pyulog.ULog(io.BytesIO(whole), names)
    except Exception as error:  # a damaged log may raise anything
        raise ConfigError(f"{file} is no ULog, or damaged: {first_line(error)}.") from error
    if log.file_corruption:
        raise ConfigError(
            f"the log {file} is damaged: some of its messages are not those that it declares. Copy it from the "
            "card again."
        )
    found = {
        dataset.name: dataset.data for dataset in reversed(log.data_list) if dataset.name in names
    }
    losses = [(1e-6 * dropout.timestamp, 1e-3 * dropout.duration) for dropout in log.dropouts]
    return found, losses, len(content) - len(main)


def _main_part(file: Path, content: bytes) -> bytes:
    """A ULog without the data that PX4 appended, as after a crash, to a log that may end within a message.

    Raises:
        ConfigError: the flags say that data was appended where none can be.
    """
    size, kind = struct.unpack_from("<HB", content.ljust(_FLAGS, b"\0"), _HEADER)
    flags = bytearray(content[_FLAGS : _FLAGS + 40])
    if kind != ord("B") or size < 40 or len(flags) < 40 or not flags[8] & 1:
        return content
    offsets = [offset for offset in struct.unpack_from("<QQQ", flags, 16) if offset]
    begin = min(offsets, default=len(content))
    if begin < _FLAGS + size:
        raise ConfigError(
            f"the log {file} is damaged: by its flags data was appended at byte {begin:,}, which is within its "
            "header. Copy it from the card again."
        )
    flags[8] &= ~1 & 0xFF
    flags[16:40] = bytes(24)
    return content[:_FLAGS] + bytes(flags) + content[_FLAGS + 40 : begin]


def _whole_messages(file: Path, content: bytes) -> bytes:
    """A ULog up to the end of its last whole message.

    The library looks for a way on after what it does not know, which in some damaged files takes forever.

    Raises:
        ConfigError: the file has a message of no known kind, or of fewer bytes than its kind has.
    """
    at = _HEADER
    while at + 3 <= len(content):
        size, kind = struct.unpack_from("<HB", content, at)
        if kind not in _LEAST:
            raise ConfigError(
                f"the log {file} is damaged: its message at byte {at:,} is of no known kind. Copy it from the card "
                "again."
            )
        if size < _LEAST[kind]:
            raise ConfigError(
                f"the log {file} is damaged: its message at byte {at:,} has {size} bytes, and those of its kind, "
                f"{chr(kind)}, have {_LEAST[kind]} at least. Copy it from the card again."
            )
        if at + 3 + size > len(content):
            break
        at += 3 + size
    return content[:at]


def _check_formats(formats: Mapping[str, Any]) -> None:
    """Refuse (ValueError) messages larger than ULog allows, which definitions of a few bytes can ask for.

    It comes before pyulog reads data, since that reserves what a format asks for.
    """
    sizes = {"int8_t": 1, "uint8_t": 1, "int16_t": 2, "uint16_t": 2, "int32_t": 4, "uint32_t": 4}
    sizes |= {"int64_t": 8, "uint64_t": 8, "float": 4, "double": 8, "bool": 1, "char": 1}

    def size(kind: str, depth: int) -> int:
        """Bytes of a message by its format, nested ones included; `ValueError` if it is too deep or too large."""
        if kind in sizes:
            return sizes[kind]
        if depth > _DEEPEST_FORMAT:
            raise ValueError(f"its message {kind!r} lies too deep")
        total = sum(
            max(count, 1) * size(field_type, depth + 1)
            for field_type, count, _ in formats[kind].fields
        )
        if total > _LARGEST_MESSAGE:
            raise ValueError(f"its message {kind!r} would have {total:,} bytes")
        return total

    for kind in formats:
        sizes[kind] = size(kind, 0)


def _listed(topics: Topics) -> str:
    return ", ".join(sorted(topics)) or "none of those that are read"


def _ascending(file: Path, topic: str, times: np.ndarray) -> np.ndarray:
    """Times (M,) of a topic in s, from microseconds, checked to ascend (`ConfigError`)."""
    seconds = 1e-6 * times.astype(float)
    if len(seconds) and not (np.diff(seconds) > 0.0).all():
        at = int(np.argmin(np.diff(seconds)))
        raise ConfigError(
            f"the log {file}: the times of {topic} go back or stand still after {seconds[at]:.6f} s; is it damaged?"
        )
    return seconds


def _stacked(fields: Mapping[str, np.ndarray], names: list[str]) -> np.ndarray:
    """Fields as rows of float64; what is not finite, as in a damaged file, was not measured."""
    with np.errstate(invalid="ignore"):  # of signalling NaN
        rows = np.stack([fields[name].astype(float) for name in names])
    return np.where(np.isfinite(rows), rows, np.nan)


def _sampled(fields: Mapping[str, np.ndarray]) -> np.ndarray:
    """When the readings were taken, in microseconds; that of the message where it is not said."""
    sampled = fields.get("timestamp_sample", fields["timestamp"])
    return np.where(sampled > 0, sampled, fields["timestamp"])


Readings = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _odometry(fields: Mapping[str, np.ndarray]) -> tuple[np.ndarray, Readings, np.ndarray]:
    """Times in microseconds, readings in RANS's frames and counters of resets (M, R) of PX4's VehicleOdometry.

    Times are those of the sample, not of the message. What is in a frame that is not read is NaN.
    """
    position = _stacked(fields, [f"position[{k}]" for k in range(3)])
    attitude = _stacked(fields, [f"q[{k}]" for k in range(4)])
    velocity = _stacked(fields, [f"velocity[{k}]" for k in range(3)])
    spin = _stacked(fields, [f"angular_velocity[{k}]" for k in range(3)])
    # 1 is north, east, down, 2 a world of another heading; the velocity may be in the body, 3.
    pose_frame, velocity_frame = fields["pose_frame"], fields["velocity_frame"]
    in_world = rotate(attitude.T, velocity.T).T
    velocity = np.where(velocity_frame == 3, in_world, velocity)
    velocity[:, (velocity_frame != 3) & (velocity_frame != pose_frame)] = np.nan
    position[:, (pose_frame != 1) & (pose_frame != 2)] = np.nan
    readings = _ours(position, attitude, velocity, spin)
    resets = fields.get("reset_counter", np.zeros(len(pose_frame)))
    return _sampled(fields), readings, resets[:, None]


def _estimates(topics: Topics) -> tuple[np.ndarray, Readings, np.ndarray]:
    """Times in microseconds, readings in RANS's frames and counters of resets (M, R) of PX4's estimator.

    Attitudes are interpolated to the times of positions.
    """
    motion, attitude, rates = (topics.get(name) for name in _ESTIMATES)
    assert motion is not None
    assert attitude is not None
    # Attitudes and angular velocities at the times of positions.
    times = _sampled(motion)
    turned = _sampled(attitude)
    q = _stacked(attitude, [f"q[{k}]" for k in range(4)])
    # A quaternion and its negative are the same attitude; between neighbours the near one counts.
    flips = np.where(np.sum(q[:, 1:] * q[:, :-1], axis=0) < 0.0, -1.0, 1.0)
    q[:, 1:] *= np.cumprod(flips)
    q = _at(times, turned, q)
    q /= np.linalg.norm(q, axis=0)
    spin = np.full((3, len(times)), np.nan)
    if rates is not None:
        spin = _at(times, _sampled(rates), _stacked(rates, [f"xyz[{k}]" for k in range(3)]))
    # Positions and velocities, NaN where the estimator says that they are not valid.
    position = _stacked(motion, ["x", "y", "z"])
    velocity = _stacked(motion, ["vx", "vy", "vz"])
    for valid, rows, columns in (
        ("xy_valid", position, [0, 1]),
        ("z_valid", position, [2]),
        ("v_xy_valid", velocity, [0, 1]),
        ("v_z_valid", velocity, [2]),
    ):
        rows[np.ix_(columns, motion[valid] == 0)] = np.nan
    counters = [motion[name] for name in sorted(motion) if name.endswith("reset_counter")]
    resets = np.column_stack(counters) if counters else np.zeros((len(times), 1))
    return times, _ours(position, q, velocity, spin), resets


def _at(times: np.ndarray, sampled: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Rows (R, N) at other times (M,), linearly; NaN before the first and after the last."""
    return np.stack([np.interp(times, sampled, row, left=np.nan, right=np.nan) for row in rows])


def _ours(
    position: np.ndarray, attitude: np.ndarray, velocity: np.ndarray, spin: np.ndarray
) -> Readings:
    """Readings (R, M) in PX4's frames (north-east-down, quaternion w first) as (M, R) in RANS's."""
    attitude = swapped_attitude(attitude)
    with np.errstate(invalid="ignore"):  # zeros are no attitude, and become NaN
        attitude /= np.linalg.norm(attitude, axis=0)
    return (
        swapped_world(position).T,
        attitude.T,
        swapped_world(velocity).T,
        swapped_body(spin).T,
    )
