"""Bags as logs of flights, of several kinds of robots, and as other programs record them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rans_robot.bag import BagMessage
from rans_robot.frames import Motion
from rans_robot.interfaces import Interface
from rans_robot.logs import read_bag
from rans_robot.messages import FLOATS, POSE, TEXT, TWIST, text_message
from rans_robot.node import FLIGHT_TOPIC

from rans import ConfigError
from rans.model.spacecraft_file import load_spacecraft
from tests.support.robots import bag_of

PLATFORM = load_spacecraft("floating-platform")


@pytest.mark.parametrize("robot", ["ros", "pose", "odometry", "px4", "roboran", "pingu"])
def test_what_a_robot_said_comes_back(robot, tmp_path):
    ends = Interface(robot, 8, 8)
    bag = []
    rows = []
    for k in range(8):
        command = (np.arange(8) == k).astype(float)
        now = (k + 1) * 200_000_000
        both = (*ends.state(flown(k), now), *ends.command(command.tolist(), now))
        bag += [BagMessage(now, *message) for message in both]
        rows.append((0.2 * k, 0.1 * k, -0.2 * k, 0.3 * k, command))
    log = read_bag(bag_of(tmp_path, bag), PLATFORM, robot)
    assert log.times == pytest.approx([row[0] for row in rows])
    assert log.position == pytest.approx(np.array([row[1:3] for row in rows]), abs=1e-6)
    assert log.attitude == pytest.approx([row[3] for row in rows], abs=1e-6)
    assert log.commands == pytest.approx(np.array([row[4] for row in rows]))
    if ends.has_velocity:
        assert log.velocity == pytest.approx(np.tile([0.5, 0.25], (8, 1)), abs=1e-6)
        assert log.spin == pytest.approx(np.full(8, 1.5), abs=1e-6)
    else:
        assert np.isnan(log.velocity).all()


def planned(data: bytes) -> BagMessage:
    """What a node writes first."""
    return BagMessage(0, FLIGHT_TOPIC, TEXT, data)


def test_a_flight_without_its_robot_is_no_bag_of_other_topics(tmp_path):
    """A bag of other topics is one of the planted (test_reader_answers.py)."""
    (command,) = Interface("ros", 8, 8).command([0.0] * 8, 0)
    bag = [planned(text_message('{"folder": "a", "task": {}}')), BagMessage(0, *command)]
    with pytest.raises(ConfigError, match=r"0 readings and 1 commands .* no state came"):
        read_bag(bag_of(tmp_path, bag), PLATFORM)


def flown(k: int) -> Motion:
    """At 0.1 k m, turned by 0.3 k rad."""
    half = 0.15 * k
    return Motion(
        np.array([0.1 * k, -0.2 * k, 0.0]),
        np.array([np.cos(half), 0.0, 0.0, np.sin(half)]),
        np.array([0.5, 0.25, 0.0]),
        np.array([0.0, 0.0, 1.5]),
    )


def recorded(
    file: Path,
    count: int = 30,
    stamp: Callable[[int], int] = lambda k: 10**9 + 200_000_000 * k,
    arrival: Callable[[int, str], int] = lambda k, _: 10**9 + 200_000_000 * k,
    prefix: str = "",
    numbers: range | None = None,
    labels: dict[str, tuple[str, str]] | None = None,
    **options: Any,
) -> Path:
    """A bag of poses, twists and commands by the library's writer, in chunks with checksums, as rosbag2 writes.

    Labels are encodings and types of topics in place of the right ones. Beside them is a topic without a schema.
    """
    from mcap.writer import Writer
    from rans_robot.messages import definition

    ends = Interface("ros", 8, 8)
    with file.open("wb") as stream:
        writer = Writer(stream, **options)
        writer.start(profile="ros2", library="test")
        channels: dict[str, int] = {}
        writer.add_message(writer.register_channel("/diagnostics", "json", 0), 10**9, b"{}", 10**9)
        for k in numbers or range(count):
            command = (np.arange(8) == k % 8).astype(float).tolist()
            for message in (*ends.state(flown(k), stamp(k)), *ends.command(command, 0)):
                if message.topic not in channels:
                    right = "cdr", message.kind
                    encoding, kind = (labels or {}).get(message.topic, right)
                    schema = writer.register_schema(kind, "ros2msg", definition(kind).encode())
                    topic = f"/{prefix}{message.topic}"
                    channels[message.topic] = writer.register_channel(topic, encoding, schema)
                at = arrival(k, message.topic)
                writer.add_message(channels[message.topic], at, message.data, at)
        writer.finish()
    return file


def test_readings_are_dated_by_their_stamps_and_commands_by_the_bag(tmp_path):
    """Over a link: up to 40 ms late, by a clock that is an hour off, and the soonest message is not the first."""
    random = np.random.default_rng(0)
    late = {
        topic: np.append(random.integers(1_000_000, 40_000_000, 29), 0)
        for topic in ("pose", "twist", "commands")
    }
    hour = 3600 * 10**9
    file = recorded(
        tmp_path / "flight.mcap",
        stamp=lambda k: 10**9 + 200_000_000 * k + hour,
        arrival=lambda k, topic: 10**9 + 200_000_000 * k + int(late[topic][k]),
    )
    log = read_bag(file, PLATFORM)
    # A pose and its twist stay one reading, though they came apart.
    assert len(log.times) == 30
    assert np.diff(log.times) == pytest.approx(0.2, abs=1e-9)
    assert np.isfinite(log.velocity).all()
    # The first command is the beginning: it came late, and readings and commands still are of one clock.
    assert log.command_times - log.times == pytest.approx(1e-9 * late["commands"], abs=1e-9)
    assert any(
        "pose is dated by its time stamps" in note and " ms later" in note for note in log.notes
    )


def test_clocks_that_drift_apart_are_followed(tmp_path):
    """Five minutes at 1e-4: 30 ms, of which 30 s make 3; by one difference for all the ends would be 30 ms off."""
    file = recorded(
        tmp_path / "flight.mcap",
        count=1500,
        arrival=lambda k, _: 10**9 + 200_020_000 * k,
    )
    log = read_bag(file, PLATFORM)
    assert np.abs(log.times - log.command_times).max() < 7e-3


def test_a_simulator_slower_than_real_time_is_refused(tmp_path):
    file = recorded(tmp_path / "flight.mcap", arrival=lambda k, _: 10**9 + 400_000_000 * k)
    with pytest.raises(ConfigError, match=r"5\.8 s by its time stamps and 11\.6 s .*use-sim-time"):
        read_bag(file, PLATFORM)


def test_without_stamps_the_times_are_those_of_the_bag_and_that_is_said(tmp_path):
    log = read_bag(recorded(tmp_path / "flight.mcap", stamp=lambda _: 0), PLATFORM)
    assert log.times == pytest.approx(0.2 * np.arange(30))
    assert any("pose lacks time stamps" in note for note in log.notes)


@pytest.mark.parametrize(
    ("topic", "label"),
    [
        ("commands", ("cdr", "std_msgs/msg/Int32MultiArray")),
        ("commands", ("json", FLOATS)),
        ("pose", ("ros1", POSE)),
        ("pose", ("cdr", TWIST)),
    ],
)
def test_messages_of_another_type_than_their_topic_s_are_named(topic, label, tmp_path):
    """Whole numbers were read as floats of 1e-45, and a heading in degrees was blamed."""
    file = recorded(tmp_path / "flight.mcap", labels={topic: label})
    named = label[1] if label[0] == "cdr" else f"{label[0]} {label[1]}"
    if topic == "commands":
        with pytest.raises(ConfigError, match=f"0 commands.*{named}"):
            read_bag(file, PLATFORM)
    else:
        notes = read_bag(file, PLATFORM).notes
        assert any("30 messages left out" in note and named in note for note in notes)


def test_a_bag_has_a_largest_number_of_commands_and_of_records(tmp_path, monkeypatch):
    """Each takes memory or time, and packed ones next to no space in a file."""
    from mcap.records import Chunk

    ends = Interface("pose", 8, 8)
    bag = [BagMessage(1, *message) for message in ends.state(flown(0), 1)]
    bag += [BagMessage(k, *ends.command([0.0] * 8, k)[0]) for k in range(1, 40)]
    file = bag_of(tmp_path, bag)
    monkeypatch.setattr("rans_robot.logs.MOST_READINGS", 30)
    with pytest.raises(ConfigError, match="more than 30 messages of commands"):
        read_bag(file, PLATFORM, "pose")
    # Empty records of no known kind, which the library skips by itself.
    monkeypatch.setattr("rans_robot.bag._MOST_RECORDS", 1000)
    empty = Chunk("", bytes(9 * 2000), 0, 0, 0, 9 * 2000)
    monkeypatch.setattr("mcap.stream_reader.StreamReader.records", [empty])
    with pytest.raises(ConfigError, match="more than 1,000 records"):
        read_bag(file, PLATFORM, "pose")


def test_topics_below_a_namespace_are_named_and_read(tmp_path):
    file = recorded(tmp_path / "flight.mcap", prefix="lab/robot1/")
    with pytest.raises(
        ConfigError, match=r"has diagnostics, lab/robot1/commands, .*--namespace lab"
    ):
        read_bag(file, PLATFORM)
    with pytest.raises(ConfigError, match="--namespace lab/robot1"):
        read_bag(file, PLATFORM, namespace="robot2")
    assert len(read_bag(file, PLATFORM, namespace="/lab/robot1").times) == 30


def test_the_folder_of_a_recorder_is_read_part_after_part(tmp_path):
    """In the order of their numbers, of which rosbag2 writes no leading zeros."""
    folder = tmp_path / "mybag"
    folder.mkdir()
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information:")
    for k in range(12):
        recorded(folder / f"mybag_{k}.mcap", numbers=range(3 * k, 3 * k + 3))
    log = read_bag(folder, PLATFORM)
    assert len(log.times) == 36
    assert (np.diff(log.times) > 0.0).all()


@pytest.mark.parametrize("compression", ["NONE", "LZ4", "ZSTD"])
def test_a_changed_number_in_a_bag_is_noticed(compression, tmp_path):
    """Chunks carry checksums. One bit of each of twenty bytes all over the bag, one after the other."""
    from mcap.writer import CompressionType

    whole = recorded(tmp_path / "whole.mcap", compression=CompressionType[compression]).read_bytes()
    log = read_bag(tmp_path / "whole.mcap", PLATFORM)
    file = tmp_path / "damaged.mcap"
    refused = 0
    for at in np.linspace(200, 0.9 * len(whole), 20).astype(int):
        content = bytearray(whole)
        content[at] ^= 1
        file.write_bytes(content)
        try:
            again = read_bag(file, PLATFORM)
        except ConfigError:
            refused += 1
            continue
        # What lies outside of chunks may change without an effect, such as an index.
        assert np.array_equal(again.commands, log.commands)
        assert np.array_equal(again.position, log.position)
        assert np.array_equal(again.times, log.times)
    # The chunk is half of the smallest of these bags; an index follows.
    assert refused >= 6


def test_poses_of_two_frames_are_not_one_path(tmp_path):
    """As in flight: the first frame counts, and messages of another one are left out with a note."""
    from rans_robot.messages import POSE, pack

    ends = Interface("pose", 8, 8)
    bag = []
    for k in range(30):
        now = (k + 1) * 200_000_000
        other = {
            "header.stamp": now + 10**6,
            "header.frame_id": "map",
            "pose.orientation": (1, 0, 0, 0),
        }
        both = (*ends.state(flown(k), now), *ends.command([0.0] * 8, now))
        bag += [BagMessage(now, *message) for message in both]
        bag.append(BagMessage(now + 10**6, "pose", POSE, pack(POSE, other)))
    log = read_bag(bag_of(tmp_path, bag), PLATFORM, "pose")
    assert log.position[:, 0] == pytest.approx(0.1 * np.arange(30))
    assert any("30 messages left out" in note and "'map'" in note for note in log.notes)
