"""Messages of robots are strangers' files: what the validator refuses changes nothing, in every kind of robot."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
import pytest
from hypothesis import given, strategies as st

pytest.importorskip("rosbags")

from rans_robot.frames import Motion, quaternion_of
from rans_robot.interfaces import Interface, RobotName
from rans_robot.messages import (
    FLOATS,
    ODOMETRY,
    pack,
    text_message,
    types,
    unpack,
)
from rans_robot.monitor import Reading, Validator
from rans_robot.pilot import (
    CRAFT_TOPIC,
    GOAL_TOPIC,
    Decision,
    MessagePilot,
)
from rans_robot.twin import VALVES_TOPIC, TwinPlan, run_twin

from rans import GoToPose
from tests.support.robots import AWAY, NOW, SECOND, Always, Wire, opened, plan

ROBOTS: tuple[RobotName, ...] = get_args(RobotName)
PERIOD = 0.2


def pilot(agent: Path, robot: RobotName = "ros", **changes: Any) -> MessagePilot:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rans_robot.pilot.exported_agent", lambda _: Always(np.ones(8)))
        return MessagePilot(plan(agent, robot=robot, **changes), GoToPose())


Message = tuple[str, bytes]
Sender = Callable[[MessagePilot, int, int], list[Message]]
"""Messages of a control period to a pilot, by its number and the time."""


def states(pilot: MessagePilot, motion: Motion, stamp: int) -> list[Message]:
    """What the robot sends of a motion that was measured at a time, ns."""
    return [(one.topic, one.data) for one in pilot.interface.state(motion, stamp)]


def fly(pilot: MessagePilot, sender: Sender, periods: int = 20) -> list[Decision]:
    """Decisions: the messages of a period come at its beginning, 0.19 s before its decision."""
    found = []
    for k in range(periods):
        now = NOW + round(k * PERIOD * SECOND)
        for number, (topic, data) in enumerate(sender(pilot, k, now)):
            pilot.receive(topic, data, now + number)
        found.append(pilot.decide(now + round(0.19 * SECOND)))
    return found


# Flights whose valves are shut from some period on


def without(topic: str, last: int) -> Sender:
    """A topic stops; in whichever order the others come."""
    return lambda one, k, now: [
        message
        for message in states(one, AWAY, now)[:: (-1) ** k]
        if message[0] != topic or k < last
    ]


def reframed(topic: str) -> Sender:
    """From the fifth period on in the body's frame, which ROS allows and RANS does not read."""

    def sender(one: MessagePilot, k: int, now: int) -> list[Message]:
        messages = dict(states(one, AWAY, now))
        if k >= 5:
            kind = one.inputs[topic]
            message = unpack(kind, messages.get(topic, messages["pose"]))
            message.header.frame_id = "base_link"
            messages[topic] = bytes(types().serialize_cdr(message, kind))
        return list(messages.items())

    return sender


def late(seconds: float) -> Sender:
    """A link or a stopped process that keeps messages back, and then hands them on in order."""

    def sender(one: MessagePilot, k: int, now: int) -> list[Message]:
        measured = now if k < 5 else now - round(seconds * SECOND)
        return states(one, AWAY, measured) if k < 5 or measured > NOW + SECOND else []

    return sender


class Flight(NamedTuple):
    sender: Sender
    opened: int
    """Periods with open valves; they are shut in all later ones."""
    said: dict[int, str]
    """What the notes of some periods say."""
    over: int | None = 9
    """Period from which on it is over: a last message at 0.8 s is above 1 s old from 1.99 s on."""
    robot: RobotName = "ros"
    periods: int = 20
    changes: dict[str, float] = {}  # noqa: RUF012


