"""PX4's ULog as logs of flights: bytes made by hand after PX4's documentation, pyulog's own writer, and damage."""

from __future__ import annotations

import io
import random
import struct
from pathlib import Path

import numpy as np
import pytest
from rans_robot.ulog import read_ulog

import rans
from rans.errors import ConfigError
from rans.model.spacecraft_file import load_spacecraft
from tests.support.damage import damaged

pyulog = pytest.importorskip("pyulog")
PLATFORM = load_spacecraft("floating-platform")
FLYER = load_spacecraft("free-flyer")

ODOMETRY = (
    "uint64_t timestamp;uint64_t timestamp_sample;float[3] position;float[4] q;float[3] velocity;"
    "float[3] angular_velocity;uint8_t pose_frame;uint8_t velocity_frame;uint8_t reset_counter;"
    "uint8_t[5] _padding0;"
)
MOTORS = (
    "uint64_t timestamp;uint64_t timestamp_sample;float[12] control;uint16_t reversible_flags;"
    "uint8_t[6] _padding0;"
)
PLACE = (
    "uint64_t timestamp;uint64_t timestamp_sample;float x;float y;float z;float vx;float vy;float vz;bool xy_valid;"
    "bool z_valid;bool v_xy_valid;bool v_z_valid;uint8_t xy_reset_counter;uint8_t[3] _padding0;"
)
ATTITUDE = "uint64_t timestamp;uint64_t timestamp_sample;float[4] q;"
RATES = "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;"


def message(kind: str, content: bytes) -> bytes:
    """docs.px4.io, ULog: the size of the content, its kind, and the content."""
    return struct.pack("<HB", len(content), ord(kind)) + content


def ulog(formats: dict[str, str], data: list[tuple[str, bytes]], extra: bytes = b"") -> bytes:
    """Header, flags, formats, subscriptions, and data without the padding at the end."""
    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000), message("B", bytes(40))]
    names = list(formats)
    parts += [message("F", f"{name}:{text}".encode()) for name, text in formats.items()]
    parts += [
        message("A", struct.pack("<BH", 0, names.index(name)) + name.encode()) for name in names
    ]
    parts += [message("D", struct.pack("<H", names.index(name)) + row) for name, row in data]
    return b"".join(parts) + extra


TIMES = 2_000_000 + 100_000 * np.arange(30)


def motors(k: int) -> bytes:
    """Motor k mod 8 is on, all others NaN."""
    control = [1.0 if j == k % 8 else float("nan") for j in range(12)]
    return struct.pack("<QQ12fH", TIMES[k] + 30_000, TIMES[k] + 30_000, *control, 0)


def yaw(k: int) -> float:
    """Heading from north to east, as PX4 counts."""
    return 0.5 * np.pi - 0.1 * k


def odometry(k: int, counter: int = 0, velocity_frame: int = 1) -> bytes:
    """At 0.1 k m east and -0.2 k m north, with heading 0.1 k from east to north; 0.5 m/s east, 0.25 north."""
    half = 0.5 * yaw(k)
    velocity = (0.25, 0.5, 0.0)
    if velocity_frame == 3:  # forward, right, down
        c, s = np.cos(yaw(k)), np.sin(yaw(k))
        velocity = (c * 0.25 + s * 0.5, -s * 0.25 + c * 0.5, 0.0)
    return struct.pack(
        "<QQ3f4f3f3fBBB",
        TIMES[k] + 5000,
        TIMES[k],
        *(-0.2 * k, 0.1 * k, -1.5),
        *(np.cos(half), 0.0, 0.0, np.sin(half)),
        *velocity,
        *(0.0, 0.0, -0.125),
        *(1, velocity_frame, counter),
    )


def flight(velocity_frame: int = 1) -> bytes:
    rows = [
        row
        for k in range(30)
        for row in (
            ("vehicle_odometry", odometry(k, velocity_frame=velocity_frame)),
            ("actuator_motors", motors(k)),
        )
    ]
    return ulog({"vehicle_odometry": ODOMETRY, "actuator_motors": MOTORS}, rows)


def written(content: bytes, folder: Path) -> Path:
    file = folder / "flight.ulg"
    file.write_bytes(content)
    return file


def appended(main: bytes, extra: bytes, offset: int | None = None) -> bytes:
    """A log to which PX4 appended messages after a crash: the flags have the first offset of them."""
    at = len(main) if offset is None else offset
    flags = bytes(8) + b"\x01" + bytes(7) + struct.pack("<QQQ", at, 0, 0)
    head = main[:16] + message("B", flags)
    return head + main[len(head) :] + extra


