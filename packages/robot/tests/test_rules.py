"""Every rule of the monitor, in the forms in which agents fly robots and for every kind of robot.

Each flight with a fault ends shut, and is flown again with its rule left out: valves must open then.
"""

from __future__ import annotations

import ast
import json
import threading
import time
from collections.abc import Callable, Iterator
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from rans_robot.bus import open_bus
from rans_robot.frames import Motion
from rans_robot.interfaces import Interface, RobotName
from rans_robot.messages import FLOATS, unpack
from rans_robot.monitor import RULES, Link, Monitor
from rans_robot.node import fly_over, replay_bag
from rans_robot.pilot import Decision, MessagePilot
from rans_robot.twin import FAULTS, Craft, Fault, TwinPlan, run_twin

from rans import ConfigError, GoToPose, load_spacecraft
from rans.base.pretrained import pretrained_folder
from rans.deploy.export import write_export
from rans.evaluation.fly.exported import read_contract
from tests.support.processes import ROOT
from tests.support.robots import AWAY, NOW, SECOND, Always, Wire, opened, plan

RATE = 25
PERIOD = 0.2
STEPS = round(RATE * PERIOD)
BEGIN = 5
"""Control period in which a fault begins."""
ROBOTS: tuple[RobotName, ...] = get_args(RobotName)
PUSH = np.array([0, 0, 1.0, 0, 0, 0, 0, 1.0])
"""Two thrusters that push along one direction."""


@pytest.fixture(scope="session")
def forms(agent, tmp_path_factory) -> dict[str, Path]:
    """The shipped agent in the forms that robots are flown by."""
    folder = tmp_path_factory.mktemp("onnx") / "go-to-pose-2d"
    write_export(pretrained_folder("go-to-pose-2d"), folder, "onnx", episodes=0)
    return {"numpy": agent, "onnx": folder}


def shifted(motion: Motion, *by: float) -> Motion:
    return motion._replace(position=motion.position + by)


class Case(NamedTuple):
    rule: str
    fault: Callable[[], Fault] | None = None
    """None: that of the twin which has this name."""
    within: int = 2
    """Control periods until valves are shut."""
    is_of_twists: bool = False
    left_out: tuple[float, ...] = (1e12,) * 4
    behind: tuple[str, ...] = ()
    """Rules that notice it too."""


def sends(change: Callable[[Motion, float, int], Motion]) -> Callable[[], Fault]:
    return lambda: lambda motion, after, number: (change(motion, after, number), 0.0)


CASES = {
    "beyond 100 km": Case(
        "number",
        sends(lambda m, t, k: m._replace(position=m.position * 1e6)),
        behind=("jump", "observation"),
    ),
    "no quaternion": Case(
        "quaternion",
        sends(lambda m, t, k: m._replace(attitude=m.attitude * 0.5)),
        left_out=(0.0, 9.0),
    ),
    "high above": Case("plane", sends(lambda m, t, k: shifted(m, 0, 0, 5.0))),
    # Delays that grow by half a second a second are known as such when they are above the oldest age.
    "slow-link": Case("age", within=4),
    "fast-clock": Case("pace"),
    "two-senders": Case("jump", behind=("observation",)),
    "outliers": Case("jump", behind=("observation",)),
    "frozen": Case("still"),
    "no-twist": Case("twist", is_of_twists=True, behind=("still",)),
    "dead": Case("age"),
}


