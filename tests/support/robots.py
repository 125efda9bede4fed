"""What tests of robots share: a pose away from the goal, and waiting for a bus."""

from __future__ import annotations

import threading

import numpy as np
from rans_robot.bus import UDPBus
from rans_robot.frames import Motion, quaternion_of
from rans_robot.messages import TEXT

from tests.support.processes import wait_until

AWAY = Motion(np.array([2.0, 1.0, 0.0]), quaternion_of(0.5), np.zeros(3), np.zeros(3))


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
