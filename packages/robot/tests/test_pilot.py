"""Whatever fails around a flight, its last command shuts all valves: disks, terminals, buses, agents, signals."""

from __future__ import annotations

import contextlib
import errno
import gc
import io
import json
import os
import py_compile
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from rans_robot.bag import BagMessage, Recorder, bag_entries
from rans_robot.interfaces import Interface, RobotName
from rans_robot.messages import TEXT, text_message, unpack
from rans_robot.monitor import RULES
from rans_robot.node import END_TOPIC, Inbox, Report, fly_over, planned_task, replay_bag
from rans_robot.pilot import AGENT_TOPIC, MessagePilot, code_of

from rans import ConfigError
from tests.support.processes import PATIENCE
from tests.support.robots import AWAY, Always, Wire, plan

OPEN = np.ones(8)


class Robot(Wire):
    """A bus with a robot, which answers each command with a state and remembers the commands that it took."""

    def __init__(self, robot: RobotName = "ros", fails_at: int = 10**9, fails: int = 1) -> None:
        super().__init__()
        self.ends = Interface(robot, 8, 8)
        self.commands: list[np.ndarray] = []
        self.fails = range(fails_at, fails_at + fails)
        self.attempts = 0

    def publish(self, topic: str, kind: str, data: bytes) -> None:
        self.sent.append((topic, data))
        if topic in self.ends.outputs:
            self.attempts += 1
            if self.attempts in self.fails:
                raise OSError(errno.ENETDOWN, "Network is down")
            command = self.ends.commanded(topic, data)
            if command is not None:
                self.commands.append(command)
        for message in self.ends.state(AWAY, time.time_ns()):
            self.hand_on(message.topic, message.data)


class Disk(io.RawIOBase):
    """A disk on which some writes fail: from one on, only one, or one never returns."""

    def __init__(self, fails: Callable[[int], bool], hangs: bool, error: int) -> None:
        self.writes = 0
        self.fails = fails
        self.hangs = hangs
        self.error = error

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return 0

    def write(self, data: Any) -> int:
        self.writes += 1
        if self.fails(self.writes):
            if self.hangs:
                threading.Event().wait(30.0)
            raise OSError(self.error, os.strerror(self.error))
        return len(data)


class OnDisk(type(Path())):  # type: ignore[misc]
    """Name of a file on such a disk."""

    disk: Disk

    def open(self, *arguments: Any, **named: Any) -> Any:
        return io.BufferedWriter(self.disk, 64)


@pytest.fixture(scope="module")
def quick(agent, tmp_path_factory) -> Path:
    """The agent at 100 Hz."""
    folder = tmp_path_factory.mktemp("quick")
    about = json.loads((agent / "contract.json").read_text("utf-8"))
    about["control_period"] = 0.01
    about["readings"]["oldest"] = 30.0
    (folder / "contract.json").write_text(json.dumps(about), "utf-8")
    (folder / "spacecraft.toml").write_bytes((agent / "spacecraft.toml").read_bytes())
    return folder


@pytest.fixture(autouse=True)
def hasty(monkeypatch) -> None:
    """Other nodes are listened for in no time, disks and terminals waited for; every valve is opened."""
    monkeypatch.setattr("rans_robot.node._ANNOUNCED", 0.001)
    monkeypatch.setattr("rans_robot.node._LAST_SENTENCES", PATIENCE)
    monkeypatch.setattr("rans_robot.bag._PATIENCE", PATIENCE)
    monkeypatch.setattr("rans_robot.pilot.exported_agent", lambda _: Always(OPEN))
    monkeypatch.setattr("rans_robot.node._warm_up", lambda _: None)
    # This machine may do other work.
    for rule, limits in (("time", (1e3,)), ("age", (30.0, 3.0))):
        monkeypatch.setitem(RULES, rule, RULES[rule]._replace(limits=limits))
    monkeypatch.setattr("rans.evaluation.fly.exported.OLDEST", (30.0, 3.0))
    monkeypatch.setattr(gc, "collect", lambda _=2: 0)  # of all that the tests have imported


