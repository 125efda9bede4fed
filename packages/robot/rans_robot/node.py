"""``rans fly``: an agent at its control rate over a bus, recorded, and the same commands again from its bag.

It owns clock, bus and disk, and leaves every decision to `rans_robot.pilot`; whatever fails, valves are shut first.
"""

from __future__ import annotations

import contextlib
import gc
import json
import math
import queue
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rans import TASKS
from rans.base.registry import are_files_trusted
from rans.extend import QUANTITIES, ConfigError, Task, brief, positive, read_contract, structure
from rans_robot.bag import BagMessage, Recorder, bag_entries
from rans_robot.bus import Bus
from rans_robot.frames import Motion
from rans_robot.interfaces import Message
from rans_robot.messages import TEXT, read_table, text_message
from rans_robot.monitor import RULES, announced
from rans_robot.pilot import AGENT_TOPIC, NOTE_TOPIC, MessagePilot, Plan, craft_hash, runs_code
from rans_robot.valves import Valves

FLIGHT_TOPIC = "rans/flight"
"""First message of a bag: the plan, as JSON."""
END_TOPIC = "rans/end"
"""Last message of a bag before the valves are shut: why, "" where the time was up."""
LATE_TOPIC = "rans/late"
"""Before a command in a bag: s by which the agent's own was too late, so that the valves were shut in its place."""
_ANNOUNCED = 0.25
"""s between two messages that say who flies."""
_PATIENCE = 0.05
"""s after which a flight that waits for messages asks whether it was stopped."""
_MOST_SENTENCES = 100
"""Sentences that may wait for a terminal."""
_LAST_SENTENCES = 2.0
"""s that the end of a flight waits for a terminal, once the valves are shut."""


