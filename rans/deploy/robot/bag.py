"""Flights as MCAP bags, which Foxglove and ``ros2 bag`` open; what a killed process wrote can be read too."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from rans.deploy.robot.messages import definition
from rans.errors import ConfigError
from rans.files import replace_file


class Entry(NamedTuple):
    """One message of a bag."""

    time: int
    """ns; the messages of one decision share it."""
    topic: str
    kind: str
    data: bytes


class BagWriter:
    """Writes messages as they come, without chunks, so that a bag ends where its process ended.

    Raises:
        ConfigError: the package mcap is missing, the file exists already, or the disk refuses.
    """

    def __init__(self, file: Path) -> None:
        try:
            from mcap.writer import Writer
        except ImportError as error:
            raise ConfigError("bags need the package mcap: pip install 'rans[robot]'.") from error
        if file.exists():
            raise ConfigError(f"{file} exists already: a bag is never written over.")
        file.parent.mkdir(parents=True, exist_ok=True)
        self._stream = file.open("wb")
        self._writer = Writer(self._stream, use_chunking=False)
        self._writer.start(profile="ros2", library="rans")
        self._channels: dict[str, int] = {}
        self._count = 0

    def declare(self, topic: str, kind: str) -> None:
        """Announce a topic: the first message of one that is not takes milliseconds."""
        if topic not in self._channels:
            text = definition(kind).encode()
            schema = self._writer.register_schema(kind, "ros2msg", text)
            self._channels[topic] = self._writer.register_channel("/" + topic, "cdr", schema)

    def write(self, entry: Entry) -> None:
        """Add a message."""
        self.declare(entry.topic, entry.kind)
        self._count += 1
        self._writer.add_message(
            channel_id=self._channels[entry.topic],
            log_time=entry.time,
            publish_time=entry.time,
            sequence=self._count,
            data=entry.data,
        )

    def flush(self) -> None:
        """Hand everything to the operating system."""
        self._stream.flush()

    def close(self) -> None:
        """Finish the bag."""
        self._writer.finish()
        self._stream.close()


def index_bag(file: Path) -> None:
    """Rewrite a finished bag in chunks with an index, by which tools seek in it; its messages stay as they are.

    A bag that is being recorded has no chunks, so that no message waits in memory. The file is replaced as a
    whole: where that fails it stays as it was.

    Raises:
        ConfigError: the file is no finished bag, or the disk refuses.
    """
    from mcap.exceptions import McapError
    from mcap.records import Channel, DataEnd, Message, Schema
    from mcap.stream_reader import StreamReader
    from mcap.writer import CompressionType, Writer

    def indexed(draft: Path) -> None:
        with file.open("rb") as recorded, draft.open("wb") as stream:
            writer = Writer(stream, compression=CompressionType.NONE)  # every reader can read it
            writer.start(profile="ros2", library="rans")
            for record in StreamReader(recorded).records:
                match record:
                    case Schema():
                        writer.register_schema(record.name, record.encoding, record.data)
                    case Channel():
                        writer.register_channel(
                            record.topic, record.message_encoding, record.schema_id
                        )
                    case Message():
                        writer.add_message(
                            record.channel_id,
                            record.log_time,
                            record.data,
                            record.publish_time,
                            record.sequence,
                        )
                    case DataEnd():  # the summary follows, which is written anew
                        break
                    case _:
                        pass
            writer.finish()

    try:
        replace_file(file, indexed)
    except (McapError, struct.error) as error:
        raise ConfigError(f"{file} is no finished MCAP bag: {error}.") from error


def entries(file: Path) -> Iterator[Entry]:
    """Messages of a bag in the order in which they were written.

    Raises:
        ConfigError: the package mcap is missing, or the file is no bag.
    """
    try:
        from mcap.exceptions import McapError
        from mcap.records import Channel, Message, Schema
        from mcap.stream_reader import StreamReader
    except ImportError as error:
        raise ConfigError("bags need the package mcap: pip install 'rans[robot]'.") from error
    schemas: dict[int, Any] = {}
    channels: dict[int, Any] = {}
    try:
        with file.open("rb") as stream:
            for record in StreamReader(stream).records:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message):
                    channel = channels[record.channel_id]
                    kind = schemas[channel.schema_id].name
                    topic = channel.topic.removeprefix("/")
                    yield Entry(record.log_time, topic, kind, record.data)
    except OSError as error:
        raise ConfigError(f"{file} cannot be read: {error}.") from error
    except (McapError, struct.error) as error:
        if channels:  # its process was ended while it wrote, perhaps in the middle of a number
            return
        raise ConfigError(f"{file} is no MCAP bag: {error}.") from error
