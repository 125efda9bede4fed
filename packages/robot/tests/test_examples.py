"""examples/ros2, with a stand-in for rclpy."""

from __future__ import annotations

import sys
import types
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rosbags")

from rans_robot.interfaces import Interface
from rans_robot.messages import POSE

from tests.support.robots import AWAY
from tests.support.scripts import module_of

FILE = Path(__file__).parents[3] / "examples" / "ros2" / "rans_node.py"


class Topics:
    """A node whose topics end in itself, as rclpy's raw subscriptions take and give bytes."""

    def __init__(self) -> None:
        self.receivers: dict[str, Any] = {}
        self.sent: list[str] = []

    def create_subscription(self, kind: Any, topic: str, receive: Any, qos: Any, raw: bool) -> None:
        assert raw
        self.receivers[topic] = (kind, receive)

    def create_publisher(self, kind: Any, topic: str, qos: Any) -> Any:
        def publish(data: bytes) -> None:
            assert isinstance(data, bytes)
            self.sent.append(topic)
            if topic in self.receivers:
                assert self.receivers[topic][0] == kind
                self.receivers[topic][1](data)

        return types.SimpleNamespace(publish=publish)

    def destroy_node(self) -> None:
        self.receivers.clear()


def test_the_node_of_ros2_is_a_short_shell(monkeypatch):
    assert len(FILE.read_text("utf-8").splitlines()) <= 80
    qos = types.SimpleNamespace(
        QoSProfile=lambda **given: given,
        HistoryPolicy=types.SimpleNamespace(KEEP_LAST=1),
        ReliabilityPolicy=types.SimpleNamespace(BEST_EFFORT=2, RELIABLE=1),
    )
    utilities = types.SimpleNamespace(get_message=lambda kind: kind)
    for name, module in {
        "rclpy": types.ModuleType("rclpy"),
        "rclpy.node": types.SimpleNamespace(Node=object),
        "rclpy.qos": qos,
        "rclpy.signals": types.SimpleNamespace(SignalHandlerOptions=object),
        "rosidl_runtime_py": types.ModuleType("rosidl_runtime_py"),
        "rosidl_runtime_py.utilities": utilities,
    }.items():
        monkeypatch.setitem(sys.modules, name, module)
    node = Topics()
    bus = module_of(FILE).RosBus(node)
    got = []
    bus.subscribe("pose", POSE, got.append)
    (message,) = Interface("pose", 8, 8).state(AWAY, 10**9)
    bus.publish(*message)
    bus.publish(*message)
    assert got == [message.data] * 2
    bus.close()
