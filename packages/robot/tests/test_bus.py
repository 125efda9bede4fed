"""Buses: every type crosses each, and the environment chooses."""

from __future__ import annotations

import os
import re
from typing import Any

import numpy as np
import pytest
from rans_robot.bus import DDSBus, UDPBus, ZenohBus, open_bus
from rans_robot.interfaces import Interface

from rans import ConfigError
from tests.support.processes import free_port, wait_until
from tests.support.robots import AWAY

pytest.importorskip("rosbags")
pytest.importorskip("mcap")


def test_the_bus_is_that_of_the_robots_environment(monkeypatch):
    opened = []
    for name in ("DDSBus", "UDPBus", "ZenohBus"):
        monkeypatch.setattr(f"rans_robot.bus.{name}", lambda *given: opened.append(given))
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    monkeypatch.setenv("ROS_DISTRO", "humble")
    open_bus("zenoh:listen/tcp/0.0.0.0:7447")
    open_bus("dds")
    assert opened == [(7, "listen/tcp/0.0.0.0:7447", "humble"), (7,)]
    for name in ("lyrical", "rolling"):  # what comes after Kilted speaks as Rolling does
        monkeypatch.setenv("ROS_DISTRO", name)
        open_bus("zenoh")
        assert opened[-1][2] == "rolling"
    monkeypatch.setenv("ROS_DISTRO", "foxy")
    open_bus("udp")  # no distribution matters here
    with pytest.raises(ConfigError, match="ROS_DISTRO must be one of humble"):
        open_bus("zenoh")
    for number in ("seven", "500"):
        monkeypatch.setenv("ROS_DOMAIN_ID", number)
        with pytest.raises(ConfigError, match="ROS_DOMAIN_ID must be a whole number from 0 to"):
            open_bus("dds")


def _buses(name: str) -> tuple[Any, Any]:
    if name == "udp":
        return UDPBus(37), UDPBus(37)
    if name == "zenoh":
        pytest.importorskip("zenoh")
        locator = f"tcp/127.0.0.1:{free_port()}"
        return ZenohBus(0, f"listen/{locator}"), ZenohBus(0, locator)
    pytest.importorskip("cyclonedds")
    os.environ.setdefault(
        "CYCLONEDDS_URI",
        "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo' multicast='false'/>"
        "</Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto"
        "</ParticipantIndex><Peers><Peer address='127.0.0.1'/></Peers></Discovery></Domain></CycloneDDS>",
    )
    return DDSBus(77), DDSBus(77)


@pytest.mark.parametrize("name", ["udp", "zenoh", "dds"])
def test_every_type_crosses_every_bus(name):
    """The bytes that arrive are those that were sent."""
    first, second = _buses(name)
    try:
        motion = AWAY._replace(spin=np.array([0.0, 0.0, 0.25]))
        sent = []
        for robot in ("ros", "odometry", "px4", "roboran"):
            ends = Interface(robot, 8, 8)
            sent += [*ends.state(motion, 10**9), *ends.command([1.0] + [0.0] * 7, 10**9)]
        got = {}
        for message in sent:
            second.subscribe(
                message.topic, message.kind, lambda data, m=message: got.update({m.topic: data})
            )
        wanted = {message.topic: message.data for message in sent}

        def all_came():
            for message in sent:
                first.publish(*message)
            return len(got) == len(wanted)

        wait_until(all_came)
        assert {topic: len(data) for topic, data in got.items()} == {
            topic: len(data) for topic, data in wanted.items()
        }
        for message in sent:
            if message.topic in ("pose", "twist"):
                continue  # sent by two kinds of robots
            assert got[message.topic] == wanted[message.topic]
    finally:
        first.close()
        second.close()


@pytest.mark.parametrize("locator", ["bad", "listen/bad", "tcp/nowhere", 'tcp/"'])
def test_what_is_no_locator_is_refused(locator):
    pytest.importorskip("zenoh")
    with pytest.raises(ConfigError, match=re.escape(locator.removeprefix("listen/"))):
        ZenohBus(0, locator)
