"""Flights as MCAP bags, which Foxglove and ``ros2 bag`` open; what a killed process wrote can be read too.

Times are nanoseconds since 1970; foreign readers are in the tests.
"""

from __future__ import annotations

import contextlib
import math
import queue
import struct
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from rans.base.files import open_regular, why_unwritten
from rans.extend import ConfigError, first_line, require
from rans_robot.messages import definition

LARGEST_BAG = 2**31
"""Bytes: some twelve hours of a flight with a hundred states a second."""
_MOST_WAITING = 2**26
"""Bytes that may wait for a slow disk."""
_OVERHEAD = 31
"""Bytes of a message in a bag beside its data: opcode, length, channel, number and two times."""
_CHUNK = 0.1
"""s of messages that a chunk has at least; those of the last chunk are lost if the process is killed."""
_PATIENCE = 5.0
"""s that the end of a flight waits for the disk, once the valves are shut."""


class BagMessage(NamedTuple):
    """One message of a bag."""

    time: int
    """ns; the messages of one decision share it."""
    topic: str
    kind: str
    data: bytes


class BagWriter:
    """Writes messages as they come.

    Args:
        file: new file.

    Raises:
        MissingPackage: the package mcap is not installed.
        ConfigError: the file exists already, or the disk refuses.
    """

    def __init__(self, file: Path) -> None:
        require("mcap")
        from mcap.writer import CompressionType, Writer

        if file.exists():
            raise ConfigError(f"{file} exists already: a bag is never written over.")
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            self._stream = file.open("xb")
            # Every reader can read what is not compressed.
            self._writer = Writer(self._stream, compression=CompressionType.NONE)
            self._writer.start(profile="ros2", library="rans")
        except OSError as error:
            raise ConfigError(f"cannot write {file}: {why_unwritten(error)}.") from error
        self._channels: dict[str, int] = {}
        self._count = 0

    def declare(self, topic: str, kind: str) -> None:
        """Announce a topic: the first message of one that is not takes milliseconds."""
        if topic not in self._channels:
            text = definition(kind).encode()
            schema = self._writer.register_schema(kind, "ros2msg", text)
            self._channels[topic] = self._writer.register_channel("/" + topic, "cdr", schema)

    def write(self, entry: BagMessage) -> None:
        """Add a message to the stream; its topic is declared with the first one. Nothing is flushed.

        Times are ns since 1970, and replays sort nothing: messages must come in the order in which they came to the
        node.
        """
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
        """End the chunk of what was written, and hand everything to the operating system."""
        self._writer.flush()

    def close(self) -> None:
        """Finish the bag."""
        try:
            self._writer.finish()
        finally:
            self._stream.close()


class Recorder:
    """Writes a bag in a thread of its own: a flight neither waits for its disk nor ends by an error of it.

    When the disk refuses, is too slow, or the bag has its largest size, the bag ends there, and `trouble` says why.

    Args:
        file: see `BagWriter`.
        topics: types of topics to announce.

    Raises:
        ConfigError: see `BagWriter`.
    """

    def __init__(self, file: Path, topics: Mapping[str, str]) -> None:
        # Each of the two counts is written by one thread only, so that no lock is needed.
        self.trouble = ""
        """Why the bag goes on no more, in a sentence; "" while it does."""
        self._file = file
        self._bag = BagWriter(file)
        self._topics = dict(topics)
        self._queue: queue.SimpleQueue[BagMessage | None] = queue.SimpleQueue()
        self._taken = 0
        """Bytes that came, which only the flight's thread counts."""
        self._written = 0
        """Bytes that are in the bag, which only the bag's thread counts."""
        self._thread = threading.Thread(target=self._run, daemon=True, name="bag")
        self._thread.start()

    def write(self, entry: BagMessage) -> None:
        """Add a message: it waits in memory for the writing thread.

        A full disk or bag ends the record, and nothing is raised.
        """
        if self.trouble:
            return
        size = len(entry.data) + _OVERHEAD
        if self._taken + size > LARGEST_BAG:
            self._end(f"it has {LARGEST_BAG:,} bytes, the largest size of a bag")
        elif self._taken + size - self._written > _MOST_WAITING:
            self._end(f"its disk is too slow, {_MOST_WAITING:,} bytes wait for it")
        else:
            self._taken += size
            self._queue.put(entry)

    def close(self) -> None:
        """Finish the bag; a disk that does not answer is not waited for."""
        self._queue.put(None)
        self._thread.join(_PATIENCE)
        if self._thread.is_alive() and not self.trouble:
            self._end(f"its disk took nothing for {_PATIENCE:g} s")

    def _end(self, why: str) -> None:
        self.trouble = f"the bag {self._file} ends here: {why}. The flight goes on without it."
        self._queue.put(None)

    def _run(self) -> None:
        """The writing thread: messages in their order until the end of the queue.

        Any failure ends the record in a sentence.

        `_written` is this thread's own count.
        """
        try:
            for topic, kind in self._topics.items():
                self._bag.declare(topic, kind)
            flushed = -math.inf
            while (entry := self._queue.get()) is not None:
                self._bag.write(entry)
                self._written += len(entry.data) + _OVERHEAD
                if self._queue.empty() and time.monotonic() - flushed > _CHUNK:
                    self._bag.flush()
                    flushed = time.monotonic()
            self._bag.close()
        except Exception as error:  # of the disk, or of the library that writes
            self._end(f"it cannot be written ({error})")
            with contextlib.suppress(Exception):
                self._bag.close()


