"""What other people's software reads of what we write: bags and the messages in them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from rans.deploy.robot.bag import BagWriter, Entry, entries, index_bag
from rans.deploy.robot.interfaces import RobotName, interface
from rans.deploy.robot.messages import TEXT, make, pack
from rans.errors import ConfigError
from tests.support.robots import AWAY

ROBOTS: tuple[RobotName, ...] = ("ros", "odometry", "px4", "roboran", "pingu")
MOTION = AWAY._replace(spin=np.array([0.0, 0.0, 0.25]))


def written(folder: Path) -> tuple[Path, list[Entry]]:
    """A bag with every message that a robot or the node sends, and an empty text."""
    rows = [Entry(10**9, "rans/end", TEXT, pack(TEXT, make(TEXT, data="")))]
    for at, robot in enumerate(ROBOTS):
        ends = interface(robot, 8, 8)
        moment = 2 * 10**9 + at
        both = [*ends.state(MOTION, moment), *ends.command([1.0] + [0.0] * 7, moment)]
        rows += [Entry(moment, f"{robot}/{one.topic}", one.kind, one.data) for one in both]
    file = folder / "flight.mcap"
    bag = BagWriter(file)
    for row in rows:
        bag.write(row)
    bag.close()
    return file, rows


def checked(kind: str, message: Any) -> None:
    """A message that somebody else decoded holds the robot's position, 2 m and 1 m away."""
    if kind == "geometry_msgs/msg/PoseStamped":
        assert (message.pose.position.x, message.pose.position.y) == (2.0, 1.0)
        assert message.header.stamp.sec == 2
    elif kind == "nav_msgs/msg/Odometry":
        assert (message.pose.pose.position.x, message.pose.pose.position.y) == (2.0, 1.0)
    elif kind == "px4_msgs/msg/VehicleOdometry":  # PX4's world is north, east, down
        np.testing.assert_allclose(message.position, (1.0, 2.0, 0.0))


def test_the_official_decoder_reads_every_message(tmp_path: Path) -> None:
    """By the definitions that the bag holds, as ROS 2 writes them."""
    ros2 = pytest.importorskip("mcap_ros2.decoder")
    from mcap.reader import make_reader

    file, rows = written(tmp_path)
    index_bag(file)
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[ros2.DecoderFactory()])
        kinds = []
        for schema, _, _, message in reader.iter_decoded_messages():
            assert schema is not None
            kinds.append(schema.name)
            checked(schema.name, message)
    assert sorted(kinds) == sorted(row.kind for row in rows)


def test_rosbags_reads_every_message(tmp_path: Path) -> None:
    """Its bag reader too goes by the definitions in the bag."""
    from rosbags.highlevel import AnyReader

    file, rows = written(tmp_path)
    index_bag(file)
    with AnyReader([file]) as reader:
        kinds = []
        for connection, _, data in reader.messages():
            kinds.append(connection.msgtype)
            checked(connection.msgtype, reader.deserialize(data, connection.msgtype))
    assert sorted(kinds) == sorted(row.kind for row in rows)


def test_an_indexed_bag_is_sought_in_and_has_the_same_messages(tmp_path: Path) -> None:
    from mcap.reader import SeekingReader

    file, rows = written(tmp_path)
    index_bag(file)
    assert list(entries(file)) == rows
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


def test_a_bag_that_cannot_be_indexed_stays(tmp_path: Path) -> None:
    file = tmp_path / "flight.mcap"
    file.write_bytes(b"no bag")
    with pytest.raises(ConfigError, match="is no finished MCAP bag"):
        index_bag(file)
    assert file.read_bytes() == b"no bag"
    assert [one.name for one in tmp_path.iterdir()] == ["flight.mcap"]
