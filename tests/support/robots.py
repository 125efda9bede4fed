"""What tests of robots share: a pose away from the goal, agents, plans, bags, buses and processes."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from rans_robot.bag import BagMessage, BagWriter
from rans_robot.bus import Receive, UDPBus
from rans_robot.frames import Motion, quaternion_of
from rans_robot.messages import TEXT
from rans_robot.pilot import Decision, Plan

from tests.support.processes import ROOT, wait_until

AWAY = Motion(np.array([2.0, 1.0, 0.0]), quaternion_of(0.5), np.zeros(3), np.zeros(3))


SECOND = 10**9
NOW = 1_700_000_000 * SECOND
"""A clock of these years, ns."""


def opened(decisions: list[Decision]) -> list[bool]:
    """Whether valves are open, by decision."""
    return [bool(decision.command.any()) for decision in decisions]


def plan(folder: Path, **changes: Any) -> Plan:
    """A flight of go-to-pose with the agent of a folder."""
    return Plan(str(folder), {"name": "go-to-pose", "settings": {}}, **changes)


def bag_of(folder: Path, messages: Iterable[BagMessage]) -> Path:
    """A bag with messages, in a folder."""
    file = folder / "flight.mcap"
    bag = BagWriter(file)
    for message in messages:
        bag.write(message)
    bag.close()
    return file


class Always:
    """An agent that always gives one command, and may fail at one of its decisions."""

    note = ""

    def __init__(self, command: Any, fails_at: int = 10**9) -> None:
        self.command = np.array(command, np.float32)
        self.calls = 0
        self.fails_at = fails_at

    def reset(self) -> None:
        """Nothing to forget."""

    def act(self, observation: np.ndarray) -> np.ndarray:
        self.calls += 1
        if self.calls > self.fails_at:
            raise MemoryError
        return self.command


class Wire:
    """A bus within one process, which remembers what was sent."""

    def __init__(self) -> None:
        self.sent: list[tuple[str, bytes]] = []
        self._receivers: dict[str, list[Receive]] = {}

    def subscribe(self, topic: str, kind: str, receive: Receive) -> None:
        self._receivers.setdefault(topic, []).append(receive)

    def count(self, topic: str) -> int:
        """Number of messages that were sent."""
        return sum(one == topic for one, _ in self.sent)

    def publish(self, topic: str, kind: str, data: bytes) -> None:
        self.sent.append((topic, data))
        self.hand_on(topic, data)

    def hand_on(self, topic: str, data: bytes) -> None:
        for receive in self._receivers.get(topic, ()):
            receive(data)

    def close(self) -> None:
        self._receivers.clear()


_PATIENT = """
import sys
from rans.cli import main
from rans_robot import pilot
made = pilot.Plan
pilot.Plan = lambda **settings: made(**settings | {"lost_after": 5.0})
sys.exit(main())
"""
"""The command; a flight waits for a state 5 s, since a busy machine may stop the robot's process for one."""


def started(*arguments: str, domain: int, folder: Path = ROOT) -> subprocess.Popen[str]:
    """The command in a process that looks for its robot over UDP in a domain."""
    return subprocess.Popen(
        [sys.executable, "-c", _PATIENT, *arguments, "--bus", "udp"],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "ROS_DOMAIN_ID": str(domain)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def hear_all(bus: UDPBus, domain: int) -> None:
    """Wait until a bus has handed on what was sent to it before: datagrams of a machine stay in their order."""
    heard = threading.Event()
    bus.subscribe("tests/last", TEXT, lambda _: heard.set())
    other = UDPBus(domain)

    def is_heard() -> bool:
        other.publish("tests/last", TEXT, b"")
        return heard.is_set()

    try:
        wait_until(is_heard)
    finally:
        other.close()
