"""One interface of three functions to the buses of robots: DDS, Zenoh, and UDP on this machine."""

from __future__ import annotations

import os
import socket
import struct
import threading
import time
from collections.abc import Callable
from typing import Any, Literal, Protocol

from rans.deploy.robot.messages import types
from rans.errors import ConfigError

BusName = Literal["dds", "zenoh", "udp"]
Receive = Callable[[bytes], None]
"""Takes the CDR of a message, in a thread of the bus."""


class Bus(Protocol):
    """Publishes and subscribes messages as CDR, by topic and ROS 2 type."""

    def subscribe(self, topic: str, kind: str, receive: Receive) -> None:
        """Hand on every message of a topic, such as "pose", of a type, such as "std_msgs/msg/String"."""
        ...

    def publish(self, topic: str, kind: str, data: bytes) -> None:
        """Send a message; whoever does not listen misses it."""
        ...

    def close(self) -> None:
        """Leave the bus."""
        ...


def open_bus(name: BusName, domain: int = 0, address: str = "") -> Bus:
    """A bus by its name.

    Args:
        name: "dds" is ROS 2's and PX4's agent's, "zenoh" that of rmw_zenoh, "udp" is for processes of this
            machine and for tests.
        domain: ROS_DOMAIN_ID; of "udp" it chooses the ports.
        address: of "zenoh" a locator to connect to, such as "tcp/127.0.0.1:7447"; "listen/LOCATOR" listens
            there. Empty: peers of the network are discovered.

    Raises:
        ConfigError: the package of the transport is missing, or it cannot be opened.
    """
    if not 0 <= domain <= 232:
        raise ConfigError(f"the domain must be a whole number from 0 to 232, got {domain}.")
    types()
    makers: dict[BusName, Callable[[], Bus]] = {
        "dds": lambda: DDSBus(domain),
        "zenoh": lambda: ZenohBus(domain, address),
        "udp": lambda: UDPBus(domain),
    }
    return makers[name]()


def dds_type(kind: str) -> str:
    """What DDS calls a ROS 2 type: "std_msgs::msg::dds_::String_" for "std_msgs/msg/String"."""
    package, _, name = kind.split("/")
    return f"{package}::msg::dds_::{name}_"


class UDPBus:
    """Datagrams between processes of this machine; every one reaches all of them."""

    _FIRST_PORT = 17400
    _MEMBERS = 6
    """So many processes may share a domain."""

    def __init__(self, domain: int = 0) -> None:
        self._ports = [self._FIRST_PORT + domain * self._MEMBERS + k for k in range(self._MEMBERS)]
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        for port in self._ports:
            try:
                self._socket.bind(("127.0.0.1", port))
            except OSError:
                continue
            break
        else:
            raise ConfigError(
                f"all {self._MEMBERS} UDP ports of domain {domain} are taken: choose another --domain."
            )
        self._own = port
        self._socket.settimeout(0.1)
        self._receivers: dict[str, tuple[str, Receive]] = {}
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def subscribe(self, topic: str, kind: str, receive: Receive) -> None:
        """See `Bus`."""
        self._receivers[topic] = (kind, receive)

    def publish(self, topic: str, kind: str, data: bytes) -> None:
        """See `Bus`."""
        head = f"{topic}\n{kind}".encode()
        packet = struct.pack("<H", len(head)) + head + data
        for port in self._ports:
            if port != self._own:
                try:
                    self._socket.sendto(packet, ("127.0.0.1", port))
                except OSError:  # nobody listens there
                    continue

    def close(self) -> None:
        """See `Bus`."""
        self._closed.set()
        self._thread.join()
        self._socket.close()

    def _listen(self) -> None:
        while not self._closed.is_set():
            try:
                packet = self._socket.recv(65_536)
            except OSError:  # nothing came, or a port that nobody listens on answered so
                continue
            if len(packet) < 2:
                continue
            (size,) = struct.unpack_from("<H", packet)
            topic, _, kind = packet[2 : 2 + size].decode(errors="replace").partition("\n")
            known = self._receivers.get(topic)
            if known is not None and known[0] == kind:
                known[1](packet[2 + size :])


