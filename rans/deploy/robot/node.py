"""``rans fly``: an agent at its control rate over a bus, recorded, and the same commands again from its bag."""

from __future__ import annotations

import gc
import json
import queue
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from rans.deploy.robot.bag import BagWriter, Entry, entries
from rans.deploy.robot.bus import Bus
from rans.deploy.robot.frames import Motion
from rans.deploy.robot.interfaces import Message
from rans.deploy.robot.messages import TEXT, make, pack, unpack
from rans.deploy.robot.pilot import AGENT_TOPIC, NOTE_TOPIC, Decision, Pilot, Plan, craft_hash
from rans.errors import ConfigError, brief, positive
from rans.files import parse_json, read_json
from rans.structure import structure
from rans.tasks import TASKS, Task

FLIGHT_TOPIC = "rans/flight"
"""First message of a bag: the plan, as JSON."""
END_TOPIC = "rans/end"
"""Last message of a bag before the valves are shut: why, "" where the time was up."""
_LAST_WORDS = 3
"""Times that the valves are shut at the end of a flight, should a message be lost."""
_ANNOUNCED = 1.0
"""s between two messages that say who flies."""


@dataclass
class Report:
    """How a flight went."""

    decisions: int = 0
    """Control periods."""
    missed: int = 0
    """Control periods whose command went out after the next one had begun."""
    computed: list[float] = field(default_factory=list)
    """s from the beginning of each decision until its command was sent."""
    used: list[float] = field(default_factory=list)
    """s of the processor's time for the same: on a busy machine the other one counts waiting for it too."""
    late: list[float] = field(default_factory=list)
    """s from when a decision was due until it began."""
    notes: list[str] = field(default_factory=list)
    """What was said, each once in a row."""
    guarded: int | None = None
    """Control periods in which the safety filter replaced the agent's command; None: there was no filter."""
    fault: str = ""
    """Why the flight ended before its time; "" where it did not."""

    def text(self) -> str:
        """In a sentence."""
        if not self.computed:
            return "no control period was flown."
        of = np.array(self.computed) * 1e3
        used = np.array(self.used) * 1e3
        late = np.array(self.late) * 1e3
        replaced = (
            ""
            if self.guarded is None
            else f", in {self.guarded} of which the safety filter replaced the command"
        )
        return (
            f"{self.decisions} control periods{replaced}, {self.missed} missed; computation median "
            f"{np.median(of):.2f} ms, 99 % below {np.percentile(of, 99):.2f} ms, largest {of.max():.2f} ms "
            f"(of the processor's time 99 % below {np.percentile(used, 99):.2f} ms); begun at most "
            f"{late.max():.1f} ms late."
        )


def fly_over(
    bus: Bus,
    plan: Plan,
    bag: Path | None = None,
    seconds: float | None = None,
    say: Callable[[str], None] = print,
    stopped: Callable[[], bool] = lambda: False,
) -> Report:
    """Fly an agent over a bus until its time is up, it is stopped or something is wrong; valves are shut then.

    Args:
        bus: see `rans.deploy.robot.bus.open_bus`; it stays open.
        plan: what to fly.
        bag: file of the bag; None: nothing is recorded.
        seconds: length of the flight; None: until it is stopped.
        say: takes each sentence.
        stopped: whether somebody wants the flight to end.

    Raises:
        ConfigError: the length is not above 0, or see `Pilot` and `BagWriter`.
    """
    if seconds is not None:
        positive("--seconds", seconds)
    pilot = Pilot(plan, planned_task(plan))
    _warm_up(Pilot(plan, planned_task(plan)))
    writer = None if bag is None else BagWriter(bag)
    report = Report(guarded=0 if plan.guard else None)
    inbox: queue.SimpleQueue[tuple[int, str, bytes]] = queue.SimpleQueue()
    offset = time.time_ns() - time.monotonic_ns()
    last = 0

    def record(moment: int, topic: str, kind: str, data: bytes) -> None:
        if writer is not None:
            writer.write(Entry(moment, topic, kind, data))

    def unique(moment: int) -> int:
        # What came and what was decided at different times differ in the bag too.
        nonlocal last
        last = max(last + 1, moment + offset)
        return last

    def take(patience: float) -> None:
        try:
            came, topic, data = inbox.get(timeout=patience)
        except queue.Empty:
            return
        moment = unique(came)
        record(moment, topic, pilot.inputs[topic], data)
        pilot.receive(topic, data, moment)

    def tell(note: str) -> None:
        if note and (not report.notes or report.notes[-1] != note):
            report.notes.append(note)
            say(note)

    def send(decision: Decision, moment: int) -> None:
        for message in pilot.messages(decision, moment):
            bus.publish(*message)
            record(moment, *message)

    if writer is not None:
        known = {**pilot.inputs, **pilot.interface.outputs, NOTE_TOPIC: TEXT, END_TOPIC: TEXT}
        for topic, kind in known.items():
            writer.declare(topic, kind)
    begins = unique(time.monotonic_ns())
    about = asdict(plan)
    record(begins, FLIGHT_TOPIC, TEXT, pack(TEXT, make(TEXT, data=json.dumps(about))))
    announcement = {
        "sha256": craft_hash(pilot.craft),
        "control_period": pilot.period,
        "agent": pilot.contract["agent"],
    }
    announced = pack(TEXT, make(TEXT, data=json.dumps(announcement)))
    for topic, kind in pilot.inputs.items():
        bus.subscribe(
            topic, kind, lambda data, topic=topic: inbox.put((time.monotonic_ns(), topic, data))
        )
    collected = gc.isenabled()
    gc.collect()
    gc.disable()
    period = round(pilot.period * 1e9)
    due = time.monotonic_ns()
    end = None if seconds is None else due + round(seconds * 1e9)
    next_announcement = due
    try:
        while not stopped() and (end is None or due < end):
            # What comes is taken as it comes, until a decision is due.
            while (left := due - time.monotonic_ns()) > 0:
                take(left * 1e-9)
            for _ in range(inbox.qsize()):
                take(0.0)
            began = time.monotonic_ns()
            used = time.thread_time_ns()
            moment = unique(time.monotonic_ns())
            decision = pilot.decide(moment)
            send(decision, moment)
            sent = time.monotonic_ns()
            report.decisions += 1
            if report.guarded is not None:
                report.guarded += decision.guarded
            report.computed.append((sent - began) * 1e-9)
            report.used.append((time.thread_time_ns() - used) * 1e-9)
            report.late.append((began - due) * 1e-9)
            report.missed += sent > due + period
            tell(decision.note)
            if writer is not None:
                writer.flush()
            if sent >= next_announcement:
                bus.publish(AGENT_TOPIC, TEXT, announced)
                next_announcement = sent + round(_ANNOUNCED * 1e9)
            if decision.over:
                report.fault = decision.note
                break
            gc.collect(0)
            due += period
            while due + period < time.monotonic_ns():  # what was missed is not made up for
                due += period
                report.missed += 1
    finally:
        if collected:
            gc.enable()
        record(
            unique(time.monotonic_ns()), END_TOPIC, TEXT, pack(TEXT, make(TEXT, data=report.fault))
        )
        shut = Decision(np.zeros(len(pilot.craft.commands)))
        for _ in range(_LAST_WORDS):
            send(shut, unique(time.monotonic_ns()))
            time.sleep(0.002)
        if writer is not None:
            writer.close()
    return report


