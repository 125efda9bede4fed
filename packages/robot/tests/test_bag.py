"""What other people's software reads of what we write: bags and their messages, and ROS 2 over Zenoh."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from rans_robot.bag import BagMessage, bag_entries
from rans_robot.bus import ZenohBus
from rans_robot.interfaces import Interface, RobotName
from rans_robot.messages import POSE, TEXT, text_message

from rans import ConfigError
from tests.support.processes import free_port, wait_until
from tests.support.robots import AWAY, bag_of

ROBOTS: tuple[RobotName, ...] = ("ros", "odometry", "px4", "roboran", "pingu")
MOTION = AWAY._replace(spin=np.array([0.0, 0.0, 0.25]))


def written(folder: Path) -> tuple[Path, list[BagMessage]]:
    """A bag with every message that a robot or the node sends, and an empty text."""
    rows = [BagMessage(10**9, "rans/end", TEXT, text_message(""))]
    for at, robot in enumerate(ROBOTS):
        ends = Interface(robot, 8, 8)
        moment = 2 * 10**9 + at
        both = [*ends.state(MOTION, moment), *ends.command([1.0] + [0.0] * 7, moment)]
        rows += [BagMessage(moment, f"{robot}/{one.topic}", one.kind, one.data) for one in both]
    return bag_of(folder, rows), rows


def checked(kind: str, message: Any) -> None:
    """A message that somebody else decoded holds the robot's position, 2 m and 1 m away."""
    if kind == "geometry_msgs/msg/PoseStamped":
        assert (message.pose.position.x, message.pose.position.y) == (2.0, 1.0)
        assert message.header.stamp.sec == 2
    elif kind == "nav_msgs/msg/Odometry":
        assert (message.pose.pose.position.x, message.pose.pose.position.y) == (2.0, 1.0)
    elif kind == "px4_msgs/msg/VehicleOdometry":  # PX4's world is north, east, down
        np.testing.assert_allclose(message.position, (1.0, 2.0, 0.0))


def test_the_official_decoder_reads_every_message(tmp_path):
    """By the definitions that the bag holds, as ROS 2 writes them."""
    ros2 = pytest.importorskip("mcap_ros2.decoder")
    from mcap.reader import make_reader

    file, rows = written(tmp_path)
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[ros2.DecoderFactory()])
        kinds = []
        for schema, _, _, message in reader.iter_decoded_messages():
            assert schema is not None
            kinds.append(schema.name)
            checked(schema.name, message)
    assert sorted(kinds) == sorted(row.kind for row in rows)


def test_a_bag_is_sought_in_and_has_the_same_messages(tmp_path):
    from mcap.reader import SeekingReader

    file, rows = written(tmp_path)
    assert list(bag_entries(file)) == rows
    with file.open("rb") as stream:
        reader = SeekingReader(stream)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == len(rows)
        assert sum(len(one.message_index_offsets) for one in summary.chunk_indexes) == len(
            {row.topic for row in rows}
        )
        poses = [m.data for _, _, m in reader.iter_messages(topics=["/pingu/pose"])]
    assert poses == [row.data for row in rows if row.topic == "pingu/pose"] != []


SPOKEN = text_message("hello")


def session(mode: str, end: str, port: int) -> Any:
    """A session of Zenoh itself, as rmw_zenoh configures them: without a search of the network."""
    zenoh = pytest.importorskip("zenoh")
    config = zenoh.Config()
    config.insert_json5("mode", f'"{mode}"')
    config.insert_json5("scouting/multicast/enabled", "false")
    if mode == "peer":
        config.insert_json5("listen/endpoints", '["tcp/localhost:0"]')
    config.insert_json5(f"{end}/endpoints", f'["tcp/127.0.0.1:{port}"]')
    return zenoh.open(config)


@pytest.fixture
def port() -> int:
    """A port of this machine where nothing listens."""
    return free_port()


@pytest.fixture
def router(port) -> Iterator[int]:
    """Port of a router, as ROS 2's ``rmw_zenohd`` is one."""
    opened = session("router", "listen", port)
    yield port
    opened.close()


@pytest.mark.parametrize("ros", ["humble", "jazzy", "kilted"])
def test_somebody_else_reads_attachments(router, ros):
    """By zenoh-ros2-sdk, as a node of ROS 2 hears them: a peer that is connected to the router."""
    attachment = pytest.importorskip("zenoh_ros2_sdk.attachment")
    node = session("peer", "connect", router)
    heard = []
    node.declare_subscriber("3/rans/note/**", heard.append)
    bus = ZenohBus(3, f"tcp/127.0.0.1:{router}", ros)
    before = time.time_ns()
    try:
        wait_until(lambda: bus.publish("rans/note", TEXT, SPOKEN) or bool(heard))
        bus.publish("rans/note", TEXT, SPOKEN)
        wait_until(lambda: len(heard) > 1)
        samples = list(heard)  # more may come
        first, *_, last = [attachment.Attachment.from_bytes(bytes(x.attachment)) for x in samples]
        keys = {str(x.key_expr) for x in samples}
    finally:
        bus.close()
        node.close()
    assert bytes(heard[0].payload) == SPOKEN
    assert last.sequence_id == first.sequence_id + len(samples) - 1
    assert before <= first.timestamp_ns <= last.timestamp_ns <= time.time_ns()
    assert len(first.gid) == 16
    assert first.gid == last.gid
    # Humble's messages have no hash of their type; that of std_msgs/msg/String is known from Iron on.
    hashed = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    kind = "TypeHashNotSupported" if ros == "humble" else hashed
    assert keys == {f"3/rans/note/std_msgs::msg::dds_::String_/{kind}"}


def test_somebody_else_lists_topics(router):
    """By zenoh-ros2-sdk's ``zenoh-ros2 topic list``."""
    discovery = pytest.importorskip("zenoh_ros2_sdk.discovery")
    shared = pytest.importorskip("zenoh_ros2_sdk.session").ZenohSession
    bus = ZenohBus(5, f"tcp/127.0.0.1:{router}")
    try:
        bus.subscribe("pose", POSE, lambda _: None)
        bus.publish("rans/note", TEXT, SPOKEN)
        listed = []

        def all_are_listed():
            listed[:] = discovery.get_topic_names_and_types(5, "127.0.0.1", router)
            return len(listed) == 2

        wait_until(all_are_listed)
        about = discovery.get_topic_info("/pose", 5, "127.0.0.1", router)
    finally:
        bus.close()
        if shared._instance is not None:
            shared._instance.session.close()
            shared._instance = None
    assert listed == [("/pose", [POSE]), ("/rans/note", [TEXT])]
    assert (about.publisher_count, about.subscriber_count) == (0, 1)


def test_where_nothing_answers_is_said(port):
    pytest.importorskip("zenoh")
    with pytest.raises(ConfigError, match=rf"127\.0\.0\.1:{port}: Unable to connect.*rmw_zenohd"):
        ZenohBus(0, f"tcp/127.0.0.1:{port}")


def test_a_pipe_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ConfigError, match="it is not a file"):
        list(bag_entries(tmp_path / "pipe"))


def test_a_replay_asks_for_trust_once_there_is_something_to_trust(tmp_path, monkeypatch, refused):
    monkeypatch.setenv("RANS_TRUST", "")
    said = refused(f"replay {tmp_path}/none.mcap")
    assert "No such file" in said
    assert "--trust" not in said
