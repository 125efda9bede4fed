"""An agent on a robot: frames by one pulse a thruster, messages, faults, bags, and two processes over loopback."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from rans_missions.tasks import Avoid
from rans_robot.bag import bag_entries
from rans_robot.bus import UDPBus, open_bus
from rans_robot.frames import Motion
from rans_robot.interfaces import Interface
from rans_robot.messages import FLOATS, pack, text_message, unpack
from rans_robot.monitor import RULES
from rans_robot.node import END_TOPIC, Report, fly_over, replay_bag
from rans_robot.pilot import (
    CRAFT_TOPIC,
    MessagePilot,
    Plan,
    craft_hash,
)
from rans_robot.twin import VALVES_TOPIC, Craft, TwinPlan, run_twin

from rans import ConfigError, GoToPose
from rans.base.pretrained import pretrained_folder
from rans.cli import main
from rans.deploy.export import write_export
from rans.model.spacecraft_file import load_spacecraft
from tests.support.processes import PATIENCE, wait_until
from tests.support.robots import AWAY, Always, Wire, bag_of, hear_all, plan, started

PLATFORM = "floating-platform"
GOAL = (0.5, -0.5, 30.0)
TURN = np.radians(30.0) - 0.5
SEEN = np.array(
    [[np.cos(0.5), np.sin(0.5), 0, 0, 0, 1, -1.5, -1.5, np.cos(TURN), np.sin(TURN)]], np.float32
)
"""What an agent observes away from this goal, by hand."""

# Deciding


def steps(pilot: MessagePilot, motion: Motion, count: int = 3, begin: int = 0) -> list[Any]:
    """Decisions with a fresh state before each."""
    found = []
    for k in range(begin, begin + count):
        now = (k + 1) * round(pilot.period * 1e9)
        for message in pilot.interface.state(motion, now):
            pilot.receive(message.topic, message.data, now)
        found.append(pilot.decide(now))
    return found


def test_it_gives_the_agents_commands(agent):
    """The command on the bus is the one that the agent here gives to the observation of this state."""
    from rans.evaluation.fly.agent import load_policy

    pilot = MessagePilot(plan(agent, goal=GOAL), GoToPose())
    (decision, *_) = steps(pilot, AWAY)
    controller = load_policy(pretrained_folder("go-to-pose-2d")).controller
    controller.reset(1)
    expected = controller.act(None, None, SEEN)[0]
    np.testing.assert_array_equal(decision.command, expected)
    assert decision.command.any()
    assert decision.note == ""


def test_states_that_come_too_seldom_end_a_flight(agent):
    pilot = MessagePilot(plan(agent), GoToPose())
    slow: Any = None
    for k in range(1, 25):
        now = k * 350_000_000
        for message in pilot.interface.state(AWAY, now):
            pilot.receive(message.topic, message.data, now)
        slow = pilot.decide(now)
    assert slow.over
    assert "come every 0.35 s, but the agent decides every 0.2 s" in slow.note


@pytest.mark.parametrize(
    ("craft", "period", "sentence"),
    [
        ("atmos", 0.2, "the robot is the spacecraft 'atmos'"),
        (PLATFORM, 0.2001, "takes a command every 0.2001 s, but the agent gives one every 0.2 s"),
    ],
)
def test_another_robot_is_refused(agent, craft, period, sentence):
    pilot = MessagePilot(plan(agent), GoToPose())
    assert steps(pilot, AWAY, 1)[0].command.any()
    about = {
        "sha256": craft_hash(load_spacecraft(craft)),
        "control_period": period,
        "name": craft,
    }
    pilot.receive(CRAFT_TOPIC, text_message(json.dumps(about)), 0)
    decision = steps(pilot, AWAY, 1, begin=3)[0]
    assert (decision.over, decision.command.any()) == (True, False)
    assert sentence in decision.note


# The safety filter

ZONES = (1.5, 0.0, 0.4, 2.0, 5.0, 0.4, 2.0, -5.0, 0.4)
"""One zone between start and goal, and two far away: the agent observes three."""


@pytest.fixture(scope="module")
def avoider(tmp_path_factory) -> Path:
    """The shipped agent of avoid, as a node flies it."""
    folder = tmp_path_factory.mktemp("avoider") / "avoid-2d"
    write_export(pretrained_folder("avoid-2d"), folder, "numpy", episodes=0)
    return folder


def avoiding(folder: Path, **changes: Any) -> Plan:
    settings: dict[str, Any] = {"zones": ZONES} | changes
    return Plan(str(folder), {"name": "avoid", "settings": {}}, **settings)


@pytest.mark.parametrize("guard", [False, True])
def test_no_agent_enters_a_zone_behind_the_filter(guard, avoider):
    """Distances by hand, of the twin's motion."""
    pilot = MessagePilot(avoiding(avoider, guard=guard), Avoid())
    # Every thruster that pushes along -x, towards the zone.
    pilot.agent = Always(np.array(pilot.craft.wrench_map)[:, 0] < -1e-6)
    twin = Craft(TwinPlan(pilot.craft, 0.2, start=(3.0, 0.1, 0.0), rate=25.0))
    nearest = np.inf
    replaced = 0
    for k in range(60):
        decision = steps(pilot, twin.motion, 1, begin=k)[0]
        replaced += decision.guarded
        twin.hold(decision.command)
        for _ in range(5):
            twin.advance()
            nearest = min(nearest, float(np.hypot(*(twin.motion.position[:2] - (1.5, 0.0)))))
        if nearest <= 0.4:
            break
    assert (nearest > 0.4) == guard
    assert (replaced > 0) == guard


