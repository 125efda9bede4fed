"""A ROS 2 node that flies an agent: rclpy as the bus of `rans fly`, for systems where ROS 2 is installed.

    python rans_node.py AGENT_FOLDER --ros-args -r pose:=/mocap/pose -p robot:=pose -p goal:="[1.0, 0.5, 90.0]"

AGENT_FOLDER is what ``rans export RUN --format numpy --output AGENT_FOLDER`` wrote. Topics, types and frames are
those of ``rans fly`` (docs/robot/robots.md); ROS remaps them.
"""

import sys
import threading
import time
from pathlib import Path
from typing import Any

import rclpy
from rans_robot.bus import Receive
from rans_robot.node import fly_over
from rans_robot.pilot import Plan
from rans_robot.signals import stop_on_signals
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rosidl_runtime_py.utilities import get_message

from rans.extend import read_contract

READS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.BEST_EFFORT
)
WRITES = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.RELIABLE
)


class RosBus:
    """Messages as their bytes, which rclpy hands on and takes as they are."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.publishers: dict[str, Any] = {}

    def subscribe(self, topic: str, kind: str, receive: Receive) -> None:
        """See `rans_robot.bus.Bus`."""
        self.node.create_subscription(get_message(kind), topic, receive, READS, raw=True)

    def publish(self, topic: str, kind: str, data: bytes) -> None:
        """See `rans_robot.bus.Bus`."""
        if topic not in self.publishers:
            self.publishers[topic] = self.node.create_publisher(get_message(kind), topic, WRITES)
        self.publishers[topic].publish(data)

    def close(self) -> None:
        """See `rans_robot.bus.Bus`."""
        self.node.destroy_node()


def main() -> int:
    """Fly until the node is stopped or something is wrong; the valves are shut then."""
    # rclpy's own handlers end its publishers before the valves are shut.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    stop = stop_on_signals()
    node = rclpy.create_node("rans")
    robot = node.declare_parameter("robot", "ros").value
    goal = tuple(node.declare_parameter("goal", [0.0, 0.0, 0.0]).value)
    folder = Path(sys.argv[1]).resolve()
    about = read_contract(folder)
    plan = Plan(str(folder), {"name": about["task"], "settings": about["settings"]}, robot, goal)
    bag = Path(f"flight-{time.strftime('%Y%m%d-%H%M%S')}.mcap")
    threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()
    bus = RosBus(node)
    report = fly_over(bus, plan, bag, None, node.get_logger().info, stop.is_set)
    node.get_logger().info(report.text())
    return 1 if report.fault else 0


if __name__ == "__main__":
    sys.exit(main())