def flight(
    bus: Robot,
    folder: Path,
    bag: Path | None,
    commands: int = 6,
    say: Callable[[str], None] = lambda _: None,
    **changes: Any,
) -> Report:
    """A flight of so many commands, however long they take."""
    about = plan(folder, lost_after=60.0, **changes)
    return fly_over(bus, about, bag, None, say, lambda: len(bus.commands) >= commands)


# Disks


@pytest.mark.parametrize(
    "robot",
    ["ros", *(pytest.param(one, marks=pytest.mark.slow) for one in ("px4", "roboran", "pingu"))],
)
def test_no_failing_disk_leaves_a_valve_open(robot, quick, tmp_path, monkeypatch):
    """20 flights with disks that are full from some write on, at one write, or hang there."""
    chance = random.Random(robot)
    for number in range(20):
        at = chance.randint(1, 40)
        from_then_on = chance.random() < 0.5
        hangs = number % 10 == 0
        # A disk that hangs is waited for only a moment, but the flight goes on until it does.
        monkeypatch.setattr("rans_robot.bag._PATIENCE", 0.05 if hangs else PATIENCE)
        disk = Disk(
            (lambda k, at=at: k >= at) if from_then_on else (lambda k, at=at: k == at),
            hangs=hangs,
            error=chance.choice([errno.ENOSPC, errno.EIO, errno.EDQUOT, errno.EROFS]),
        )
        file = OnDisk(tmp_path / f"{number}.mcap")
        file.disk = disk
        bus = Robot(robot)
        said = []
        report = fly_over(
            bus,
            plan(quick, lost_after=60.0, robot=robot),
            file,
            None,
            said.append,
            lambda bus=bus, disk=disk, last=at if hangs else 0: (
                len(bus.commands) >= 6 and disk.writes >= last
            ),
        )
        assert any(command.any() for command in bus.commands)
        assert not bus.commands[-1].any()
        assert report.fault == ""  # it went on
        # A disk that failed was said, once.
        failed = disk.writes >= at
        assert sum("the bag" in text for text in said) == failed


def test_no_error_of_bookkeeping_skips_the_shut(quick, tmp_path, monkeypatch):
    """Should the recorder itself raise, at any of its calls, for good."""
    opened = False
    for at in range(1, 40, 3):
        calls = 0

        def write(self, entry, at=at):
            nonlocal calls
            calls += 1
            if calls >= at:
                raise MemoryError

        monkeypatch.setattr(Recorder, "write", write)
        bus = Robot()
        with contextlib.suppress(MemoryError):
            flight(bus, quick, tmp_path / f"{at}.mcap")
        assert not any(command.any() for command in bus.commands[-1:])
        opened = opened or any(command.any() for command in bus.commands)
    assert opened


def test_a_bag_that_cannot_be_begun_is_said_before_the_flight(quick, tmp_path):
    (tmp_path / "file").write_text("", "utf-8")
    for bag in (tmp_path / "file" / "bag.mcap", tmp_path / "file"):
        bus = Robot()
        with pytest.raises(ConfigError, match=r"cannot write|exists already"):
            flight(bus, quick, bag)
        assert not any(command.any() for command in bus.commands)