@pytest.mark.slow
def test_a_filtered_flight_comes_out_of_its_bag_again(avoider, tmp_path, monkeypatch):
    # This machine may do other work, and what the robot sends stands still.
    for rule in ("time", "still", "twist"):
        limits = (1e9,) * len(RULES[rule].limits)
        monkeypatch.setitem(RULES, rule, RULES[rule]._replace(limits=limits))
    bag = tmp_path / "flight.mcap"
    flying = avoiding(avoider, guard=True, lost_after=60.0)
    # It moves so fast towards the zone that the filter must act at once.
    fast = AWAY._replace(position=np.array([2.1, 0.0, 0.0]), velocity=np.array([-0.45, 0.0, 0.0]))
    wire = Wire()
    ends = Interface("ros", 8, 8)
    stop = threading.Event()

    def publish():
        while not stop.wait(0.04):
            for message in ends.state(fast, time.time_ns()):
                wire.publish(*message)

    robot = threading.Thread(target=publish)
    robot.start()
    try:
        report = fly_over(
            wire, flying, bag, None, lambda _: None, lambda: wire.count("commands") >= 8
        )
    finally:
        stop.set()
        robot.join()
    assert report.guarded
    assert "safety filter" in report.text()
    assert "Errors at the end: position" in report.text()
    again = replay_bag(bag)
    assert again.decisions == report.decisions
    assert again.equal == again.decisions


# Flights, bags and buses


def flown(wire: Wire, agent: Path, bag: Path, commands: int, **changes: Any) -> Report:
    """A flight of so many commands of a node against a twin, as two threads."""
    stop = threading.Event()
    other = TwinPlan(load_spacecraft(PLATFORM), 0.2, start=(0.3, 0.2, 10.0), rate=25.0, **changes)
    twin = threading.Thread(target=run_twin, args=(wire, other, lambda _: None, stop.is_set))
    twin.start()
    try:
        return fly_over(
            wire,
            plan(agent, robot=other.robot, lost_after=60.0),
            bag,
            None,
            lambda _: None,
            lambda: wire.count("commands") >= commands,
        )
    finally:
        stop.set()
        twin.join()


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["ros", "pose"])
def test_a_flight_and_its_bag(agent, tmp_path, robot):
    bag = tmp_path / "flight.mcap"
    report = flown(Wire(), agent, bag, 15, robot=robot)
    assert report.fault == ""
    assert report.decisions == 15
    kept = list(bag_entries(bag))
    topics = {entry.topic for entry in kept}
    assert {"rans/flight", "pose", "commands", END_TOPIC} <= topics
    again = replay_bag(bag)
    assert again.decisions == report.decisions
    assert (again.equal, again.first_difference) == (again.decisions, None)

    # A bag whose process was killed.
    short = tmp_path / "killed.mcap"
    short.write_bytes(bag.read_bytes()[: int(bag.stat().st_size * 0.6)])
    again = replay_bag(short)
    assert 0 < again.decisions < report.decisions
    assert again.equal == again.decisions
    # It may have been killed anywhere in a message.
    whole = short.read_bytes()
    for cut in range(1, 200):
        short.write_bytes(whole[:-cut])
        assert [*bag_entries(short)] == kept[: len([*bag_entries(short)])]


def test_a_bag_that_was_changed_does_not_come_out(agent, tmp_path):
    bag = tmp_path / "flight.mcap"
    flown(Wire(), agent, bag, 10)
    shut = pack(FLOATS, {"data": np.zeros(8)})
    entries = [*bag_entries(bag)]
    at = next(k for k, e in enumerate(entries) if e.topic == "commands" and e.data != shut)
    entries[at] = entries[at]._replace(data=shut)
    bag.unlink()
    bag_of(tmp_path, entries)
    assert replay_bag(bag).first_difference is not None