@dataclass
class Report:
    """Result of a flight."""

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
    errors: dict[str, float] = field(default_factory=dict)
    """Errors of the task at the last decision, SI units, by name."""
    next_commands: tuple[str, ...] = ()
    """Commands that a user may want to run next."""
    fault: str = ""
    """Why the flight ended before its time, or was none, since no state ever came; else ""."""

    def text(self) -> str:
        """The result as a sentence: periods, and how long decisions took (ms)."""
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
        displays = {name: q.display for name, q in QUANTITIES.items() if name in self.errors}
        ended = [
            f"{name} {factor * self.errors[name]:.3g} {unit}"
            for name, (factor, unit) in displays.items()
        ]
        goal = f"Errors at the end: {', '.join(ended)}. " if ended else ""
        return (
            f"{goal}{self.decisions} control periods{replaced}, {self.missed} missed; computation median "
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
    link: str = "",
) -> Report:
    """Fly an agent over a bus until its time is up, it is stopped or something is wrong; valves are shut then.

    A flight to which no state ever came is a fault, also where its time was up or it was stopped.
    Before the first command it listens for another node that commands the same robot. What is written down of the
    flight, the bag and what is said, cannot end it: a flight goes on without a bag, and says so.

    Args:
        bus: see `rans_robot.bus.open_bus`; it stays open.
        plan: what to fly.
        bag: file of the bag; None: nothing is recorded.
        seconds: length of the flight; None: until it is stopped.
        say: takes each sentence.
        stopped: whether somebody wants the flight to end.
        link: what sentences call the bus, such as "dds (ROS_DOMAIN_ID 0)".

    Raises:
        ConfigError: the length is not above 0, another node commands the robot, or see `MessagePilot`, `Recorder`.
    """
    if seconds is not None:
        positive("--seconds", seconds)
    # What takes long comes before the flight: a warm-up, and a look for other nodes.
    pilot = MessagePilot(plan, planned_task(plan), link)
    _warm_up(MessagePilot(plan, planned_task(plan)))
    period = round(pilot.period * 1e9)
    report = Report(guarded=0 if plan.guard else None)
    inbox = Inbox(pilot)
    inbox.open(bus)
    announce = Announcements(bus, pilot)
    gc.collect()  # now, because messages wait meanwhile
    announce.listen(stopped)
    inbox.empty()
    speaker = Speaker(say)
    recorder = None
    if bag is not None:
        channels = {
            **pilot.inputs,
            **pilot.interface.outputs,
            NOTE_TOPIC: TEXT,
            LATE_TOPIC: TEXT,
            END_TOPIC: TEXT,
        }
        recorder = Recorder(bag, {FLIGHT_TOPIC: TEXT, **channels})
    offset = time.time_ns() - time.monotonic_ns()
    last = 0

    # What happens is written down at moments that ascend.
    def record(moment: int, topic: str, kind: str, data: bytes) -> None:
        if recorder is not None:
            recorder.write(BagMessage(moment, topic, kind, data))

    def unique(moment: int) -> int:
        # What came and what was decided at different times differ in the bag too.
        nonlocal last
        last = max(last + 1, moment + offset)
        return last

    def take(patience: float) -> None:
        if (arrival := inbox.next(patience)) is not None:
            moment = unique(arrival.came)
            record(moment, arrival.topic, pilot.inputs[arrival.topic], arrival.data)
            pilot.receive(arrival.topic, arrival.data, moment)

    def tell(note: str) -> None:
        if note and (not report.notes or report.notes[-1] != note):
            report.notes.append(note)
            speaker.say(note)

    # The flight begins; garbage is collected between decisions only.
    begins = unique(time.monotonic_ns())
    record(begins, FLIGHT_TOPIC, TEXT, text_message(json.dumps(asdict(plan))))
    valves = Valves(bus, pilot.period, pilot.shut(begins), stopped)
    troubles: set[str] = set()
    collected = gc.isenabled()
    gc.disable()
    due = time.monotonic_ns()
    end = None if seconds is None else due + round(seconds * 1e9)
    try:
        while not stopped() and (end is None or due < end):
            # What comes is taken as it comes, until a decision is due.
            while (left := due - time.monotonic_ns()) > 0 and not stopped():
                take(min(left * 1e-9, _PATIENCE))
            if stopped():
                break
            for _ in range(inbox.waiting()):
                take(0.0)
            # Commands are sent before anything is written down.
            began = time.monotonic_ns()
            used = time.thread_time_ns()
            moment = unique(began)
            valves.expect(due)
            decision = pilot.decide(moment)
            messages = pilot.messages(decision, moment)
            in_time = valves.send(messages)
            sent = time.monotonic_ns()
            if not in_time:
                record(moment, LATE_TOPIC, TEXT, text_message(""))
                decision = pilot.overrule((sent - due) * 1e-9)
                messages = pilot.messages(decision, moment)
            for message in messages:
                record(moment, *message)
            report.decisions += 1
            report.errors = pilot.errors
            if report.guarded is not None:
                report.guarded += decision.guarded
            report.computed.append((sent - began) * 1e-9)
            report.used.append((time.thread_time_ns() - used) * 1e-9)
            report.late.append((began - due) * 1e-9)
            report.missed += sent > due + period
            # What may wait, until the next decision is due.
            valves.shut = pilot.shut(moment)
            tell(decision.note)
            for trouble in (
                *inbox.refill(),
                *announce.others(),
                *([recorder.trouble] if recorder is not None and recorder.trouble else []),
            ):
                if trouble not in troubles:  # once in a flight
                    troubles.add(trouble)
                    tell(trouble)
            announce.publish(due)
            if decision.over:
                report.fault = decision.note
                break
            gc.collect(0)
            due += period
            while due + period < time.monotonic_ns():  # what was missed is not made up for
                due += period
                report.missed += 1
    finally:
        # First, and by bytes that are ready: nothing that fails or waits comes before.
        refused = valves.close()
        if collected:
            gc.enable()
        # Then the end is written down and said.
        never_came = pilot.monitor.never_came(unique(time.monotonic_ns()))
        if never_came and not report.fault:
            report.fault = never_came
            tell(never_came)
        record(unique(time.monotonic_ns()), END_TOPIC, TEXT, text_message(report.fault))
        moment = unique(time.monotonic_ns())
        for message in valves.shut:
            record(moment, *message)
        if recorder is not None:
            recorder.close()
            if recorder.trouble not in troubles:
                tell(recorder.trouble)
        if refused:
            report.fault = report.fault or refused
            tell(refused)
        speaker.close()
    return report