def test_a_bag_has_a_largest_size(quick, tmp_path, monkeypatch):
    """It ends there, whole, and says so; the flight goes on. Here it is as large after ten commands."""
    bag = tmp_path / "flight.mcap"
    said = []
    bus = Robot()

    def over():
        if len(bus.commands) >= 10:
            monkeypatch.setattr("rans_robot.bag.LARGEST_BAG", 0)
        return len(bus.commands) >= 20

    report = fly_over(bus, plan(quick, lost_after=60.0), bag, None, said.append, over)
    assert report.fault == ""
    assert [text for text in said if "the largest size" in text] != []
    again = replay_bag(bag)
    assert 0 < again.equal == again.decisions < report.decisions
    # Of 30 messages of 125 bytes with what a bag adds, 20 are those 2500 bytes.
    monkeypatch.setattr("rans_robot.bag.LARGEST_BAG", 2500)
    recorder = Recorder(tmp_path / "small.mcap", {})
    for _ in range(30):
        recorder.write(BagMessage(0, "rans/end", TEXT, bytes(94)))
    recorder.close()
    assert len([*bag_entries(tmp_path / "small.mcap")]) == 20


# Terminals, agents and buses


def test_no_wait_for_a_message_is_endless(quick):
    """`queue.SimpleQueue` waits forever once in some 10,000 times, if the time is over before it waits."""
    flying = plan(quick)
    bus = Robot()
    inbox = Inbox(MessagePilot(flying, planned_task(flying)))
    inbox.open(bus)
    topic = "pose"

    def wait():
        for number in range(30_000):
            inbox.refill()
            bus.hand_on(topic, b"")
            assert inbox.next(1.0) is not None
            assert inbox.next(1e-9 + number % 50 * 2e-8) is None

    waits = threading.Thread(target=wait, daemon=True)
    waits.start()
    waits.join(PATIENCE)
    assert not waits.is_alive()


@pytest.mark.parametrize("error", [OSError(errno.EIO, "Input/output error"), ValueError(), None])
def test_a_lost_terminal_does_not_end_a_flight(error, quick, monkeypatch):
    """Nor does one that hangs, as after Ctrl-S: it is not waited for."""
    hangs = threading.Event()
    if error is None:
        monkeypatch.setattr("rans_robot.node._LAST_SENTENCES", 0.05)

    def say(text):
        if error is not None:
            raise error
        hangs.wait(30.0)

    bus = Robot()
    report = flight(bus, quick, None, say=say)
    hangs.set()
    assert report.notes  # it waited for a state
    assert report.fault == ""
    assert any(command.any() for command in bus.commands)
    assert not bus.commands[-1].any()


@pytest.mark.parametrize(
    ("sends", "words"),
    [
        ((), ("pose and twist", "over udp", "domain 7", "running")),
        (("pose",), ("no state came on twist", "only pose came", "--robot ros")),
    ],
)
@pytest.mark.parametrize("ends_by", ["time", "interrupt"])
def test_a_flight_without_a_state_is_a_fault(sends, words, ends_by, quick, tmp_path, monkeypatch):
    """Its time is up, or it is stopped, long before it gives the robot up.

    2 ms pass whenever it looks at the clock: in 0.2 s it decides several times on any machine.
    """
    clock = SimpleNamespace(**vars(time))
    clock.monotonic_ns = count(0, 2_000_000).__next__
    monkeypatch.setattr("rans_robot.node.time", clock)

    class Deaf(Robot):
        def hand_on(self, topic: str, data: bytes) -> None:
            if topic in sends:
                super().hand_on(topic, data)

    bus = Deaf()
    bag = tmp_path / "flight.mcap"
    said = []
    report = fly_over(
        bus,
        plan(quick, wait=60.0),
        bag,
        0.2 if ends_by == "time" else None,
        said.append,
        lambda: ends_by == "interrupt" and len(bus.commands) >= 5,
        "udp (domain 7)",
    )
    assert report.decisions > 0
    assert not np.any(bus.commands)
    assert all(word in report.fault for word in words)
    assert said[-1] == report.fault
    # The bag says it too.
    last = [entry for entry in bag_entries(bag) if entry.topic == END_TOPIC]
    assert [unpack(TEXT, entry.data).data for entry in last] == [report.fault]