@pytest.mark.slow
@pytest.mark.parametrize("killed", ["node", "twin", "nobody"])
def test_a_kill_of_either_side_shuts_the_valves(killed, agent, tmp_path, monkeypatch):
    """Two processes over UDP; one is ended by SIGKILL while valves are open.

    What a flight that ends well prints to run next runs, but a flight of a second identifies nothing.
    """
    domain = {"node": 41, "twin": 42, "nobody": 44}[killed]
    monitor = UDPBus(domain)
    valves = []
    commands = []
    monitor.subscribe(VALVES_TOPIC, FLOATS, lambda x: valves.append(any(unpack(FLOATS, x).data)))
    monitor.subscribe("commands", FLOATS, lambda x: commands.append(any(unpack(FLOATS, x).data)))
    where = {"domain": domain, "folder": tmp_path}
    twin = started("twin", PLATFORM, "--start", "4", "0", "0", "--rate", "25", **where)
    running = [twin]

    def until(holds, *alive):
        wait_until(lambda: holds() or any(process.poll() is not None for process in alive))
        assert holds()

    try:
        # The node waits for the robot 10 s, and modules load longer at times.
        until(lambda: bool(valves), twin)
        node = started("fly", str(agent), "--trust", "--output", "flight", **where)
        running.append(node)
        until(lambda: any(commands[-5:]) and any(valves[-5:]), twin, node)
        if killed == "nobody":
            node.send_signal(signal.SIGTERM)
            text, _ = node.communicate(timeout=PATIENCE)
            assert node.returncode == 0, text
            monkeypatch.chdir(tmp_path)
            found = re.findall(r"^  rans (.*)$", text.partition("Next:")[2], re.MULTILINE)
            assert [main(shlex.split(line)) for line in found] == [0, 2]
            return
        victim, survivor = (node, twin) if killed == "node" else (twin, node)
        victim.send_signal(signal.SIGKILL)
        victim.wait()
        if killed == "node":
            until(lambda: len(valves) > 3 and not any(valves[-3:]), twin)
        else:
            assert survivor.wait(PATIENCE) == 1
            hear_all(monitor, domain)
            assert not any(commands[-3:])
        survivor.send_signal(signal.SIGTERM)
        text, _ = survivor.communicate(timeout=PATIENCE)
        assert "valves shut" in " ".join(text.split())
    finally:
        for process in running:
            process.kill()
            process.communicate()
        monitor.close()


_HANGS = """
class Hangs(Agent):
    calls = 0

    def act(self, observation):
        self.calls += abs(observation[6]) > 1.0  # not to warm up
        if self.calls == 10:
            np.linalg.svd(np.ones((6000, 6000)))
        return super().act(observation)


Agent, check = Hangs, lambda: (1, 1)
"""
"""Minutes in a library that does not let Python handle a signal."""


@pytest.mark.slow
def test_a_library_that_computes_keeps_no_valve_open(agent, tmp_path):
    """It is shut in time, and the process ends at a second Ctrl-C."""
    folder = tmp_path / "agent"
    shutil.copytree(agent, folder)
    code = folder / "agent.py"
    text, main_part, end = code.read_text("utf-8").partition('if __name__ == "__main__":')
    code.write_text(text + _HANGS + main_part + end, "utf-8")
    monitor = UDPBus(45)
    commands = []
    monitor.subscribe("commands", FLOATS, lambda x: commands.append(any(unpack(FLOATS, x).data)))
    where = {"domain": 45, "folder": tmp_path}
    running = [started("twin", PLATFORM, "--start", "4", "0", "0", "--rate", "25", **where)]
    try:
        running.append(started("fly", str(folder), "--trust", "--output", "flight", **where))
        wait_until(lambda: any(commands))
        wait_until(lambda: len(commands) > 3 and not any(commands[-3:]))
        heard = len(commands)
        for _ in range(2):
            running[1].send_signal(signal.SIGINT)
            time.sleep(0.5)
        assert running[1].wait(PATIENCE) == 1
        hear_all(monitor, 45)
        assert not any(commands[heard:])
    finally:
        for process in running:
            process.kill()
            process.communicate()
        monitor.close()


def test_a_command_to_which_no_robot_answers_fails(agent, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("ROS_DOMAIN_ID", "43")
    out = tmp_path / "flight"
    line = f"fly {agent} --trust --bus udp --seconds 0.5 --output {out}"
    codes = []
    # Only the main thread of a process catches its signals, which are pytest's here.
    node = threading.Thread(target=lambda: codes.append(main(line.split())), daemon=True)
    node.start()
    node.join(PATIENCE)
    assert codes == [1]
    said = capsys.readouterr()
    assert "no state came on pose and twist over udp" in " ".join((said.out + said.err).split())
    # What was recorded is whole, and can be replayed.
    assert replay_bag(out / "flight.mcap").decisions > 0


def test_one_sentence_for_what_is_missing(monkeypatch):
    for module, name in (("zenoh", "zenoh"), ("cyclonedds", "dds")):
        monkeypatch.setitem(sys.modules, module, None)
        with pytest.raises(ConfigError, match=r"pip install .*\[robot\]"):
            open_bus(name)
    with pytest.raises(ConfigError, match="has 12 thrusters and no wheel"):
        Interface("px4", 16, 16)