IN_FRAME = "frame_id is 'base_link'"
FLIGHTS = {
    "two old states in turn": Flight(
        lambda one, k, now: states(one, AWAY, now if k < 5 else NOW + (k % 2) * SECOND // 10), 5, {}
    ),
    **{
        f"{topic} in another frame": Flight(
            reframed(topic), 5, {6: f"{topic}: its messages are refused: {IN_FRAME}"}
        )
        for topic in ("pose", "twist")
    },
    "a goal in another frame": Flight(
        reframed(GOAL_TOPIC), 20, {6: f"{GOAL_TOPIC}: {IN_FRAME}"}, None
    ),
    **{
        f"no {topic}": Flight(
            without(topic, 0),
            0,
            {
                0: f"waiting for a state on {topic}: valves shut.",
                19: f"no state came on {topic} for",
            },
            11,
            changes={"wait": 2.0},
        )
        for topic in ("pose", "twist")
    },
    **{
        f"{seconds} s late": Flight(
            late(seconds),
            5,
            {19 + round(seconds / PERIOD): "dropped"},
            None,
            periods=20 + round(seconds / PERIOD),
            changes={"lost_after": 1000.0},
        )
        for seconds in (0.25, 1.0, 5.0, 60.0)
    },
}
for robot in ROBOTS:
    for topic in Interface(robot, 8, 8).inputs:
        FLIGHTS[f"{robot}, {topic} stops"] = Flight(
            without(topic, 5),
            5,
            {
                5: f"the state on {topic} is 0.39 s old",
                9: f"the robot is lost: its last state on {topic} is",
            },
            robot=robot,
        )
        FLIGHTS[f"{robot}, stamps of {topic} are not set"] = Flight(
            lambda one, k, now: states(one, AWAY, 0),
            0,
            {19: f"{topic}: its messages are refused: the time stamp is 0"},
            None,
            robot=robot,
        )
        FLIGHTS[f"{robot}, stamps of {topic} do not change"] = Flight(
            lambda one, k, now: states(one, AWAY, NOW) * 10,
            1,
            {3: f"{topic}: messages come, but all have the time stamp 1700000000"},
            5,
            robot=robot,
        )


@pytest.mark.parametrize("name", FLIGHTS)
def test_valves_are_shut_and_the_cause_is_said(name, agent):
    flight = FLIGHTS[name]
    one = pilot(agent, flight.robot, **flight.changes)
    decisions = fly(one, flight.sender, flight.periods)
    shut = flight.periods - flight.opened
    assert opened(decisions) == [True] * flight.opened + [False] * shut
    for k, words in flight.said.items():
        assert words in decisions[k].note
    over = [k for k, decision in enumerate(decisions) if decision.over]
    assert over == ([] if flight.over is None else [*range(flight.over, flight.periods)])


# Time stamps


@pytest.mark.parametrize(
    ("ahead", "messages"),
    [
        *((x, 1) for x in (-3600.0, -1.5, -0.99, -0.03, -0.021, 0.21, 0.99, 3600.0)),
        *((x, 1000) for x in (-3600.0, -1.5, -0.9, -0.4, 0.4, 0.9, 1.5, 3600.0)),
    ],
)
def test_velocities_know_a_stray_stamp_and_a_clock_that_was_set(ahead, messages, agent):
    """States of a body at 0.5 m/s, 50 a second: the filter sees no stray one; a clock begins anew."""
    one = pilot(agent, "pose")
    notes = []
    velocities = []
    for k in range(120):
        now = NOW + k * SECOND // 50
        if k % 10 == 0:
            notes.append(one.decide(now).note)
        off = 50 <= k < 50 + messages
        motion = AWAY._replace(position=np.array([0.01 * k, 0.0, 0.0]))
        for topic, data in states(one, motion, now + off * round(ahead * SECOND)):
            one.receive(topic, data, now)
        velocities.append(float(one.monitor.reading["velocity"][0]))
    assert velocities[-1] == pytest.approx(0.5, abs=0.02)
    words = "its clock was set" if messages > 1 else "dropped"
    assert sum(words in note for note in notes) == 1
    assert notes[-1] == ""
    if messages == 1:
        assert velocities[45:] == pytest.approx([0.5] * 75, abs=0.01)


@pytest.mark.parametrize(("robot", "rate"), [("ros", 5), ("px4", 25)])
@pytest.mark.parametrize("size", [0.21, 0.4, 0.5, 0.9, 0.99, 1.01, 3600.0])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("messages", [1, 1000])
def test_neither_a_stray_stamp_nor_a_clock_that_is_set_ends_a_flight(
    messages, sign, size, rate, robot, agent
):
    """Whatever the step: valves are shut at most until three messages agree, and then the flight goes on."""
    one = pilot(agent, robot)
    spacing = SECOND // rate
    decisions = []
    for k in range(5 * rate):
        now = NOW + k * spacing
        off = 2 * rate <= k < 2 * rate + messages
        for topic, data in states(one, AWAY, now + off * round(sign * size * SECOND)):
            one.receive(topic, data, now)
        if k % (rate // 5) == 0:
            decisions.append(one.decide(now + round(0.01 * SECOND)))
    assert not any(decision.over for decision in decisions)
    shut = [not is_open for is_open in opened(decisions)]
    assert not any(shut[:10] + shut[14:])
    # What is known to be wrong is not flown: at 25 Hz three messages come within an age that is flown.
    assert any(shut) == (rate == 5)


def test_states_that_waited_and_overtook_one_another_are_no_clock():
    """The newest of 50 comes first, and the others, up to a second old, at once after it."""
    judge = validator()
    for k in range(50):
        judge.state("pose", Reading(NOW + k * SECOND // 50), NOW + k * SECOND // 50)
    came = NOW + 2 * SECOND
    judge.state("pose", Reading(came), came)
    for k in range(50, 80):
        with pytest.raises(ValueError, match="before the newest"):
            judge.state("pose", Reading(NOW + k * SECOND // 50), came + k * 1_000_000)
    assert judge.state("pose", Reading(came + SECOND // 10), came + SECOND // 10).note == ""


def validator() -> Validator:
    return Validator(planar=True, oldest=0.2)


@pytest.mark.parametrize(
    ("drift", "flown"), [(2e-5, True), (-5e-4, True), (1e-4, True), (9e-4, False), (0.05, False)]
)
def test_clocks_may_drift_as_quartz_does(drift, flown):
    """An hour of a clock that is slow or fast, which may be a link on which messages come later and later.

    Without a common clock it cannot be told which it is: what is flown is never older than two of the oldest.
    """
    judge = validator()
    refused = 0
    for k in range(18_000):
        now = NOW + k * SECOND // 5
        measured = 5 * SECOND + round((now - NOW) * (1.0 - drift))
        try:
            verdict = judge.state("pose", Reading(measured), now)
        except ValueError:
            refused += 1
            continue
        assert verdict.moment is not None
        assert 0.0 <= (now - verdict.moment) * 1e-9 <= 0.2
        assert drift * (now - NOW) * 1e-9 <= 0.4
    assert (refused == 0) == flown


@given(
    delays=st.lists(st.floats(0.0, 0.15), min_size=2, max_size=30),
    offset=st.floats(-1e9, 1e9),
)
def test_any_delay_below_the_oldest_is_flown(delays, offset):
    """Whatever the sender's clock says: an age is not below zero, nor above the true one by more than drift."""
    judge = validator()
    begin = round((2e9 + offset) * SECOND)
    for k, delay in enumerate(delays):
        measured = NOW + k * SECOND // 5
        now = measured + round(delay * SECOND)
        verdict = judge.state("pose", Reading(measured - NOW + begin), now)
        assert verdict.moment is not None
        assert measured - SECOND // 1000 <= verdict.moment <= now
        # It is older than it came if it came with more delay than three others in a row; clocks drift by 1 ms a
        # second.
        rows = [max(delays[at : at + 3]) for at in range(k - 1)]
        quickest = min([delays[0], *rows]) + 1e-3 * (0.2 * k + 0.5)
        assert verdict.moment <= measured + round(quickest * SECOND)


# Numbers, attitudes and frames

NAN = float("nan")
H = np.sqrt(0.5)
BAD_MOTIONS = {
    name: AWAY._replace(**{part: np.array(numbers, float)})
    for name, part, numbers in (
        ("zero quaternion", "attitude", (0, 0, 0, 0)),
        ("short quaternion", "attitude", 0.8 * AWAY.attitude),
        ("long quaternion", "attitude", 1.2 * AWAY.attitude),
        ("one quaternion number", "attitude", (1, 0, 0, NAN)),
        ("huge quaternion", "attitude", (1e30, 0, 0, 1)),
        ("upside down", "attitude", (0, 1, 0, 0)),
        ("on its side", "attitude", (H, 0, H, 0)),
        ("high above", "position", (2, 1, 7)),
        ("nan position", "position", (NAN, 1, 0)),
        ("infinite position", "position", (0, -np.inf, 0)),
        ("far position", "position", (1e30, 1, 0)),
        ("nan velocity", "velocity", (0, NAN, 0)),
        ("fast", "velocity", (1e6, 0, 0)),
        ("nan spin", "spin", (0, 0, NAN)),
        ("fast spin", "spin", (0, 0, -1e6)),
    )
}


def about_velocity(name: str) -> bool:
    return any(word in name for word in ("velocity", "fast", "spin"))


@pytest.mark.parametrize(
    ("robot", "bad"),
    [
        (robot, bad)
        for number, bad in enumerate(BAD_MOTIONS)  # two robots each, by turns
        for robot in (ROBOTS * 2)[number % len(ROBOTS) :][:2]
        if Interface(robot, 8, 8).has_velocity or not about_velocity(bad)
    ],
)
def test_what_is_refused_changes_nothing(robot, bad, agent):
    """As the first message or later, a flight with it goes as one without it; the note has topic and value."""
    with_it = pilot(agent, robot)
    without = pilot(agent, robot)
    notes = []
    for k in range(30):
        now = NOW + k * SECOND // 50
        if k in (0, 12):
            good = dict(states(with_it, AWAY, now))
            for topic, data in states(with_it, BAD_MOTIONS[bad], now):
                if data != good[topic]:
                    with_it.receive(topic, data, now)
                    notes.append((topic, with_it._troubles[topic]))
        else:
            moved = AWAY._replace(position=np.array([2.0 - 0.01 * k, 1.0, 0.0]))
            for one in (with_it, without):
                for topic, data in states(one, moved, now):
                    one.receive(topic, data, now)
    assert len(notes) == 2
    assert all(note.startswith(f"{topic}: ") and "must be" in note for topic, note in notes)
    for name, value in without.monitor.reading.items():
        np.testing.assert_array_equal(with_it.monitor.reading[name], value)
    decisions = [one.decide(NOW + SECOND * 3 // 5) for one in (with_it, without)]
    assert opened(decisions) == [True, True]


def test_space_has_no_up():
    """What a planar craft cannot be, a craft in space can."""
    space = Validator(planar=False, oldest=0.2)
    for name in ("upside down", "on its side", "high above"):
        motion = BAD_MOTIONS[name]
        reading = Reading(1, motion.position, motion.attitude)
        with pytest.raises(ValueError, match="of the plane"):
            validator().state("pose", reading, NOW)
        space.pose("goal_pose", reading)


def odometry(attitude: np.ndarray, velocity: Any, spin: Any, frame: str, child: str) -> bytes:
    values = {
        "header.frame_id": frame,
        "child_frame_id": child,
        "pose.pose.orientation": attitude,
        "twist.twist.linear": velocity,
        "twist.twist.angular": spin,
    }
    return pack(ODOMETRY, values)


@pytest.mark.parametrize(
    ("frame", "child", "is_world"),
    [
        *(
            ("odom", body, False)
            for body in ("base_link", "body", "robot1/base_link", "/base_link")
        ),
        *((world, world, True) for world in ("odom", "map", "/world")),
        *(("odom", "", None), ("map", "odom", None), ("world", "uav1/map", None)),
    ],
)
def test_a_twist_is_in_the_frame_of_the_child(frame, child, is_world):
    """A body that faces +y, by hand: forward is +y, and what turns it about +x of the world is about its -y."""
    ends = Interface("odometry", 8, 8)
    data = odometry(quaternion_of(np.pi / 2), (1, 0, 0), (0.1, 0, 0.3), frame, child)
    if is_world is None:
        with pytest.raises(ValueError, match="child_frame_id is"):
            ends.read("odom", data)
        return
    reading = ends.read("odom", data)
    assert reading.velocity == pytest.approx([1, 0, 0] if is_world else [0, 1, 0])
    assert reading.spin == pytest.approx([0, -0.1, 0.3] if is_world else [0.1, 0, 0.3])


# Goals


@pytest.mark.parametrize("name", [name for name in BAD_MOTIONS if not about_velocity(name)])
def test_a_goal_that_is_none_is_refused(name, agent):
    one = pilot(agent, goal=(0.5, 0.5, 20.0))
    before = one._goal
    motion = BAD_MOTIONS[name]

    def goal(now, motion):
        (message,) = Interface("pose", 8, 8).state(motion, now)
        return GOAL_TOPIC, message.data

    decisions = fly(
        one,
        lambda one, k, now: [*states(one, AWAY, now), *([goal(now, motion)] if k == 3 else [])],
        6,
    )
    assert one._goal == before
    assert opened(decisions) == [True] * 6
    assert decisions[3].note.startswith("goal_pose: ")
    assert decisions[4].note == ""
    one.receive(*goal(NOW, AWAY), NOW)
    assert (one._goal.p.x, one._goal.p.y) == (2.0, 1.0)


# The spacecraft


def crafts() -> list[str]:
    table = {"name": "x", "sha256": "y", "control_period": 0.2}
    odd: list[Any] = [NAN, np.inf, -np.inf, 0, -0.2, "0.2", None, [0.2], True, 10**400, 1e300, {}]
    return [
        "[" * 60_000,
        "[" * 1900,
        '{"a":' * 600 + "1" + "}" * 600,
        "",
        "null",
        "[]",
        "{}",
        "1" * 2000,
        *(json.dumps(table | {"control_period": value}) for value in odd),
        *(json.dumps(table | {key: 3}) for key in ("name", "sha256")),
    ]


@pytest.mark.parametrize("text", crafts(), ids=range(len(crafts())))
def test_a_text_that_describes_no_spacecraft(text, agent):
    """It is said, and the flight goes on: everybody can send it."""
    one = pilot(agent)
    craft = [(CRAFT_TOPIC, text_message(text))]
    decisions = fly(
        one, lambda one, k, now: [*states(one, AWAY, now), *(craft if k == 1 else [])], 4
    )
    assert opened(decisions) == [True] * 4
    assert decisions[1].note.startswith("rans/craft: ")
    assert len(decisions[1].note) < 500


def test_a_stranger_s_name_is_one_printable_line(agent):
    """In what a terminal, a bag and another node are told."""
    one = pilot(agent)
    hostile = "\x1b[2Jx\nrans/note: all is well\u202e" * 20
    table = {"name": hostile, "sha256": hostile, "control_period": 0.2}
    one.receive(CRAFT_TOPIC, text_message(json.dumps(table)), NOW)
    note = one.decide(NOW).note
    assert "the robot is the spacecraft" in note
    assert note.isprintable()
    assert len(note) < 500


# Commands


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("value", [2, -1, NAN])
def test_a_command_that_is_none_is_refused(robot, value):
    """NaN shuts a motor of PX4, and whole numbers have none."""
    ends = Interface(robot, 8, 8)
    *_, message = ends.command([0.0] * 8, NOW)

    def changed(row):
        return pack(message.kind, {field: row})

    field = "control" if robot == "px4" else "data"
    row = getattr(unpack(message.kind, message.data), field).copy()
    if np.isnan(value) and robot in ("px4", "roboran"):
        return
    row[3] = value
    with pytest.raises(ValueError, match="must be 8 numbers"):
        ends.commanded(message.topic, changed(row))
    if robot != "px4":
        with pytest.raises(ValueError, match="numbers"):
            ends.commanded(message.topic, changed(row[:3]))


class _Clock:
    """Stands in for `time`: passes while somebody sleeps, so that a flight is the same on any machine."""

    def __init__(self) -> None:
        self.now = 0

    def sleep(self, seconds: float) -> None:
        self.now += round(seconds * 1e9)

    def monotonic_ns(self) -> int:
        return self.now

    time_ns = monotonic_ns


def test_a_twin_says_what_it_refuses_and_its_watchdog_shuts(monkeypatch):
    """Commands that are none neither open valves nor keep them open."""
    from rans.model.spacecraft_file import load_spacecraft

    class Commander(Wire):
        def publish(self, topic: str, kind: str, data: bytes) -> None:
            super().publish(topic, kind, data)
            if topic == "pose":
                row = np.ones(8) if self.count("pose") == 3 else np.full(8, NAN)
                self.hand_on("commands", pack(FLOATS, {"data": row}))

    said = []
    wire = Commander()
    about = TwinPlan(load_spacecraft("floating-platform"), 0.05, rate=50.0, seconds=0.6)
    monkeypatch.setattr("rans_robot.twin.time", _Clock())
    run_twin(wire, about, said.append)
    valves = [
        np.any(unpack(FLOATS, data).data) for topic, data in wire.sent if topic == VALVES_TOPIC
    ]
    assert any(valves)
    assert not valves[-1]
    assert sum("commands: the command is (nan" in text for text in said) == 1
    assert any("valves shut" in text for text in said)


def test_one_quick_message_alone_sets_no_clock():
    """Messages that take 0.1 s count as measured when they came, until three in a row come at once."""
    judge = validator()
    for k, delay in enumerate([0.1] * 3 + [0.0] + [0.1] * 3 + [0.0] * 3 + [0.1] * 2):
        measured = NOW + k * SECOND // 5
        now = measured + round(delay * SECOND)
        moment = judge.state("pose", Reading(measured), now).moment
        # Clocks drift by 1 ms a second.
        assert moment == pytest.approx(measured if k >= 9 else now, abs=3_000_000)