def flown(folder: Path, robot: RobotName, fault: Fault, periods: int = 13) -> list[Decision]:
    """Decisions of a flight against the twin, without noise, in virtual time."""
    pilot = MessagePilot(plan(folder, robot=robot), GoToPose())
    platform = load_spacecraft("floating-platform")
    craft = Craft(TwinPlan(platform, PERIOD, rate=RATE, start=(2.0, 1.0, 40.0)))
    found = []
    now = NOW
    for k in range(periods):
        for number in range((k - BEGIN) * STEPS, (k - BEGIN + 1) * STEPS):
            now = NOW + number * SECOND // RATE
            motion: Motion | None = craft.motion
            off = 0.0
            if number >= 0:
                motion, off = fault(craft.motion, number / RATE, number)
            if motion is not None:
                for one in pilot.interface.state(motion, now + round(off * SECOND)):
                    pilot.receive(one.topic, one.data, now)
            craft.advance()
        decision = pilot.decide(now + SECOND // 100)
        craft.hold(decision.command)
        found.append(decision)
    return found


def leave_out(monkeypatch: pytest.MonkeyPatch, rule: str, limits: tuple[float, ...]) -> None:
    monkeypatch.setitem(RULES, rule, RULES[rule]._replace(limits=limits[: len(RULES[rule].limits)]))
    if rule == "age":
        monkeypatch.setattr(
            "rans_robot.pilot.read_contract",
            lambda folder: read_contract(folder) | {"readings": {"oldest": 1e6}},
        )


@pytest.mark.parametrize(
    ("name", "robot", "form"),
    [
        (name, robot, form)
        for name, case in CASES.items()
        for robot in ROBOTS
        for form in (("numpy", "onnx") if robot == "px4" else ("numpy",))
        if (Interface(robot, 8, 8).has_velocity and robot != "pose") or not case.is_of_twists
    ],
)
def test_a_fault_shuts_the_valves(name, robot, form, forms):
    case = CASES[name]
    decisions = flown(forms[form], robot, (case.fault or FAULTS[name])())
    assert all(opened(decisions)[: BEGIN - 1])
    assert not any(opened(decisions)[BEGIN + case.within :])
    assert all(decision.note for decision in decisions[BEGIN + case.within :])


@pytest.mark.parametrize("name", CASES)
def test_without_its_rule_a_fault_is_flown(name, forms, monkeypatch):
    """By the form that has no rules of its own."""
    case = CASES[name]
    leave_out(monkeypatch, case.rule, case.left_out)
    for rule in case.behind:
        leave_out(monkeypatch, rule, (1e12,) * 4)
    robot: RobotName = "ros" if case.is_of_twists else "pose"
    assert any(
        opened(flown(forms["onnx"], robot, (case.fault or FAULTS[name])()))[BEGIN + case.within :]
    )


# What an agent observes, and what it answers


def decided(folder: Path, motion: Motion = AWAY, **changes: Any) -> Decision:
    """The decision on one motion."""
    pilot = MessagePilot(plan(folder, **changes), GoToPose())
    if "agent" in changes:
        pilot.agent = changes["agent"]
    for one in pilot.interface.state(motion, NOW):
        pilot.receive(one.topic, one.data, NOW)
    return pilot.decide(NOW)


IMPOSSIBLE = {
    "50 km": shifted(AWAY, 5e4, 0, 0),
    "90 m/s": AWAY._replace(velocity=np.array([90.0, 0, 0])),
    "90 rad/s": AWAY._replace(spin=np.array([0, 0, 90.0])),
}


@pytest.mark.parametrize("motion", IMPOSSIBLE)
@pytest.mark.parametrize("form", ["numpy", "onnx"])
def test_what_a_contract_refuses_is_not_flown_in_any_form(form, motion, forms, monkeypatch):
    decision = decided(forms[form], IMPOSSIBLE[motion])
    assert not decision.command.any()
    assert "which is no reading" in decision.note
    leave_out(monkeypatch, "observation", (1e12,))
    monkeypatch.setattr("rans_robot.pilot.exported_agent", lambda _: Always(PUSH))
    assert decided(forms[form], IMPOSSIBLE[motion]).command.any()


@pytest.mark.parametrize(
    "answer", [PUSH * 1.01, PUSH * np.nan, -PUSH, [1.0] * 9, [[1.0] * 8], [], 1.0]
)
def test_a_command_that_is_none_shuts(answer, agent, monkeypatch):
    monkeypatch.setattr("rans_robot.pilot.exported_agent", lambda _: Always(answer))
    decision = decided(agent)
    assert not decision.command.any()
    assert "the command is" in decision.note
    leave_out(monkeypatch, "command", (1e12,))
    if np.shape(answer) == (8,) and np.isfinite(answer).all():
        monkeypatch.setattr("rans_robot.pilot.exported_agent", lambda _: Always(answer))
        assert decided(agent).command.any() == (max(answer) > 0.0)


NUMBERS = [0.0, -1.0, 1e6, float("nan"), float("inf"), None, "1"]


def numbers_in(value: Any, *path: Any) -> Iterator[tuple[Any, ...]]:
    """Paths of all numbers in a table."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        yield path
    if isinstance(value, dict | list):
        for key, one in value.items() if isinstance(value, dict) else enumerate(value):
            yield from numbers_in(one, *path, key)


def is_wider(folder: Path, contract: dict[str, Any], own: dict[str, Any]) -> bool:
    """Whether a monitor with a contract lets through what it refuses with the agent's own."""
    craft = load_spacecraft(folder / "spacecraft.toml")
    interface = Interface("ros", craft.command_count, craft.thruster_count)
    monitor = Monitor(craft, contract, interface, plan(folder))
    beyond = [column["refused"] for column in own["observation"]]
    rows = [np.zeros(len(beyond)) for _ in range(2 * len(beyond))]
    for k, row in enumerate(rows):
        # 1e-3 of a range is more than float32 rounds.
        low, high = beyond[k // 2]
        row[k // 2] = low - 1e-3 * (high - low) if k % 2 else high + 1e-3 * (high - low)
    for judge, value in [
        *((monitor.observed, row) for row in rows),
        (monitor.commanded, 1.01 * PUSH),
    ]:
        try:
            judge(value)
        except ValueError:
            continue
        return True
    return monitor.oldest > own["readings"]["oldest"] or monitor.period != own["control_period"]


@pytest.mark.parametrize("value", NUMBERS)
def test_no_number_of_a_contract_widens_a_limit(value, agent, tmp_path):
    """Each number that it has, set to 0, to its opposite, 1e6 times as large or to no number."""
    own = read_contract(agent)
    (tmp_path / "spacecraft.toml").write_bytes((agent / "spacecraft.toml").read_bytes())
    refused = set()
    for path in numbers_in(own):
        about = json.loads(json.dumps(own))
        *within, key = path
        table = reduce(getitem, within, about)
        table[key] = table[key] * value if isinstance(value, float) else value
        if table[key] == reduce(getitem, path, own):  # as 0 times 0
            continue
        (tmp_path / "contract.json").write_text(json.dumps(about))
        try:
            read = read_contract(tmp_path)
        except ConfigError:
            refused.add(path[:2])
            continue
        assert not is_wider(tmp_path, read, own), path
    assert {("control_period",), ("readings", "oldest")} <= refused


@pytest.mark.parametrize("value", NUMBERS)
@pytest.mark.parametrize("name", ["goal", "pose_noise", "lost_after", "wait"])
def test_no_number_of_a_plan_opens_a_valve(name, value, agent, monkeypatch):
    monkeypatch.setattr("rans_robot.pilot.exported_agent", lambda _: Always(PUSH))
    several = {"goal": (1.0, 1.0, 30.0), "pose_noise": (0.002, 0.005)}
    ours: Any = several.get(name, (1.0,))
    changed = tuple(x * value if isinstance(value, float) else value for x in ours)
    planned: Any = {name: changed if name in several else changed[0]}
    if not (name == "goal" and value in (0.0, -1.0, 1e6)) and not (
        value == 1e6 and name in ("lost_after", "wait")
    ):
        with pytest.raises(ConfigError, match=name):
            plan(agent, **planned)
        return
    flight = plan(agent, **planned)
    # What is impossible, and what is too old, shuts.
    for motion, late in ((IMPOSSIBLE["50 km"], 0), (AWAY, 3 * SECOND)):
        pilot = MessagePilot(flight, GoToPose())
        for one in pilot.interface.state(motion, NOW):
            pilot.receive(one.topic, one.data, NOW)
        assert not pilot.decide(NOW + late).command.any()


@pytest.mark.parametrize("is_left_out", [False, True])
def test_what_waited_in_a_link_is_dropped(is_left_out, monkeypatch):
    """Fifteen commands come at once when a link goes on after 3 s, and then new ones."""
    if is_left_out:
        leave_out(monkeypatch, "link", (1e9,))
    sent = [NOW + k * SECOND // 5 for k in range(40)]
    came = [max(when, sent[25]) if k >= 10 else when for k, when in enumerate(sent)]
    monkeypatch.setattr("rans_robot.monitor.time.monotonic_ns", iter(came).__next__)
    link = Link()
    fresh = [link.is_fresh(when) for when in sent]
    # Those of the last half second are no older than what a twin holds.
    assert fresh == [is_left_out or not 10 <= k < 23 for k in range(40)]


# The time to decide


class Hanging(Always):
    """An agent that takes a second for its fourth decision."""

    def act(self, observation: np.ndarray) -> np.ndarray:
        if self.calls == 3:
            time.sleep(1.0)
        return super().act(observation)


@pytest.mark.parametrize("ends", ["goes on", "is stopped"])
def test_valves_are_shut_while_an_agent_hangs(ends, agent, tmp_path, monkeypatch):
    """Within half a period of when it was due, and also when the flight is stopped meanwhile."""
    monkeypatch.setattr("rans_robot.pilot.exported_agent", lambda _: Hanging(PUSH))
    monkeypatch.setattr("rans_robot.node._warm_up", lambda _: None)
    leave_out(monkeypatch, "still", (1e12,))  # this robot does not move
    ends_at = Interface("ros", 8, 8)
    wire = Wire()
    times: list[tuple[float, bool]] = []
    stop = threading.Event()

    def take(data: bytes) -> None:
        times.append((time.monotonic(), any(unpack(FLOATS, data).data)))
        if ends == "is stopped" and len([one for one in times if one[1]]) == 3:
            threading.Timer(0.25, stop.set).start()

    wire.subscribe("commands", FLOATS, take)

    def publish() -> None:
        while not stop.wait(0.02):
            for message in ends_at.state(AWAY, time.time_ns()):
                wire.publish(*message)

    robot = threading.Thread(target=publish)
    robot.start()
    bag = tmp_path / "flight.mcap"
    try:
        report = fly_over(wire, plan(agent), bag, 3.0, lambda _: None, stop.is_set)
    finally:
        stop.set()
        robot.join()
    was_open = [moment for moment, is_open in times if is_open]
    shut = next(moment for moment, is_open in times if not is_open and moment > was_open[2])
    # A period, half a period, and what a busy machine adds.
    assert shut - was_open[2] < 0.3 + 0.25
    assert not times[-1][1]
    if ends == "goes on":
        assert len(was_open) > 4
        assert sum("after it was due" in note for note in report.notes) == 1
        again = replay_bag(bag)
        assert again.equal == again.decisions == report.decisions
    else:
        assert len(was_open) == 3


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["frozen", "two-senders", "fast-clock", "dead"])
@pytest.mark.parametrize("name", ["udp", "dds", "zenoh"])
def test_a_fault_shuts_the_valves_over_every_bus(name, fault, agent, monkeypatch):
    """The twin in a thread; a flight ends a second after readings contradict one another."""
    pytest.importorskip({"dds": "cyclonedds", "zenoh": "zenoh"}.get(name, "rosbags"))
    monkeypatch.setenv("ROS_DOMAIN_ID", "46")
    names = [name, name]
    if name == "zenoh":
        names = ["zenoh:listen/tcp/127.0.0.1:17746", "zenoh:tcp/127.0.0.1:17746"]
    ends = [*map(open_bus, names)]
    opened: list[tuple[float, bool]] = []
    stop = threading.Event()
    platform = load_spacecraft("floating-platform")
    other = TwinPlan(platform, PERIOD, start=(3.0, 1.0, 10.0), rate=RATE, fault=f"{fault}:3")
    begun = time.monotonic()
    twin = threading.Thread(target=run_twin, args=(ends[0], other, lambda _: None, stop.is_set))
    publish = ends[1].publish

    def sent(topic: str, kind: str, data: bytes) -> None:
        if kind == FLOATS:
            opened.append((time.monotonic(), any(unpack(FLOATS, data).data)))
        publish(topic, kind, data)

    ends[1].publish = sent  # type: ignore[method-assign]
    twin.start()
    try:
        report = fly_over(ends[1], plan(agent), None, 10.0, lambda _: None)
    finally:
        stop.set()
        twin.join()
        for one in ends:
            one.close()
    assert report.fault
    was_open = [moment - begun for moment, is_open in opened if is_open]
    # Two periods after the fault, and what warming up the twin and a busy machine add.
    assert 1.0 < was_open[-1] < 3.0 + 0.4 + 2.0
    assert not any(is_open for _, is_open in opened[-3:])


def test_the_page_has_the_table():
    page = (ROOT / "packages/robot/docs/robots.md").read_text("utf-8")
    begin = page.index("| judged |")
    rows = [
        f"| {rule.asks} | {rule.text.format(*rule.limits)} | {rule.tighter} | {rule.does} |"
        for rule in RULES.values()
    ]
    assert page[begin:].split("\n\n")[0].splitlines()[2:] == rows


FILES = {"bag", "logs", "messages"}
"""Modules that refuse damaged files and bytes, before there is a reading or a command."""
BOUNDS = {"LARGEST", "LONGEST_PERIOD", "OLDEST", "command_bounds"}
"""What limits are made of."""


def rules_in(name: str, source: str) -> list[str]:
    """What a module other than the monitor judges or opens itself."""
    found = []
    for node in ast.walk(ast.parse(source)):
        match node:
            # A reading or a command is refused by a ValueError; what a user asks for, by a ConfigError.
            case ast.Raise(exc=ast.Name("ValueError") | ast.Call(func=ast.Name("ValueError"))):
                found += ["refuses"] * (name not in FILES)
            case ast.ImportFrom(module="rans.evaluation.fly.exported" | "rans.effectors.commands"):
                found += [alias.name for alias in node.names if alias.name in BOUNDS]
            case ast.Assign(targets=targets) if any("RULES" in ast.unparse(t) for t in targets):
                found.append("sets a limit")
            # Other messages have a topic of their own; the twin is the robot's end of the bus.
            case ast.Call(func=ast.Attribute(attr="publish"), args=[ast.Starred()]):
                found += ["commands"] * (name not in {"valves", "twin"})
    return found


def test_no_rule_stands_elsewhere():
    room = ROOT / "packages/robot/rans_robot"
    found = {
        path.relative_to(room): rules_in(path.stem, path.read_text("utf-8"))
        for path in room.rglob("*.py")
    }
    # The search itself sees what the monitor has.
    assert set(found.pop(Path("monitor.py"))) == {"refuses", "sets a limit", *BOUNDS}
    assert {path: rules for path, rules in found.items() if rules} == {}


@pytest.mark.parametrize(
    "planted",
    [
        "if age > 2.0:\n    raise ValueError('stale')",
        "from rans.evaluation.fly.exported import OLDEST",
        "RULES['age'] = RULES['age']._replace(limits=(1e9, 3))",
        "bus.publish(*message)",
    ],
)
def test_a_rule_elsewhere_is_found(planted):
    assert rules_in("pilot", planted)