def test_an_agent_that_fails_shuts_the_valves(quick, monkeypatch):
    for at in range(3):
        monkeypatch.setattr("rans_robot.pilot.exported_agent", lambda _, at=at: Always(OPEN, at))
        bus = Robot()
        with pytest.raises(MemoryError):
            flight(bus, quick, None)
        assert len(bus.commands) >= at
        assert not bus.commands[-1].any()


@pytest.mark.parametrize("robot", ["ros", "px4"])
def test_a_bus_that_fails_is_tried_again(robot, quick):
    """A message that is not taken ends the flight; of the last ones each is tried by itself."""
    for at in range(1, 14):
        bus = Robot(robot, fails_at=at)
        with contextlib.suppress(OSError):
            flight(bus, quick, None, 8, robot=robot)
        assert not bus.commands[-1].any()
    said = []
    with pytest.raises(OSError, match="Network is down"):
        flight(Robot(robot, fails_at=4, fails=1000), quick, None, 100, said.append, robot=robot)
    assert "the robot's watchdog must do it" in said[-1]


# Signals

_ENDED = """
import importlib.util, os, resource, signal, sys
spec = importlib.util.spec_from_file_location("signals", "packages/robot/rans_robot/signals.py")
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
handled = len(sys.argv) > 1
stop = module.stop_on_signals() if handled else None
ended = []
for number in sorted(signal.valid_signals()):
    child = os.fork()
    if child == 0:
        os.kill(os.getpid(), number)
        os._exit(7 if handled and stop.is_set() else 0)
    _, status = os.waitpid(child, os.WUNTRACED)
    if os.WIFSTOPPED(status):
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    how = os.WIFSIGNALED(status) or os.WIFSTOPPED(status)
    ended.append((int(number), "ended" if how else str(os.WEXITSTATUS(status))))
print(ended)
"""


def _signals(*arguments: str, begin: str = "") -> dict[int, str]:
    text = subprocess.run(
        [sys.executable, "-c", begin + _ENDED, *arguments],
        cwd=Path(__file__).parents[3],
        capture_output=True,
        text=True,
        check=True,
        timeout=PATIENCE,
    ).stdout
    return dict(eval(text))  # a list of our own


def test_every_signal_that_ends_a_process_ends_a_flight():
    """Against the system: of each signal what it does to a process that does not catch it."""
    without = _signals()
    caught = _signals("handled")
    uncatchable = {signal.SIGKILL, signal.SIGSTOP}
    faulty = {signal.SIGSEGV, signal.SIGBUS, signal.SIGFPE, signal.SIGILL}
    background = {signal.SIGTTIN, signal.SIGTTOU}
    for number, what in without.items():
        # Python makes an exception of SIGINT, and the system stops no process of an orphaned group at SIGTSTP.
        ends = what == "ended" or number in {signal.SIGINT, signal.SIGTSTP}
        if number in uncatchable | faulty:
            assert caught[number] == "ended"
        elif number in background:
            assert caught[number] == "0"  # a flight goes on without the terminal
        else:
            assert caught[number] == ("7" if ends else "0"), signal.Signals(number).name
    # As nohup begins a process.
    begin = "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)"
    assert _signals("handled", begin=begin)[signal.SIGHUP] == "0"


# Other nodes, and strangers


def announcement(node: str, topics: list[str]) -> bytes:
    return text_message(json.dumps({"agent": "another", "topics": topics, "node": node}))