def test_a_log_with_a_crash_dump_is_read_to_where_it_begins(tmp_path: Path) -> None:
    """The log ends within a message, as when the power went. The library reads the same rows."""
    dump = message("I", bytes([23]) + b"char[4] hardfault_plain" + b"DUMP")
    whole = flight()
    content = appended(whole[:-17], dump)
    log = read_ulog(written(content, tmp_path), PLATFORM)
    foreign = pyulog.ULog(io.BytesIO(content))
    assert not foreign.file_corruption
    lengths = {data.name: len(data.data["timestamp"]) for data in foreign.data_list}
    assert len(log.times) == lengths["vehicle_odometry"] == 30
    assert len(log.commands) == lengths["actuator_motors"] == 29
    assert any(f"{len(dump)} bytes that were appended" in note for note in log.notes)
    # Without the flag what follows is damage; an offset within the header is none.
    with pytest.raises(ConfigError, match="damaged"):
        read_ulog(written(whole[:-17] + dump, tmp_path), PLATFORM)
    with pytest.raises(ConfigError, match="within its header"):
        read_ulog(written(appended(whole, dump, 20), tmp_path), PLATFORM)
    # An offset beyond the end is that of a dump that is missing.
    late = read_ulog(written(appended(whole, b"", len(whole) + 10), tmp_path), PLATFORM)
    assert len(late.times) == 30


@pytest.mark.parametrize("kind", ["D", "I", "A", "L"])
def test_messages_of_no_bytes_are_refused_at_once(kind: str, tmp_path: Path) -> None:
    """The library looks for a way on after each of them, for minutes."""
    with pytest.raises(ConfigError, match="has 0 bytes"):
        read_ulog(written(flight() + 1000 * message(kind, b""), tmp_path), PLATFORM)


def test_motors_without_a_time_are_left_out(tmp_path: Path) -> None:
    rows = [("actuator_motors", struct.pack("<QQ", 0, 0) + motors(0)[16:])] * 3
    rows += [
        row
        for k in range(30)
        for row in (("vehicle_odometry", odometry(k)), ("actuator_motors", motors(k)))
    ]
    content = ulog({"vehicle_odometry": ODOMETRY, "actuator_motors": MOTORS}, rows)
    log = read_ulog(written(content, tmp_path), PLATFORM)
    assert log.commands == pytest.approx(np.eye(8)[np.arange(30) % 8])
    assert any("3 commands" in note for note in log.notes)


@pytest.mark.parametrize("velocity_frame", [1, 3])
@pytest.mark.parametrize("again", [False, True])
def test_a_flight_comes_in_our_frames(again: bool, velocity_frame: int, tmp_path: Path) -> None:
    content = flight(velocity_frame)
    if again:  # read and written by the library
        stream = io.BytesIO()
        pyulog.ULog(io.BytesIO(content)).write_ulog(stream)
        content = stream.getvalue()
    log = read_ulog(written(content, tmp_path), PLATFORM)
    k = np.arange(30)
    assert log.times == pytest.approx(0.1 * k, abs=1e-9)
    assert log.command_times == pytest.approx(0.1 * k + 0.03, abs=1e-9)
    assert log.commands == pytest.approx(np.eye(8)[k % 8])
    assert log.position == pytest.approx(np.column_stack([0.1 * k, -0.2 * k]), abs=1e-6)
    assert np.mod(log.attitude - 0.1 * k + 1.0, 2 * np.pi) == pytest.approx(1.0, abs=1e-6)
    assert log.velocity == pytest.approx(np.tile([0.5, 0.25], (30, 1)), abs=1e-6)
    assert log.spin == pytest.approx(np.full(30, 0.125))