class Speaker:
    """Says sentences in a thread of its own: a flight neither waits for a terminal nor ends by an error of it.

    A terminal hangs when Ctrl-S is pressed, and is gone when its window is closed.

    Args:
        say: takes each sentence.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._queue: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, daemon=True, name="speaker")
        self._thread.start()

    def say(self, text: str) -> None:
        """Say a sentence; it returns at once. Sentences beyond those that may wait are left out."""
        if self._queue.qsize() < _MOST_SENTENCES:
            self._queue.put(text)

    def close(self) -> None:
        """Say what waits; a terminal that hangs is not waited for."""
        self._queue.put(None)
        self._thread.join(_LAST_SENTENCES)

    def _run(self) -> None:
        while (text := self._queue.get()) is not None:
            with contextlib.suppress(Exception):
                self._say(text)


class ReceivedMessage(NamedTuple):
    """A message that came over the bus."""

    came: int
    """When, by the monotonic clock, ns."""
    topic: str
    data: bytes


class Inbox:
    """What came over the bus and was not taken yet.

    Everybody on a bus may send: what comes is bounded in size and rate, so that neither memory nor the bag grow
    with what strangers send, and what is dropped is said.

    Args:
        pilot: whose topics to listen to.
    """

    def __init__(self, pilot: MessagePilot) -> None:
        self._kinds = pilot.inputs
        # Not `queue.SimpleQueue`: its `get` waits forever if its time is over before it begins to wait.
        self._queue: queue.Queue[ReceivedMessage] = queue.Queue()
        states = pilot.interface.inputs
        self._largest, of_states, of_others = map(int, RULES["size"].limits)
        rates = {topic: of_states if topic in states else of_others for topic in self._kinds}
        self._most = {topic: math.ceil(rate * pilot.period) for topic, rate in rates.items()}
        self._rates = rates
        self._room = dict(self._most)
        self._dropped: set[str] = set()

    def open(self, bus: Bus) -> None:
        """Listen."""
        for topic, kind in self._kinds.items():
            bus.subscribe(topic, kind, lambda data, topic=topic: self._put(topic, data))

    def _put(self, topic: str, data: bytes) -> None:
        """Put a message into the queue; it is dropped, and named once, if it is too large or too many come.

        Threads of the bus call it while the flight's own thread takes messages; `refill` makes room again.
        """
        # In a thread of the bus.
        if len(data) > self._largest:
            self._dropped.add(
                f"{topic}: a message has {len(data):,} bytes, and at most {self._largest:,} are read: dropped."
            )
        elif self._room[topic] <= 0:
            self._dropped.add(
                f"{topic}: more than {self._rates[topic]:,} messages a second: the others are dropped."
            )
        else:
            self._room[topic] -= 1
            self._queue.put(ReceivedMessage(time.monotonic_ns(), topic, data))

    def next(self, patience: float) -> ReceivedMessage | None:
        """The next message, for which it waits so many s; None: none came."""
        try:
            return self._queue.get(timeout=patience)
        except queue.Empty:
            return None

    def waiting(self) -> int:
        """Number of messages that were not taken."""
        return self._queue.qsize()

    def empty(self) -> None:
        """Drop what was not taken."""
        while self.next(0.0) is not None:
            pass
        self.refill()

    def refill(self) -> list[str]:
        """Allow for the messages of another control period, and return what was dropped, in sentences."""
        self._room = dict(self._most)
        dropped = self._dropped
        self._dropped = set()
        return sorted(dropped)


class Announcements:
    """Tells the bus who commands the robot, and hears who else does.

    Args:
        bus: where.
        pilot: who.
    """

    def __init__(self, bus: Bus, pilot: MessagePilot) -> None:
        # `announced` reads these keys, in nodes of any version.
        self._bus = bus
        self._period = pilot.period
        self._topics = sorted(pilot.interface.outputs)
        identity = secrets.token_hex(8)
        about = {
            "sha256": craft_hash(pilot.craft),
            "control_period": pilot.period,
            "agent": pilot.contract["agent"],
            "topics": self._topics,
            "node": identity,
        }
        self._message = text_message(json.dumps(about))
        self._next = 0
        self._heard: deque[bytes] = deque(maxlen=16)

        def hear(data: bytes) -> None:
            if (
                identity.encode() not in data and len(data) <= RULES["size"].limits[0]
            ):  # some buses echo
                self._heard.append(data)

        bus.subscribe(AGENT_TOPIC, TEXT, hear)

    def publish(self, now: int) -> None:
        """Say it again, if it is time."""
        if now >= self._next:
            self._bus.publish(AGENT_TOPIC, TEXT, self._message)
            self._next = now + round(_ANNOUNCED * 1e9)

    def listen(self, stopped: Callable[[], bool]) -> None:
        """Hear for a moment who else commands the robot.

        Raises:
            ConfigError: somebody does.
        """
        # Another node announces itself with its commands, every quarter of a second or every control period.
        until = time.monotonic() + 2.0 * (_ANNOUNCED + self._period)
        while time.monotonic() < until and not stopped():
            self.publish(time.monotonic_ns())
            for sentence in self.others():
                raise ConfigError(f"{sentence} End it, or fly in another ROS_DOMAIN_ID.")
            time.sleep(0.02)

    def others(self) -> list[str]:
        """Sentences about other nodes that command this robot, from announcements that came since."""
        found = []
        while self._heard:
            try:
                agent, topics = announced(self._heard.popleft())
            except ValueError:  # no node's
                continue
            if set(topics) & set(self._topics):
                found.append(f"another node commands this robot, with the agent {agent}.")
        return found


def _warm_up(pilot: MessagePilot) -> None:
    """Decide a few times on states that never were: what is computed first takes a hundred times as long.

    Its pilot is not the one that flies, for which these states would count as readings.
    """
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
    kind = TASKS[str(plan.task.get("name"))]
    return structure(plan.task.get("settings"), kind, "settings")


@dataclass(frozen=True)
class BagReplay:
    """What came out of a bag again."""

    decisions: int
    """Commands of the bag."""
    equal: int
    """Commands that the replay gave again, bit for bit."""
    first_difference: int | None
    """Number of the first command that differs; None: all are equal."""
    folder: str
    """Folder of the agent, with the spacecraft that flew."""


def replay_bag(bag: Path, folder: Path | None = None) -> BagReplay:
    """Fly a bag's messages again, and count the commands that come out equal byte by byte.

    See `rans_robot.functions.replay`.
    """
    stream = bag_entries(bag)
    first = next(stream, None)
    if first is None or first.topic != FLIGHT_TOPIC:
        raise ConfigError(f"{bag} is no bag of rans fly: it does not begin with {FLIGHT_TOPIC}.")
    plan = plan_in(bag, first)
    if folder is not None:
        plan = _of_folder(plan, bag, folder)
    if runs_code(Path(plan.folder)) and not are_files_trusted():
        raise ConfigError(
            f"{bag} is replayed by the agent.py in {brief(plan.folder)}, which is code: add --trust if the flight "
            "is yours; from Python, call rans.trust_files() first."
        )
    try:
        pilot = MessagePilot(plan, planned_task(plan))
    except ConfigError as error:
        raise ConfigError(f"{bag}, {FLIGHT_TOPIC}: {error}") from error
    outputs = pilot.interface.outputs
    decisions = 0
    equal = 0
    difference = None
    moment = None
    late = False
    recorded: list[Message] = []

    def compare() -> None:
        """Compare the command that was recorded last, all of whose messages have come.

        Bytes of all messages of outputs are compared, not numbers.
        """
        nonlocal decisions, equal, difference, late
        if moment is None:
            return
        decision = pilot.decide(moment)
        if late:
            decision = pilot.overrule(0.0)
        late = False
        again = [
            message for message in pilot.messages(decision, moment) if message.topic in outputs
        ]
        if again == recorded:
            equal += 1
        elif difference is None:
            difference = decisions
        decisions += 1

    # Inputs go to the pilot; outputs of one moment are compared together.
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
        if entry.topic == LATE_TOPIC:
            late = True
        if entry.topic in pilot.inputs:
            pilot.receive(entry.topic, entry.data, entry.time)
    else:
        # The process was ended while it wrote: its last command may not be whole.
        if len(recorded) == len(outputs):
            compare()
    return BagReplay(decisions, equal, difference, plan.folder)


def plan_in(bag: Path, first: BagMessage) -> Plan:
    """Plan in the first message of a bag; `ConfigError` if it is damaged."""
    try:
        table = read_table(first.data)
    except ValueError as error:
        raise ConfigError(f"{bag}, {FLIGHT_TOPIC}, is damaged: {error}.") from error
    return structure(table, Plan, f"{bag}, {FLIGHT_TOPIC}")


def _of_folder(plan: Plan, bag: Path, folder: Path) -> Plan:
    """A bag's plan with another folder of the agent; `ConfigError` if it names the code of another task."""
    # The user trusts the agent of this folder, and not what a bag calls a task.
    name = plan.task.get("name")
    is_code = isinstance(name, str) and ":" in name
    if is_code and read_contract(folder)["task"] != name:
        raise ConfigError(
            f"{bag} names the task {brief(name)}, whose code would run, and the agent in {folder} has another "
            "one; the bag is of another agent."
        )
    return replace(plan, folder=str(folder))