_LARGEST_RECORD = 2**27
"""Largest number of bytes of a record of a bag, and of a chunk when it is unpacked; flights have some hundred."""
_MOST_RECORDS = 2**24
"""Records of a bag: twelve hours of a hundred states a second have 9 million. Packed, empty ones take no space, but
each takes a microsecond."""
_HEAD = struct.Struct("<BQ")
"""Opcode and length before the content of a record."""


def bag_entries(file: Path) -> Iterator[BagMessage]:
    """Messages of an MCAP bag in the order in which they were written.

    A bag whose process was killed ends with its last whole chunk. Checksums are compared where it has them:
    that of a chunk before its messages come, that of all messages at the end.

    Raises:
        MissingPackage: the package mcap is not installed.
        ConfigError: the file is no bag, damaged in its middle, or has more than `_MOST_RECORDS`.
    """
    require("mcap")
    from mcap.exceptions import EndOfFile
    from mcap.records import Channel, Chunk, Message, Schema
    from mcap.stream_reader import StreamReader, breakup_chunk

    schemas: dict[int, Any] = {}
    channels: dict[int, Any] = {}
    count = 0
    with open_regular(file) as stream:
        try:
            reader = StreamReader(
                stream, emit_chunks=True, validate_crcs=True, record_size_limit=_LARGEST_RECORD
            )
            for outer in reader.records:
                records = [outer]
                if isinstance(outer, Chunk):
                    chunk = _unpacked(outer)
                    count = _counted(chunk.data, count)
                    records = breakup_chunk(chunk, True)
                for record in records:
                    if isinstance(record, Schema):
                        schemas[record.id] = record
                    elif isinstance(record, Channel):
                        channels[record.id] = record
                    elif isinstance(record, Message):
                        channel = channels[record.channel_id]
                        # The number 0 is that of no schema, as messages of JSON may have none.
                        kind = schemas[channel.schema_id].name if channel.schema_id else ""
                        if channel.message_encoding != "cdr":
                            kind = f"{channel.message_encoding} {kind}".strip()
                        topic = channel.topic.removeprefix("/")
                        yield BagMessage(record.log_time, topic, kind, record.data)
        except Exception as error:  # a damaged bag may raise anything
            # A process that was killed may have been in the middle of a record, or of a number.
            if channels and isinstance(error, EndOfFile | struct.error):
                return
            raise ConfigError(f"{file} is no MCAP bag, or damaged: {first_line(error)}.") from error


def _counted(data: bytes, count: int) -> int:
    """Number of the records of a bag with those of an unpacked chunk; `ValueError` beyond `_MOST_RECORDS`."""
    at = 0
    while at <= len(data) - _HEAD.size:
        at += _HEAD.size + _HEAD.unpack_from(data, at)[1]
        count += 1
        if count > _MOST_RECORDS:
            raise ValueError(f"it has more than {_MOST_RECORDS:,} records, the most that are read")
    return count


def _unpacked(chunk: Any) -> Any:
    """Chunk of a bag with its records uncompressed.

    ValueError beyond `_LARGEST_RECORD`, however small the file is.
    """
    if chunk.compression == "zstd":
        import zstandard

        with zstandard.ZstdDecompressor().stream_reader(chunk.data) as stream:
            data = stream.read(_LARGEST_RECORD + 1)
    elif chunk.compression == "lz4":
        import lz4.frame

        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, _LARGEST_RECORD + 1)
    else:
        data = chunk.data
    if len(data) > _LARGEST_RECORD:
        raise ValueError(f"a chunk would unpack to more than {_LARGEST_RECORD:,} bytes")
    return replace(chunk, compression="", data=data)