def test_estimates_are_read_where_no_odometry_is(tmp_path: Path) -> None:
    rows = []
    for k in range(30):
        time = int(TIMES[k])
        place = (-0.2 * k, 0.1 * k, -1.5, 0.25, 0.5, 0.0)
        rows.append(
            ("vehicle_local_position", struct.pack("<QQ6f4BB", time, time, *place, 1, 1, 1, 1, 0))
        )
        # Attitudes come between positions, and every other one is the negative quaternion.
        for part in (-40_000, 60_000):
            half = 0.5 * (0.5 * np.pi - 0.1 * (k + part / 1e5))
            sign = 1.0 if part < 0 else -1.0
            q = sign * np.array([np.cos(half), 0.0, 0.0, np.sin(half)])
            rows.append(("vehicle_attitude", struct.pack("<QQ4f", time + part, time + part, *q)))
        rows.append(
            ("vehicle_angular_velocity", struct.pack("<QQ3f", time - 10, time - 10, 0.0, 0.0, -1.0))
        )
        rows.append(("actuator_motors", motors(k)))
    formats = {"vehicle_local_position": PLACE, "vehicle_attitude": ATTITUDE}
    formats |= {"vehicle_angular_velocity": RATES, "actuator_motors": MOTORS}
    log = read_ulog(written(ulog(formats, rows), tmp_path), PLATFORM)
    k = np.arange(30)
    assert log.position == pytest.approx(np.column_stack([0.1 * k, -0.2 * k]), abs=1e-6)
    # Linear between attitudes 0.1 rad apart, which errs by less than 0.1^3 / 30.
    assert np.mod(log.attitude - 0.1 * k + 1.0, 2 * np.pi) == pytest.approx(1.0, abs=4e-5)
    assert log.velocity[3] == pytest.approx([0.5, 0.25])
    assert log.spin[:-1] == pytest.approx(np.ones(29))


def test_the_longest_stretch_without_a_reset_counts(tmp_path: Path) -> None:
    rows = [("vehicle_odometry", odometry(k, counter=int(k >= 8))) for k in range(30)]
    rows += [("actuator_motors", motors(k)) for k in range(30)]
    content = ulog({"vehicle_odometry": ODOMETRY, "actuator_motors": MOTORS}, rows)
    log = read_ulog(written(content, tmp_path), PLATFORM)
    assert len(log.times) == 22
    assert log.position[0] == pytest.approx([0.8, -1.6])


def test_a_log_that_ends_early_is_read_to_its_last_message(tmp_path: Path) -> None:
    log = read_ulog(written(flight()[:-400], tmp_path), PLATFORM)
    assert 20 < len(log.times) < 30


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "is no ULog, or damaged"),
        (b"PK\x03\x04" + bytes(100), "is no ULog, or damaged"),
        (flight()[:500], "lacks the topic actuator_motors"),
        (ulog({"actuator_motors": MOTORS}, [("actuator_motors", motors(0))]), "has no poses"),
        (
            ulog(
                {"vehicle_odometry": ODOMETRY, "actuator_motors": MOTORS},
                [("vehicle_odometry", odometry(k)) for k in (0, 2, 1)]
                + [("actuator_motors", motors(k)) for k in (0, 1)],
            ),
            "go back or stand still",
        ),
        (ulog({"x": "y[9] a;", "y": "x[9] b;"}, []), "is no ULog, or damaged.*deep"),
        (ulog({"x": "y[60000] a;", "y": "double[60000] b;"}, []), "would have 480,000 bytes"),
        (flight() + bytes(300), "is damaged"),
    ],
    ids=["empty", "zip", "cut", "no poses", "times", "ring", "huge", "zeros"],
)
def test_damage_is_refused_in_a_sentence(content: bytes, reason: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=reason):
        read_ulog(written(content, tmp_path), PLATFORM)


def test_a_craft_of_more_thrusters_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="has 12 motors, but 'free-flyer' takes 16 commands"):
        read_ulog(written(flight(), tmp_path), FLYER)


def test_commands_may_not_be_lost(tmp_path: Path) -> None:
    half = flight()
    cut = half.index(struct.pack("<QQ", TIMES[15] + 5000, TIMES[15])) - 5
    lost = half[:cut] + message("O", struct.pack("<H", 400)) + half[cut:]
    with pytest.raises(ConfigError, match=r"lost messages for 0\.4 s at 1\.4 s"):
        read_ulog(written(lost, tmp_path), PLATFORM)
    read_ulog(
        written(lost.replace(struct.pack("<H", 400), struct.pack("<H", 40)), tmp_path), PLATFORM
    )


@pytest.mark.parametrize("count", [20, pytest.param(1000, marks=pytest.mark.slow)])
def test_random_damage_is_read_as_it_is_or_refused(count: int, tmp_path: Path) -> None:
    whole = flight()
    refused = 0
    for number in range(count):
        file = written(damaged(whole, random.Random(f"ulog {number}")), tmp_path)
        try:
            read_ulog(file, PLATFORM)
        except ConfigError as error:
            refused += str(file) in str(error)
    assert refused > count / 10


def test_a_ulog_is_a_log_to_identify_from(tmp_path: Path) -> None:
    """In this one positions and velocities are not of one motion."""
    with pytest.raises(ConfigError, match=r"flight\.ulg: its position changes 2 times as much"):
        rans.identify(written(flight(), tmp_path), PLATFORM)