def _warm_up(pilot: Pilot) -> None:
    """Decide a few times on states that never were: what is computed first takes a hundred times as long."""
    still = np.zeros(3)
    attitude = np.array([1.0, 0.0, 0.0, 0.0])
    for k in range(1, 20):
        now = k * round(pilot.period * 1e9)
        for message in pilot.interface.state(Motion(still, attitude, still, still), now):
            pilot.receive(message.topic, message.data, now)
        decision = pilot.decide(now)
        pilot.messages(decision._replace(note="warm"), now)


def planned_task(plan: Plan) -> Task:
    """Task of a plan."""
    settings = plan.task
    try:
        return structure(settings["settings"], TASKS[settings["name"]], "settings")
    except KeyError as error:
        raise ConfigError(f"the task of a flight has no {error}.") from error


@dataclass(frozen=True)
class Replay:
    """What came out of a bag again."""

    decisions: int
    """Commands of the bag."""
    equal: int
    """Commands that the replay gave again, bit for bit."""
    first_difference: int | None
    """Number of the first command that differs; None: all are equal."""


def replay(bag: Path, folder: Path | None = None) -> Replay:
    """Give the messages of a bag to its agent again, at their times, and compare every command.

    Args:
        bag: file that `fly_over` wrote; it may end anywhere.
        folder: of the exported agent; None: the one that flew.

    Raises:
        ConfigError: the file is no bag of a flight, or the agent is not there.
    """
    stream = entries(bag)
    first = next(stream, None)
    if first is None or first.topic != FLIGHT_TOPIC:
        raise ConfigError(f"{bag} is no bag of rans fly: it does not begin with {FLIGHT_TOPIC}.")
    plan = _plan_of(bag, first, folder)
    pilot = Pilot(plan, planned_task(plan))
    outputs = pilot.interface.outputs
    decisions = 0
    equal = 0
    difference = None
    moment = None
    recorded: list[Message] = []

    def compare() -> None:
        """Compare the command that was recorded last, all of whose messages have come."""
        nonlocal decisions, equal, difference
        if moment is None:
            return
        decision = pilot.decide(moment)
        again = [one for one in pilot.messages(decision, moment) if one.topic in outputs]
        if again == recorded:
            equal += 1
        elif difference is None:
            difference = decisions
        decisions += 1

    for entry in stream:
        if entry.topic in outputs:
            if entry.time != moment:
                compare()
                moment = entry.time
                recorded = []
            recorded.append(Message(entry.topic, entry.kind, entry.data))
            continue
        compare()
        moment = None
        if entry.topic == END_TOPIC:
            break
        if entry.topic in pilot.inputs:
            pilot.receive(entry.topic, entry.data, entry.time)
    else:
        # The process was ended while it wrote: its last command may not be whole.
        if len(recorded) == len(outputs):
            compare()
    return Replay(decisions, equal, difference)


def _plan_of(bag: Path, first: Entry, folder: Path | None) -> Plan:
    """Plan in the first message of a bag, with another folder of the agent if one is given.

    Raises:
        ConfigError: the message is damaged, or it names the code of a task that is not that of the folder.
    """
    try:
        table = parse_json(unpack(TEXT, first.data).data, f"{bag}, {FLIGHT_TOPIC}")
    except ValueError as error:
        raise ConfigError(
            f"{bag} is damaged: the plan of its flight is no text: {error}."
        ) from error
    plan = structure(table, Plan, f"{bag}, {FLIGHT_TOPIC}")
    if folder is None:
        return plan
    # The user trusts the agent of this folder, and not what a bag calls a task.
    name = plan.task.get("name")
    if isinstance(name, str) and ":" in name:
        own = read_json(folder / "contract.json")
        if not isinstance(own, dict) or own.get("task") != name:
            raise ConfigError(
                f"{bag} names the task {brief(name)}, whose code would run, and the agent in {folder} has another "
                "one; the bag is of another agent."
            )
    return replace(plan, folder=str(folder))