def test_a_second_node_refuses(quick, monkeypatch):
    """The first is heard of; a node of another robot is none of its business."""
    monkeypatch.setattr("rans_robot.node._ANNOUNCED", 0.1)
    done = threading.Event()
    first = Robot()
    second = Robot()
    said = []
    reports = []

    # Each hears what the other publishes, and itself.
    for one in (first, second):

        def publish(topic, kind, data, one=one):
            Robot.publish(one, topic, kind, data)
            if topic == AGENT_TOPIC:
                for robot in (first, second):
                    robot.hand_on(topic, data)

        one.publish = publish  # type: ignore[method-assign]
    about = plan(quick, lost_after=60.0)
    thread = threading.Thread(
        target=lambda: reports.append(fly_over(first, about, None, None, said.append, done.is_set))
    )
    thread.start()
    try:
        while not first.commands:
            time.sleep(0.01)
        # The second looks 2,200 times, also where this machine stops the first for seconds.
        clock = SimpleNamespace(**vars(time) | {"monotonic": count(0.0, 1e-4).__next__})
        with monkeypatch.context() as patch:
            patch.setattr("rans_robot.node.time", clock)
            with pytest.raises(ConfigError, match="another node commands this robot, with the"):
                flight(second, quick, None)
        heard = first.count("commands")
        while first.count("commands") < heard + 2:
            time.sleep(0.01)
    finally:
        done.set()
        thread.join()
    assert second.commands == []
    assert reports[0].fault == ""
    assert sum("another node commands this robot" in text for text in said) == 1
    monkeypatch.setattr("rans_robot.node._ANNOUNCED", 0.001)

    alone = Robot()
    other = announcement("other", ["fmu/in/actuator_motors"])
    alone.publish = lambda *message: (  # pyrefly: ignore[bad-assignment]
        Robot.publish(alone, *message),  # pyrefly: ignore[bad-argument-type]
        alone.hand_on(AGENT_TOPIC, other),
    )  # type: ignore[method-assign,assign]
    assert not any("another node" in note for note in flight(alone, quick, None).notes)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"nonsense",
        text_message("[" * 4000),
        text_message("{}"),
        text_message('{"agent": 1, "topics": ["commands"]}'),
        text_message('{"agent": "a", "topics": {"commands": 1}}'),
        text_message('{"agent": "a", "topics": [["commands"]]}'),
        text_message("x" * 100_000),
    ],
)
def test_strangers_do_not_keep_a_node_from_flying(data, quick):
    bus = Robot()
    bus.publish = lambda *message: (Robot.publish(bus, *message), bus.hand_on(AGENT_TOPIC, data))  # type: ignore[method-assign,assign]
    flight(bus, quick, None)
    assert any(command.any() for command in bus.commands)


def test_a_flood_is_bounded(quick, tmp_path):
    """10,000 messages before each decision, and large ones: neither memory nor the bag grow with them."""
    bag = tmp_path / "flight.mcap"
    said = []
    bus = Robot()
    pose = bus.ends.state(AWAY, time.time_ns())[-1].data
    large = text_message("x" * 60_000)

    def publish(*message):
        Robot.publish(bus, *message)
        if message[0] == "commands":
            for _ in range(10_000):
                bus.hand_on("pose", pose)
            bus.hand_on("rans/craft", large)

    bus.publish = publish  # type: ignore[method-assign]
    report = flight(bus, quick, bag, 6, said.append)
    assert any("pose: more than 2,000 messages a second" in text for text in said)
    assert any("rans/craft: a message has 60," in text for text in said)
    kept = [entry for entry in bag_entries(bag) if entry.topic == "pose"]
    # 2,000 a second of 0.01 s are 20 a control period.
    assert len(kept) <= 20 * (report.decisions + 1)
    assert not bus.commands[-1].any()


def test_what_is_trusted_is_the_text_that_lies_there(tmp_path):
    """A `__pycache__` beside it, which nobody reads, would be imported in its place."""
    file = tmp_path / "agent.py"
    file.write_text("value = 'evil'\n")
    unchecked = py_compile.PycInvalidationMode.UNCHECKED_HASH
    py_compile.compile(str(file), invalidation_mode=unchecked)
    assert list((tmp_path / "__pycache__").iterdir())
    file.write_text("value = 'mine'\n")
    assert code_of(file).value == "mine"
    file.write_text("import sys\nsys.exit(0)\n")
    with pytest.raises(ConfigError, match="cannot be loaded: SystemExit"):
        code_of(file)
