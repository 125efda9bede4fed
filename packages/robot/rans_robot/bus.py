"""One interface of three functions to the buses of robots: DDS, Zenoh, and UDP on this machine.

Data is CDR with its head of four bytes on every bus; `tests/test_bus.py` sends every type over each.
"""

from __future__ import annotations

import json
import os
import socket
import struct
import threading
import time
from collections.abc import Callable
from typing import Any, Literal, Protocol, cast, get_args

from rans.extend import ConfigError, brief, require
from rans_robot.messages import types
from rans_robot.monitor import Link

BusName = Literal["dds", "zenoh", "udp"]
Distribution = Literal["humble", "jazzy", "kilted", "rolling"]
"""Distributions of ROS 2 whose Zenoh differs; "rolling" is also that of what came after Kilted."""
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


def dds_type(kind: str) -> str:
    """What DDS calls a ROS 2 type: "std_msgs::msg::dds_::String_" for "std_msgs/msg/String"."""
    package, _, name = kind.split("/")
    return f"{package}::msg::dds_::{name}_"


class UDPBus:
    """Datagrams between processes of this machine; every one reaches all of them. The domain chooses the ports."""

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
                f"all {self._MEMBERS} UDP ports of domain {domain} are taken: choose another ROS_DOMAIN_ID."
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
        """Send one packet to every other port of this machine: length of the head, topic and type, data.

        See `Bus`.
        """
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
        """The receiving thread: hands packets of subscribed topics of the right type on until the bus closes.

        Receivers are called in this thread; an exception of one would end it for all topics.
        """
        while not self._closed.is_set():
            try:
                packet = self._socket.recv(65_536)
            except OSError:  # nothing came, or a port that nobody listens on answered so
                continue
            if len(packet) < 2:
                continue
            (size,) = struct.unpack_from("<H", packet)
            topic, _, kind = packet[2 : 2 + size].decode(errors="replace").partition("\n")
            receiver = self._receivers.get(topic)
            if receiver is not None and receiver[0] == kind:
                receiver[1](packet[2 + size :])


ROUTER = "tcp/localhost:7447"
"""Address at which sessions of rmw_zenoh expect their router; they do not search the network for one."""
_QOS = "::,10:,:,:,,"
"""Quality of service as tokens write it: defaults, which are reliable and volatile, with a depth of 10."""


_TIMED = struct.Struct("<qq")
"""Begin of an attachment: number and time, ns."""


class ZenohBus:
    """Zenoh with the keys, attachments and liveliness tokens of rmw_zenoh 0.1.2, 0.2.4, 0.6 and later.

    A key is DOMAIN/TOPIC/TYPE/HASH, an attachment holds number, time and sender, and tokens announce a node with
    its publishers and subscriptions, so that ``ros2 topic list`` shows them (rmw_zenoh, docs/design.md, and
    rmw_zenoh_cpp/src/detail/{attachment_helpers,liveliness_utils}.cpp).

    Raises:
        MissingPackage: the package zenoh is not installed.
        ConfigError: neither a router nor a peer answers.
    """

    def __init__(self, domain: int = 0, address: str = "", ros: Distribution = "jazzy") -> None:
        zenoh = require("zenoh")
        listens = address.startswith("listen/")
        locator = address.removeprefix("listen/") or ROUTER
        if "/" not in locator:
            raise ConfigError(
                f"zenoh takes a protocol and an address, such as tcp/192.168.0.2:7447, got {brief(locator)}."
            )
        config = zenoh.Config()
        config.insert_json5("scouting/multicast/enabled", "false")
        if not listens:
            # A client: the router passes its messages on to all nodes, also of other machines.
            config.insert_json5("mode", '"client"')
        try:
            endpoints = "listen/endpoints" if listens else "connect/endpoints"
            config.insert_json5(endpoints, json.dumps([locator]))
            self._session = zenoh.open(config)
        except Exception as error:  # zenoh has one exception for everything
            reason, _, _ = str(error).partition(" at /")  # the rest is a place in zenoh's source
            cause = (
                "Is another process listening there?"
                if listens
                else "If nothing answers there, start ROS 2's router, ros2 run rmw_zenoh_cpp rmw_zenohd, or "
                "name the router or peer, as in --bus zenoh:tcp/192.168.0.2:7447."
            )
            raise ConfigError(
                f"zenoh cannot be opened at {locator}: {reason.strip()} {cause}"
            ) from error
        self._domain = domain
        self._ros: Distribution = ros
        self._publishers: dict[str, Any] = {}
        self._senders: dict[str, bytes] = {}
        self._sent: dict[str, int] = {}
        self._tokens: list[Any] = []
        self._announce("NN")

    def _hash(self, kind: str) -> str:
        return "TypeHashNotSupported" if self._ros == "humble" else types().hash_rihs01(kind)

    def _key(self, topic: str, kind: str) -> str:
        return f"{self._domain}/{topic}/{dds_type(kind)}/{self._hash(kind)}"

    def _announce(self, entity: str, topic: str = "", kind: str = "") -> None:
        """Declare the token of a node ("NN"), a publisher ("MP") or a subscription ("MS").

        Words, their order and the two kinds of slashes are those of rmw_zenoh: with others `ros2 topic list` is
        empty.
        """
        number = len(self._tokens)
        # Slashes in names are written as %: enclave and namespace are the root.
        parts = ["@ros2_lv", self._domain, self._session.info.zid(), 0, number, entity]
        parts += ["%", "%", "rans"]
        if topic:
            name = "%" + topic.replace("/", "%")
            parts += [name, dds_type(kind), self._hash(kind), _QOS]
        token = self._session.liveliness().declare_token("/".join(map(str, parts)))
        self._tokens.append(token)

    def subscribe(self, topic: str, kind: str, receive: Receive) -> None:
        """See `Bus`."""
        link = Link()

        def take(sample: Any) -> None:
            # Of a publisher that attaches no time nothing is known.
            attached = b"" if sample.attachment is None else bytes(sample.attachment)
            if len(attached) < _TIMED.size or link.is_fresh(_TIMED.unpack_from(attached)[1]):
                receive(bytes(sample.payload))

        self._session.declare_subscriber(self._key(topic, kind), take)
        self._announce("MS", topic, kind)

    def publish(self, topic: str, kind: str, data: bytes) -> None:
        """Publish with Zenoh's attachment (number, time, sender), which robots' middleware asks for; see `Bus`.

        The number rises by one for each topic, since subscribers count what they lost by it.
        """
        if topic not in self._publishers:
            self._publishers[topic] = self._session.declare_publisher(self._key(topic, kind))
            self._senders[topic] = os.urandom(16)
            self._sent[topic] = 0
            self._announce("MP", topic, kind)
        self._sent[topic] += 1
        attached = _attachment(self._sent[topic], time.time_ns(), self._senders[topic], self._ros)
        self._publishers[topic].put(data, attachment=attached)

    def close(self) -> None:
        """See `Bus`."""
        self._session.close()