class ZenohBus:
    """Zenoh with the keys and attachments of rmw_zenoh.

    A key is DOMAIN/TOPIC/TYPE/HASH, an attachment holds number, time and sender, as rmw_zenoh 0.2 and later
    write them (rmw_zenoh_cpp/src/detail/attachment_helpers.cpp).
    """

    def __init__(self, domain: int = 0, address: str = "") -> None:
        try:
            import zenoh
        except ImportError as error:
            raise ConfigError(
                "--bus zenoh needs the package eclipse-zenoh: pip install 'rans[robot]'."
            ) from error
        config = zenoh.Config()
        if address:
            listens = address.startswith("listen/")
            locator = address.removeprefix("listen/")
            config.insert_json5("scouting/multicast/enabled", "false")
            config.insert_json5("listen/endpoints", f'["{locator}"]' if listens else "[]")
            if not listens:
                config.insert_json5("connect/endpoints", f'["{locator}"]')
        try:
            self._session = zenoh.open(config)
        except Exception as error:  # zenoh has one exception for everything
            raise ConfigError(f"zenoh cannot be opened: {error}.") from error
        self._domain = domain
        self._sender = os.urandom(16)
        self._publishers: dict[str, Any] = {}
        self._sent: dict[str, int] = {}

    def _key(self, topic: str, kind: str) -> str:
        return f"{self._domain}/{topic}/{dds_type(kind)}/{types().hash_rihs01(kind)}"

    def subscribe(self, topic: str, kind: str, receive: Receive) -> None:
        """See `Bus`."""
        self._session.declare_subscriber(
            self._key(topic, kind), lambda sample: receive(bytes(sample.payload))
        )

    def publish(self, topic: str, kind: str, data: bytes) -> None:
        """See `Bus`."""
        if topic not in self._publishers:
            self._publishers[topic] = self._session.declare_publisher(self._key(topic, kind))
            self._sent[topic] = 0
        self._sent[topic] += 1
        self._publishers[topic].put(
            data, attachment=_attachment(self._sent[topic], time.time_ns(), self._sender)
        )

    def close(self) -> None:
        """See `Bus`."""
        self._session.close()


def _attachment(number: int, now: int, sender: bytes) -> bytes:
    """Three names with their values; texts and bytes have their length before them, in one byte."""

    def sized(content: bytes) -> bytes:
        return bytes([len(content)]) + content

    return (
        sized(b"sequence_number")
        + struct.pack("<q", number)
        + sized(b"source_timestamp")
        + struct.pack("<q", now)
        + sized(b"source_gid")
        + sized(sender)
    )


class DDSBus:
    """Cyclone DDS as ROS 2 uses it: topic "rt/NAME", type "package::msg::dds_::Type_".

    Readers are best effort, so that every writer matches them; writers are reliable, so that every reader does.
    """

    def __init__(self, domain: int = 0) -> None:
        try:
            from cyclonedds.core import Listener, Policy, Qos
            from cyclonedds.domain import DomainParticipant
        except ImportError as error:
            raise ConfigError(
                "--bus dds needs the package cyclonedds: pip install 'rans[robot]'. It has wheels for "
                "Python 3.11 to 3.13; elsewhere use --bus zenoh."
            ) from error
        self._listener = Listener
        self._last = Policy.History.KeepLast(1)
        self._reads = Qos(Policy.Reliability.BestEffort, Policy.Durability.Volatile, self._last)
        self._writes = Qos(Policy.Reliability.Reliable(0), Policy.Durability.Volatile, self._last)
        self._participant: Any = DomainParticipant(domain)
        self._structures = Structures()
        self._topics: dict[str, Any] = {}
        self._writers: dict[str, Any] = {}
        self._readers: list[Any] = []

    def _topic(self, topic: str, kind: str) -> Any:
        from cyclonedds.topic import Topic

        if topic not in self._topics:
            self._topics[topic] = Topic(self._participant, f"rt/{topic}", self._structures.of(kind))
        return self._topics[topic]

    def subscribe(self, topic: str, kind: str, receive: Receive) -> None:
        """See `Bus`."""
        from cyclonedds.sub import DataReader

        kept = self._structures.of(kind)

        class Forward(self._listener):
            """Hands samples on, in DDS's thread."""

            def on_data_available(self, reader: Any) -> None:
                for sample in reader.take(16):
                    if isinstance(sample, kept):  # not that a writer has left
                        receive(bytes(sample.serialize()))

        self._readers.append(
            DataReader(self._participant, self._topic(topic, kind), self._reads, Forward())
        )

    def publish(self, topic: str, kind: str, data: bytes) -> None:
        """See `Bus`."""
        from cyclonedds.pub import DataWriter

        known = self._topic(topic, kind)
        if topic not in self._writers:
            self._writers[topic] = DataWriter(self._participant, known, self._writes)
        self._writers[topic].write(self._structures.of(kind).deserialize(data))

    def close(self) -> None:
        """See `Bus`."""
        self._readers.clear()
        self._writers.clear()
        self._topics.clear()
        self._participant = None


class Structures:
    """Cyclone's classes of ROS 2 types, made from the definitions that `rosbags` knows."""

    def __init__(self) -> None:
        self._made: dict[str, Any] = {}

    def of(self, kind: str) -> Any:
        """The class of a type."""
        if kind not in self._made:
            from cyclonedds.idl import make_idl_struct

            _, fields = types().fielddefs[kind]
            named = {name: self._field(described) for name, described in fields}
            name = kind.replace("/", "_")
            self._made[kind] = make_idl_struct(name, dds_type(kind), named)
        return self._made[kind]

    def _field(self, described: Any) -> Any:
        """Type of a field: a basic one, another structure, or an array or sequence of either."""
        from cyclonedds.idl import types as idl
        from rosbags.interfaces import Nodetype

        kind, content = described
        if kind == Nodetype.BASE:
            name, _ = content
            return {
                "bool": bool,
                "byte": idl.byte,
                "char": idl.char,
                "string": str,
            }.get(name) or getattr(idl, name)
        if kind == Nodetype.NAME:
            return self.of(content)
        inside, length = content
        if kind == Nodetype.ARRAY:
            return idl.array[self._field(inside), length]
        return idl.sequence[self._field(inside)]