def _attachment(number: int, now: int, sender: bytes, ros: Distribution) -> bytes:
    """Number and time (ns) as int64, and the sender, with its length before it up to Kilted."""
    length = b"" if ros == "rolling" else bytes([len(sender)])
    return _TIMED.pack(number, now) + length + sender


def open_bus(text: str) -> Bus:
    """A bus by the text of --bus, in the domain and for the distribution that ROS's environment names.

    Args:
        text: "dds", "zenoh", "udp", or "zenoh:LOCATOR".

    Raises:
        ConfigError: there is no such bus, the environment has a wrong value, the package of the transport is
            missing, or it cannot be opened.
    """
    kind, _, locator = text.partition(":")
    if kind not in get_args(BusName) or (locator and kind != "zenoh"):
        raise ConfigError(
            f"--bus takes dds, zenoh, udp or zenoh:LOCATOR, such as zenoh:tcp/192.168.0.2:7447, got {brief(text)}."
        )
    types()
    domain = ros_domain()
    if kind == "udp":
        return UDPBus(domain)
    if kind == "dds":
        return DDSBus(domain)
    name = os.environ.get("ROS_DISTRO") or "jazzy"
    if name.isalpha() and name > "kilted":  # their names are in the order of the alphabet
        name = "rolling"
    if name not in get_args(Distribution):
        raise ConfigError(
            f"ROS_DISTRO must be one of {', '.join(get_args(Distribution))} for zenoh, got {brief(name)}."
        )
    return ZenohBus(domain, locator, cast("Distribution", name))


def ros_domain() -> int:
    """The domain of ROS's environment, or 0.

    Raises:
        ConfigError: ROS_DOMAIN_ID is no whole number from 0 to 232.
    """
    number = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not number.isdecimal() or len(number) > 9 or int(number) > 232:
        raise ConfigError(
            f"ROS_DOMAIN_ID must be a whole number from 0 to 232, got {brief(number)}."
        )
    return int(number)


class DDSBus:
    """Cyclone DDS as ROS 2 uses it: topic "rt/NAME", type "package::msg::dds_::Type_".

    Readers are best effort, so that every writer matches them; writers are reliable, so that every reader does.
    """

    def __init__(self, domain: int = 0) -> None:
        require("cyclonedds")
        from cyclonedds.core import Listener, Policy, Qos
        from cyclonedds.domain import DomainParticipant

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
        """Hand samples of a topic on, in DDS's thread, as CDR with its head; see `Bus`.

        Readers are kept in a list, as they end when Python forgets them.
        """
        from cyclonedds.sub import DataReader

        kept = self._structures.of(kind)
        link = Link()

        class Forward(self._listener):
            """Hands samples on, in DDS's thread."""

            def on_data_available(self, reader: Any) -> None:
                for sample in reader.take(16):
                    sent = sample.sample_info.source_timestamp
                    # Not that a writer has left.
                    if isinstance(sample, kept) and link.is_fresh(sent):
                        receive(bytes(sample.serialize()))

        self._readers.append(
            DataReader(self._participant, self._topic(topic, kind), self._reads, Forward())
        )

    def publish(self, topic: str, kind: str, data: bytes) -> None:
        """See `Bus`."""
        from cyclonedds.pub import DataWriter

        dds_topic = self._topic(topic, kind)
        if topic not in self._writers:
            self._writers[topic] = DataWriter(self._participant, dds_topic, self._writes)
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
        """The class of a type for cyclonedds, made once from its fields; nested types are made with it."""
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
