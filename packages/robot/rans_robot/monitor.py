"""The monitor between whatever decides and whatever opens valves: it alone lets a command through.

Readings pass it before an agent gets them, commands after an agent gave them, in every form of an agent and over
every bus. `RULES` is all that it goes by, and the table of docs/robots.md: nothing else in this package refuses a
reading or a command, and no file makes a limit wider. A message is a stranger's file: what is refused raises a
`ValueError`, whose sentence names the value and the usual cause, and changes nothing.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from operator import le
from typing import Any, NamedTuple

import numpy as np

from rans.effectors.commands import command_bounds
from rans.evaluation.fly.exported import LARGEST, LONGEST_PERIOD, OLDEST
from rans.extend import Spacecraft, brief, is_finite
from rans_robot.frames import Motion, small_turns
from rans_robot.messages import read_table
from rans_robot.velocity import VelocityFilter


class Rule(NamedTuple):
    """One row of the table."""

    asks: str
    """What is judged."""
    limits: tuple[float, ...]
    """By which numbers."""
    text: str
    """How the limits are said, with a place for each."""
    does: str
    """What happens beyond them."""
    tighter: str = ""
    """What may make a limit tighter; "": nothing does."""


_DROPS = "drops the message"
_SHUTS = "shuts"
_SETTLES = "shuts, until it has held for 2 periods; ends after `lost_after`"
RULES = {
    # An Odometry with its covariances has 730 bytes; the fastest motion capture sends 1,000 messages a second.
    "size": Rule(
        "message; messages a second of a state, of others",
        (4096, 2000, 50),
        "{:g} bytes; {:g}, {:g}",
        _DROPS,
    ),
    "number": Rule(
        "position, velocity, angular velocity",
        tuple(LARGEST.values()),
        "{:g} m, {:g} m/s, {:g} rad/s",
        _DROPS,
    ),
    # Rounding and averaging change less, and an unset quaternion has no length.
    "quaternion": Rule("length of a quaternion", (0.9, 1.1), "{:g} to {:g}", _DROPS),
    # A craft on a floor tilts by less than a degree, but markers may be mounted askew; a frame may begin at the
    # floor or on the ceiling.
    "plane": Rule(
        "tilt, height of a planar craft or goal", (30.0, 2.0), "{:g} degrees, {:g} m", _DROPS
    ),
    "clock": Rule(
        "messages that agree that a clock was set, or that a craft is elsewhere",
        (3,),
        "{:g} in a row",
        _DROPS,
    ),
    # Crystals drift by 1e-4, NTP corrects by 5e-4 at most. In all it is what a link that falls behind can hide.
    "drift": Rule(
        "delay that grows, as where clocks drift apart",
        (1e-3, 1.0),
        "{:g} s a second, in all {:g} times `readings.oldest`",
        _DROPS,
    ),
    "pace": Rule(
        "delay that falls, as of a simulator that hurries",
        (0.3, 30.0),
        "{:g} s in {:g} s",
        _SETTLES,
    ),
    # Eight deviations of the noisiest conditions that RANS has, 3 cm and 3 degrees, at both ends.
    "jump": Rule(
        "jump of position, attitude, velocity, angular velocity, beyond speed and thrust",
        (0.35, 0.8, 0.5, 0.8),
        "{:g} m, {:g} rad, {:g} m/s, {:g} rad/s",
        _SETTLES,
    ),
    # A tracker may print tenths of mm: in two periods of 0.2 s this moves a craft by half of one.
    "still": Rule(
        "speed or spin due from thrust while readings repeat for 2 periods",
        (1e-3,),
        "{:g} m/s, rad/s",
        _SETTLES,
    ),
    "twist": Rule(
        "change of the pose in 2 s that its velocities do not make; if they are zero",
        (0.35, 0.8, 0.1, 0.2),
        "{:g} m, {:g} rad; {:g} m, {:g} rad",
        _SETTLES,
    ),
    "age": Rule(
        "age of the newest state",
        OLDEST,
        "{:g} s, or {:g} control periods if longer",
        "shuts; ends after `lost_after`",
        "`readings.oldest`",
    ),
    # As long as a twin holds a command of 0.2 s.
    "link": Rule("wait of a message in Zenoh or DDS", (0.5,), "{:g} s", _DROPS),
    "rate": Rule("time between states, in the median", (1.5,), "{:g} control periods", "ends"),
    "craft": Rule(
        "another spacecraft or control period in `rans/craft`", (1e-6,), "{:g} s", "ends"
    ),
    "observation": Rule(
        "column of the observation", (1.0,), "{:g} times `refused`", _SHUTS, "`refused`"
    ),
    "command": Rule("command beyond its range", (1e-6,), "{:g}", _SHUTS),
    "time": Rule("lateness of a decision", (0.5,), "{:g} control periods", _SHUTS),
    "stop": Rule("stop, also by Ctrl-C while an agent computes", (3,), "shut {:g} times", "ends"),
}
"""All rules, by name."""
PERSISTS = 2
"""Control periods for which readings may contradict commands, and for which they must hold again."""
_OF_THE_WORLD = ("map", "odom", "world", "earth")
"""Names that ROS's REP 105 gives to frames which are none of a body."""
_MOST_OF_RUN = 50
"""Messages in a row by which it is judged whether they come as slowly as they were measured."""
_SPREAD = 20
"""Intervals between states by whose median their rate is judged."""
_STILL = np.zeros(3)
_WINDOW = 2.0
"""s over which velocities are compared with the change of the pose."""


class Reading(NamedTuple):
    """What one message says of the robot's motion, in RANS's frames."""

    measured: int
    """When, by the sender's clock, ns."""
    position: np.ndarray | None = None
    attitude: np.ndarray | None = None
    velocity: np.ndarray | None = None
    spin: np.ndarray | None = None
    frame: str = ""
    """Name of the world's frame; "": the message names none."""


class MessageVerdict(NamedTuple):
    """What is said of a message that is not refused."""

    moment: int | None
    """When it was measured, by the receiver's clock, ns; None: it has been received before."""
    note: str = ""
    was_set: bool = False
    """Whether the sender's clock was set: time stamps of before are not those of this clock."""
    hurries: str = ""
    """Why the sender's time is none, if it runs ahead of ours."""


# One message by itself


def finite_vector(what: str, values: Any) -> np.ndarray:
    """Three numbers of a position (m), velocity (m/s) or angular velocity (rad/s), checked (`ValueError`)."""
    result = np.array(values, dtype=float)
    limits = RULES["number"].limits
    limit = limits[("position", "velocity", "angular velocity").index(what)]
    # Not a number is within no limit.
    if result.shape != (3,) or not (np.abs(result) <= limit).all():
        raise ValueError(
            f"the {what} is {_text(values)}, but must be three finite numbers of at most {limit:g}: is the "
            "sensor lost, or its unit another one than m and rad?"
        )
    return result


def unit(values: Any) -> np.ndarray:
    """Quaternion (w, x, y, z) scaled to unit length; ValueError unless it is four numbers of nearly that length."""
    result = np.array(values, dtype=float)
    low, high = RULES["quaternion"].limits
    length = float(np.linalg.norm(result)) if (np.abs(result) <= high).all() else np.inf
    if result.shape != (4,) or not low <= length <= high:
        raise ValueError(
            f"the quaternion (w, x, y, z) is {_text(values)}, but must be of unit length, {low:g} to {high:g}: is "
            "it set, and does the sensor see the robot?"
        )
    return result / length


def command(values: Any, low: Any, high: Any) -> np.ndarray:
    """A command within its limits, checked (`ValueError`) to have one finite number for each.

    Args:
        values: the command.
        low: (n,), least commands.
        high: (n,), largest commands.
    """
    result = np.array(values, dtype=float)
    (slack,) = RULES["command"].limits
    if result.shape == np.shape(low) and _within(result.tolist(), low, high):
        return result
    if result.shape != np.shape(low) or not _within(
        result, np.subtract(low, slack), np.add(high, slack)
    ):
        raise ValueError(
            f"the command is {_text(values)}, but must be {len(low)} numbers from {_text(low)} to "
            f"{_text(high)}: is it for another spacecraft?"
        )
    return result.clip(low, high)


def command_row(values: Any, size: int) -> np.ndarray:
    """The numbers of a message of commands, checked (`ValueError`) to be as many as its valves and wheels."""
    result = np.asarray(values, dtype=float)
    if len(result) != size:
        raise ValueError(
            f"the message has {len(result)} numbers, but must have {size}: is it for another spacecraft?"
        )
    return result


def _within(values: Iterable[float], low: Iterable[float], high: Iterable[float]) -> bool:
    """Whether every value is a number within its limits."""
    values = [*values]
    return all(map(le, low, values)) and all(map(le, values, high))


def description(data: bytes) -> tuple[str, str, float]:
    """Name, hash and control period (s) of the spacecraft in a message of `rans_robot.pilot.CRAFT_TOPIC`.

    Raises:
        ValueError: it is no such message; a name may stand in a sentence.
    """
    name, digest, period = map(_table(data).get, ("name", "sha256", "control_period"))
    # A number of seconds that cannot be one would end the flight as another craft's.
    is_period = is_finite(period) and 0.0 < period <= LONGEST_PERIOD  # type: ignore[operator]
    if not (isinstance(name, str) and isinstance(digest, str) and is_period):
        raise ValueError(
            "name and sha256 of the spacecraft must be texts, and control_period above 0 and at most "
            f"{LONGEST_PERIOD:g} s, got {brief(name)}, {brief(digest)} and {brief(period)}"
        )
    return brief(name), digest, float(period)  # type: ignore[arg-type]


def announced(data: bytes) -> tuple[str, list[str]]:
    """Agent and topics of its commands in a message of `rans_robot.pilot.AGENT_TOPIC`, or a `ValueError`."""
    table = _table(data)
    agent = table.get("agent")
    topics = table.get("topics")
    if not isinstance(agent, str) or not isinstance(topics, list):
        raise ValueError(
            f"agent must be a text and topics a list, got {brief(agent)} and {brief(topics)}"
        )
    return brief(agent), [topic for topic in topics if isinstance(topic, str)]


def _table(data: bytes) -> dict[str, Any]:
    """JSON object in a text message (std_msgs/String), or a `ValueError`; its size is checked before it is read."""
    if len(data) > (largest := RULES["size"].limits[0]):
        raise ValueError(f"a message has {len(data):,} bytes, and at most {largest:,} are read")
    return read_table(data)


def _text(values: Any) -> str:
    flat = np.ravel(np.array(values, dtype=float))
    shown = ", ".join(f"{x:.4g}" for x in flat[:16])
    return f"({shown}{', ...' if len(flat) > 16 else ''})"


# One message after others


class Validator:
    """Judges the messages of a flight: attitude, frames, order and age.

    Args:
        planar: whether the craft moves in the plane z = 0.
        oldest: age, s, above which a reading is stale.
    """

    def __init__(self, planar: bool, oldest: float) -> None:
        self._planar = planar
        self._oldest = oldest
        self._world = ("", "")
        """Name of the world's frame, and the topic that named it first."""
        self._clocks: dict[str, _Clock] = {}

    def state(self, topic: str, reading: Reading, now: int) -> MessageVerdict:
        """Judge (`ValueError`) a reading of the robot's motion that came at a time, ns.

        A refused one changes no clock.
        """
        self._check(reading)
        if topic not in self._clocks:
            self._clocks[topic] = _Clock(self._oldest)
        verdict = self._clocks[topic].judge(reading.measured, now)
        self._name(topic, reading.frame)
        return verdict

    def pose(self, topic: str, reading: Reading) -> None:
        """Judge (`ValueError`) a pose without its time: that of a goal, or in a log."""
        self._check(reading)
        self._name(topic, reading.frame)

    def _check(self, reading: Reading) -> None:
        """Refuse (`ValueError`) another world frame, and a craft of the plane that is far above it, or tilted."""
        name, first = self._world
        if reading.frame and name and reading.frame != name:
            raise ValueError(
                f"frame_id is {brief(reading.frame)}, but that of {first} is {brief(name)}: all must be of one "
                "world frame"
            )
        position = reading.position
        attitude = reading.attitude
        if not self._planar:
            return
        steepest, highest = RULES["plane"].limits
        if position is not None and abs(position[2]) > highest:
            raise ValueError(
                f"a craft of the plane is {position[2]:.3g} m above it, but must be within {highest:g} m: is the "
                "sensor wrong, or z the axis that points up?"
            )
        if attitude is not None:
            _, x, y, _ = attitude
            upright = 1.0 - 2.0 * (x * x + y * y)  # z component of the body's z axis
            tilt = math.degrees(math.acos(max(-1.0, min(upright, 1.0))))
            if tilt > steepest:
                raise ValueError(
                    f"a craft of the plane is tilted by {tilt:.0f} degrees, but must be by at most {steepest:g}: "
                    "is the sensor wrong, or z the axis that points up?"
                )

    def _name(self, topic: str, frame: str) -> None:
        if frame and not self._world[0]:
            self._world = (frame, topic)


def frame_of_twist(frame: str, child: str) -> str:
    """Whether the twist of a nav_msgs/Odometry is in the "body" or, as its child frame is the parent, the "world".

    Raises:
        ValueError: the child frame is not named, or by its name it is another world frame.
    """
    name = child.strip("/").rpartition("/")[2]
    if not name:
        raise ValueError(
            "child_frame_id is empty, so that the frame of the twist is unknown: set it to that of the body, such "
            "as base_link"
        )
    if child.strip("/") == frame.strip("/"):
        return "world"
    if name in _OF_THE_WORLD:
        raise ValueError(
            f"child_frame_id is {brief(child)}, which by REP 105 is no frame of a body, and frame_id is "
            f"{brief(frame)}: set it to the frame of the twist, such as base_link"
        )
    return "body"


def require_ned(pose: int, velocity: int) -> None:
    """Refuse (`ValueError`) frames of a PX4 odometry other than 1, NED."""
    if pose != 1 or velocity != 1:
        raise ValueError(
            f"pose_frame is {pose} and velocity_frame {velocity}, but both must be 1, NED"
        )


class _Clock:
    """Order and lateness of the time stamps of one topic, whose sender's clock need not agree with ours.

    Messages that came with the least delay so far give the difference of the clocks; any other is later by what its
    difference is larger, so that messages which wait anywhere, in a link or while this process is stopped, are as
    old as they are. One message alone changes nothing: the least of the last three counts that none of them is
    below. Stamps that no delay explains are of another clock: those ahead of their arrival, and those that are late
    and before the newest, since a link that is behind keeps the order. Such a clock counts when messages in a row
    agree on it.
    """

    def __init__(self, oldest: float) -> None:
        self._oldest = oldest
        self._newest: int | None = None
        self._came = 0
        """When the newest came, ns."""
        self._difference = 0
        """Least arrival less time stamp, ns."""
        self._soonest = 0
        """Least difference since the clock was set, ns."""
        self._anchor: tuple[int, int] | None = None
        """Difference and arrival, ns, from which on the pace of the clock is judged."""
        agreeing = int(RULES["clock"].limits[0])
        self._recent: deque[int] = deque(maxlen=agreeing)
        """Differences of the last messages."""
        self._other: deque[tuple[int, int]] = deque(maxlen=_MOST_OF_RUN)
        """Time stamps and arrivals of messages in a row that agree on another clock."""

    def judge(self, stamp: int, now: int) -> MessageVerdict:
        """When a message with a time stamp, ns, that came at a time, ns, was measured by our clock.

        Changes the clock only if the message counts.
        """
        if stamp <= 0:
            raise ValueError(f"the time stamp is {stamp}: header.stamp is not set by its sender")
        if self._newest is None:
            return self._begin(stamp, now)
        # The least difference of both clocks is that of the fastest messages; clocks drift apart in time.
        drift, most = RULES["drift"].limits
        difference = now - stamp
        grown = self._difference + round(drift * (now - self._came))
        least = min(grown, self._soonest + round(most * self._oldest * 1e9))
        late = (difference - least) * 1e-9
        back = (self._newest - stamp) * 1e-9
        is_other = late < -self._oldest or (late > self._oldest and back > 0.0)
        if is_other or (late > self._oldest and self._other):
            by = f"{back:.2f} s before the newest" if late > 0.0 else f"{-late:.2f} s in the future"
            if self._was_set(stamp, now, is_other):
                return self._begin(stamp, now)._replace(
                    note=f"its clock was set: time stamps are {by}, and velocities begin anew",
                    was_set=True,
                )
            raise ValueError(f"a time stamp is {by}: dropped; was its clock set, or do two send?")
        # Both clocks go on: what remains is the order and the delay of messages.
        self._other.clear()
        if back == 0.0:
            return MessageVerdict(None)
        if back > 0.0:
            raise ValueError(f"a message is {back:.3f} s older than the newest: dropped")
        if late > self._oldest:
            raise ValueError(
                f"a message came {late:.2f} s later than it should by its time stamp: dropped; is the link behind, "
                f"was a process stopped, do clocks drift apart, or is it a simulator{self._pace(difference, now)}?"
            )
        self._recent.append(difference)
        self._newest = stamp
        self._came = now
        self._difference = min(least, max(self._recent))
        self._soonest = min(self._soonest, self._difference)
        return MessageVerdict(min(stamp + self._difference, now), hurries=self._hurry(now))

    def _pace(self, difference: int, now: int) -> str:
        """Seconds of time stamps in a second of ours, as the end of a sentence; "": nothing is known yet."""
        if self._anchor is None or now <= self._anchor[1]:
            return ""
        before, came = self._anchor
        return f" at {1.0 - (difference - before) / (now - came):.2f} of real time"

    def _hurry(self, now: int) -> str:
        """Why time stamps cannot be those of a clock, since messages come sooner and sooner; "" if they do not."""
        if len(self._recent) < (self._recent.maxlen or 0):
            return ""
        most, longest = RULES["pace"].limits
        before, came = self._anchor or (self._difference, now)
        sooner = (before - self._difference) * 1e-9
        said = ""
        if sooner > most:
            said = (
                f"time stamps run ahead of our clock by {sooner:.2f} s: is it a simulator"
                f"{self._pace(self._difference, now)}"
            )
        if self._anchor is None or said or (now - came) * 1e-9 > longest:
            self._anchor = (self._difference, now)
        return said

    def _begin(self, stamp: int, now: int) -> MessageVerdict:
        """The first message of a clock counts as measured when it came."""
        self._newest = stamp
        self._came = now
        self._difference = now - stamp
        self._soonest = self._difference
        self._anchor = None
        self._recent.clear()
        self._recent.append(self._difference)
        self._other.clear()
        return MessageVerdict(now)

    def _was_set(self, stamp: int, now: int, begins: bool) -> bool:
        """Whether the last messages agree on another clock: they go on as time does, and come no faster.

        Every call counts as a message, so that it must be called once for each. ``begins`` says whether this one
        may be the first of a row: a message that is merely late is none.
        """
        if self._other:
            before, came = self._other[-1]
            passed = (now - came) - (stamp - before)
            if stamp <= before or abs(passed) * 1e-9 > self._oldest:
                self._other.clear()
        if self._other or begins:
            self._other.append((stamp, now))
        if len(self._other) < (self._recent.maxlen or 0):
            return False
        # Messages that waited come together, and are no clock.
        first, came = self._other[0]
        return now - came >= (stamp - first) // 2


class Link:
    """Drops what waited in a link, by when its sender sent it: a command of before is none of now."""

    def __init__(self) -> None:
        self._clock = _Clock(*RULES["link"].limits)

    def is_fresh(self, sent: int) -> bool:
        """Whether a message that its sender sent at a time, ns (0: unknown), and that comes now, did not wait."""
        try:
            return sent <= 0 or bool(self._clock.judge(sent, time.monotonic_ns()))
        except ValueError:
            return False


@dataclass
class _Part:
    """What is known of one topic of a robot's state."""

    came: int | None = None
    """When its last reading came, ns; None: none did."""
    moment: int | None = None
    """When that was measured, by our clock, ns."""
    intervals: deque[float] = field(default_factory=lambda: deque(maxlen=_SPREAD))
    """s between readings."""
    refused: tuple[int, str] | None = None
    """When the last message came that gave no reading, and why, since the last reading."""
    strays: int = 0
    """Readings in a row that no thrust makes of those before, but of one another."""
    stray: dict[str, tuple[int, np.ndarray]] = field(default_factory=dict)
    """The last of them: when it was measured, ns, and its values by name."""
    fresh: bool = False
    """Whether a reading came since the last decision."""
    moved: bool = False
    """Whether one of them was another one than the last."""
    still: int = 0
    """Control periods in which readings came and repeated, though thrust was given."""
    due: float = 0.0
    """Change of speed, m/s, or of spin, rad/s, that is due in them."""


class Monitor:
    """The rules on the readings and commands of a flight, and what they say of the present.

    It is given every reading (`take`), asked at every decision whether there is a state to decide by (`unfit`), and
    passes what an agent observes (`observed`) and gives (`commanded`).

    Args:
        craft: the agent's spacecraft.
        contract: of the agent (`rans.extend.read_contract`).
        interface: of the robot (`rans_robot.interfaces.Interface`).
        plan: the flight (`rans_robot.pilot.Plan`).
        link: bus and domain over which messages come, as sentences name them; "" leaves them out.
    """

    def __init__(
        self,
        craft: Spacecraft,
        contract: Mapping[str, Any],
        interface: Any,
        plan: Any,
        link: str = "",
    ) -> None:
        self._plan = plan
        self._link = link
        # Limits of the craft and of its contract, which may be tighter than those of the rules.
        self.period = float(contract["control_period"])
        seconds, periods = RULES["age"].limits
        self.oldest = min(
            float(contract["readings"]["oldest"]), max(seconds, periods * self.period)
        )
        self._lost_after = max(plan.lost_after, self.oldest)
        self._columns = [f"column {k} ({x['name']})" for k, x in enumerate(contract["observation"])]
        (wider,) = RULES["observation"].limits
        beyond = [column["refused"] for column in contract["observation"]]
        self._refused = [[wider * x for x in side] for side in zip(*beyond, strict=True)]
        self._commands = command_bounds(craft, float).tolist()
        # What thrust makes: each thruster's share, and all that there is, as wheels give it too.
        size = craft.dimension
        inertia = min(craft.inertia[k][k] for k in range(3))
        weights = np.array([craft.mass] * size + [inertia] * (craft.degrees_of_freedom - size))
        self._shares = craft.wrenches / weights
        most = np.abs(craft.wrenches_either_way.T / weights).sum(axis=0)
        parts = slice(size), slice(size, None)
        self._authority = [float(np.linalg.norm(most[part])) for part in parts]
        # What has come, and what was wrong with it.
        self.validator = Validator(size == 2, self.oldest)
        self._parts = {topic: _Part() for topic in interface.inputs}
        self.reading: dict[str, np.ndarray] = {}
        """The state of the craft as far as it is known: fields of `rans_robot.frames.Motion` by name."""
        self._filter: VelocityFilter | None = None
        if not interface.has_velocity:
            rows = [np.linalg.norm(self._shares[:, part], axis=1) for part in parts]
            agility = float(rows[0].max()), float(rows[1].max())
            self._filter = VelocityFilter(agility, plan.pose_noise)
        self._last: dict[str, tuple[int, np.ndarray]] = {}
        """When each field was measured last, ns, and what."""
        self._gap = np.zeros(6)
        """Changes of pose, m and rad, that velocities did not make, in all."""
        self._gaps: deque[list[float]] = deque(maxlen=2 + math.ceil(_WINDOW / self.period))
        """Those changes as they stood at the last decisions."""
        self._given = 0.0
        """Change of speed, m/s, or of spin, rad/s, by the last command."""
        self._began: int | None = None
        self._alarm: tuple[int, int, str] | None = None
        """Since when and when last readings contradicted one another, ns, and how."""

    # Readings

    def refuse(self, topic: str, now: int, why: str) -> None:
        """Remember why a message gave no reading."""
        if topic in self._parts:
            self._parts[topic].refused = (now, why)

    def take(self, topic: str, reading: Reading, now: int) -> str:
        """Take a reading that came at a time, ns, or refuse it (`ValueError`); what is to be said of it.

        Parts of a state come by topic; what a message does not have stays as the last message had it.
        """
        part = self._parts[topic]
        verdict = self.validator.state(topic, reading, now)
        moment = verdict.moment
        if moment is None:  # a reading that is published again is no newer
            stamp = f"{reading.measured * 1e-9:.6f} s"
            why = f"messages come, but all have the time stamp {stamp}: is the sensor or its clock frozen?"
            self.refuse(topic, now, why)
            return ""
        if verdict.hurries:
            self._raise(now, f"{topic}: {verdict.hurries}")
        note = verdict.note
        values = {
            name: (moment, value)
            for name in Motion._fields
            if (value := getattr(reading, name)) is not None
        }
        if verdict.was_set:
            self._forget()
        # A craft that is where no thrust brings it is there if it stays.
        elif leap := self._leap(values, self._last):
            self._raise(now, f"{topic}: {leap}")
            agrees = part.strays and not self._leap(values, part.stray)
            part.strays = part.strays + 1 if agrees else 1
            part.stray = values
            if part.strays < RULES["clock"].limits[0]:
                raise ValueError(f"{leap}: dropped")
            note = f"{leap}, and it stays there: velocities begin anew"
            self._forget()
        part.strays = 0
        part.fresh = True
        part.moved |= any(
            name not in self._last or (value != self._last[name][1]).any()
            for name, (_, value) in values.items()
        )
        self._follow(values)
        self._last |= values
        self.reading |= {name: value for name, (_, value) in values.items()}
        if self._filter is not None:
            motion = self._filter.update(
                reading.measured, self.reading["position"], self.reading["attitude"]
            )
            self.reading |= motion._asdict()
            self._last |= {name: (moment, getattr(motion, name)) for name in ("velocity", "spin")}
        if part.came is not None:
            part.intervals.append((now - part.came) * 1e-9)
        part.came = now
        part.moment = moment
        part.refused = None
        return note

    def _forget(self) -> None:
        """Begin anew: what comes now does not go on from what came before."""
        self._last.clear()
        self._gaps.clear()
        if self._filter is not None:
            self._filter.begin()

    def _leap(
        self,
        values: Mapping[str, tuple[int, np.ndarray]],
        last: Mapping[str, tuple[int, np.ndarray]],
    ) -> str:
        """What of a reading no thrust makes of another one, in a sentence; "" if it may be."""
        limits = RULES["jump"].limits
        for name, (moment, value) in values.items():
            if name not in last:
                continue
            came, before = last[name]
            step = max(0.0, (moment - came) * 1e-9)
            at = Motion._fields.index(name)
            rate = self._authority[at % 2] * step
            most = limits[at] + (rate if at > 1 else (limits[at + 2] + 0.5 * rate) * step)
            _, speed = last.get(Motion._fields[at % 2 + 2], (0, _STILL))
            if name == "attitude":
                cosine = min(1.0, abs(float(value @ before)))
                off = 2.0 * math.acos(cosine) - step * math.hypot(*speed)
            elif name == "position":
                off = math.hypot(*(value - before - step * speed))
            else:
                off = math.hypot(*(value - before))
            if off > most:
                unit = ("m", "rad", "m/s", "rad/s")[at]
                return (
                    f"the {name} changes by {off:.3g} {unit} in {step:.3f} s beyond its speed, and thrust changes "
                    f"it by at most {most:.2g} {unit}: do two send, or did the sensor take another body for it"
                )
        return ""

    def _follow(self, values: Mapping[str, tuple[int, np.ndarray]]) -> None:
        """Add up what of the change of the pose velocities do not make, as far as both are measured."""
        if self._filter is not None or not {"position", "velocity", "spin"} <= self._last.keys():
            return
        if "position" in values:
            moment, position = values["position"]
            came, before = self._last["position"]
            step = (moment - came) * 1e-9
            turn = small_turns(self._last["attitude"][1], values["attitude"][1])
            self._gap[:3] += position - before - step * self._last["velocity"][1]
            self._gap[3:] += turn - step * self._last["spin"][1]

    # Decisions

    def unfit(self, now: int) -> tuple[str, bool] | None:
        """Why there is no state to decide by, and whether that ends the flight; None: there is one.

        A state is as old as the oldest of its parts, each of which has a topic.

        The order counts: what is missing is named before what is stale, and rates are judged only of fresh states.
        """
        # Ages, s; of a part that never came, since the begin.
        began = self._began = now if self._began is None else self._began
        ages = {
            topic: (now - (began if part.moment is None else part.moment)) * 1e-9
            for topic, part in self._parts.items()
        }
        age = max(ages.values())
        if missing := self._missing():
            if age > self._plan.wait:
                return self._no_state(missing, now, age), True
            causes = self._causes(missing, now)
            return f"waiting for a state on {' and '.join(missing)}{causes}", False
        alarm = self.contradiction(now)
        # Parts that are older than the contract allows: wait, or give the robot up.
        stale = [topic for topic in ages if ages[topic] > self.oldest + 1e-9]
        if stale:
            on = " and ".join(stale)
            causes = self._causes(stale, now)
            if age > self._lost_after:
                return f"the robot is lost: its last state on {on} is {age:.2f} s old{causes}", True
            return (
                f"the state on {on} is {age:.2f} s old, more than the {self.oldest:g} s of the contract{causes}",
                False,
            )
        # Parts that come too seldom, in the median.
        (most,) = RULES["rate"].limits
        for topic, part in self._parts.items():
            usual = sorted(part.intervals)[_SPREAD // 2] if len(part.intervals) == _SPREAD else 0.0
            if usual > most * self.period:
                return (
                    f"states on {topic} come every {usual:.2f} s, but the agent decides every {self.period:g} s",
                    True,
                )
        if alarm is None:
            return None
        since, sentence = alarm
        return sentence, (now - since) * 1e-9 > self._lost_after

    def contradiction(self, now: int) -> tuple[int, str] | None:
        """Since when, ns, and how readings contradict one another or commands; asked once at each decision.

        None: they do not, and did not within the last periods.
        """
        self._contradict(now)
        if self._alarm is None or now - self._alarm[1] > PERSISTS * self.period * 1e9:
            return None
        since, _, sentence = self._alarm
        return since, sentence

    def _raise(self, now: int, sentence: str) -> None:
        """Readings contradict one another at a time, ns."""
        since = now
        if self._alarm is not None and now - self._alarm[1] <= PERSISTS * self.period * 1e9:
            since = self._alarm[0]
        self._alarm = (since, now, sentence)

    def _contradict(self, now: int) -> None:
        """Compare the readings of a period with the command and with one another, once at each decision."""
        (least,) = RULES["still"].limits
        for topic, part in self._parts.items():
            if part.moved:
                part.still = 0
                part.due = 0.0
            elif part.fresh:
                part.still += self._given > 0.0
                part.due += self._given
            part.fresh = False
            part.moved = False
            if part.still >= PERSISTS and part.due > least:
                self._raise(
                    now,
                    f"{topic}: its readings repeat, though thrust was given: is the sensor frozen, or blind",
                )
        # The pose and its velocities, over the time that is remembered.
        if not {"velocity", "spin"} <= self._last.keys():
            return
        self._gaps.append(self._gap.tolist())
        for at, (name, unit) in enumerate((("velocity", "m"), ("spin", "rad"))):
            axes = slice(3 * at, 3 * at + 3)
            off = math.dist(self._gaps[-1][axes], self._gaps[0][axes])
            most = RULES["twist"].limits[at if any(self._last[name][1].tolist()) else at + 2]
            if off > most:
                self._raise(
                    now,
                    f"the pose moved by {off:.2g} {unit} that its velocities do not make, at most {most:g} {unit}: "
                    "is one of both frozen, in another frame or unit, or of another body",
                )

    def observed(self, row: Any) -> np.ndarray:
        """Observation (width,), float32, of an agent; `ValueError` if a column is beyond what it may be."""
        result = np.array(row, dtype=np.float32)
        values = result.tolist()
        if _within(values, *self._refused):
            return result
        rows = zip(self._columns, values, *self._refused, strict=True)
        name, value, low, high = next(row for row in rows if not row[2] <= row[1] <= row[3])
        raise ValueError(
            f"{name} is {value:g}, which is no reading: it must be from {low:g} to {high:g}"
        )

    def commanded(self, values: Any) -> np.ndarray:
        """A command (n,) of the craft, within its limits; `ValueError` if it is none."""
        return command(values, *self._commands)

    def gave(self, command: np.ndarray) -> None:
        """The command (n,) of a period, from which motion is due in the next one."""
        pushed = (command[: len(self._shares)] @ self._shares).tolist()
        self._given = max(map(abs, pushed)) * self.period

    def never_came(self, now: int) -> str:
        """Why no state was complete until a time, ns, in a sentence; "" if one was or nothing was decided."""
        missing = self._missing()
        if not missing or self._began is None:
            return ""
        return f"{self._no_state(missing, now, (now - self._began) * 1e-9)}."

    def _missing(self) -> list[str]:
        """Topics of the state on which no reading ever came."""
        return [topic for topic, part in self._parts.items() if part.moment is None]

    def _no_state(self, missing: list[str], now: int, age: float) -> str:
        """Sentence that no reading has come on the missing topics for an age in s, with the usual cause."""
        causes = self._causes(missing, now)
        came = [topic for topic in self._parts if topic not in missing]
        robot = self._plan.robot
        if not causes and came:
            causes = f" (only {' and '.join(came)} came: is the robot another kind than --robot {robot}?)"
        elif not causes:
            causes = (
                " (is the robot, or its twin, running on the same bus and in the same domain, and does it "
                f"publish these topics, as --robot {robot} expects?)"
            )
        over = f" over {self._link}" if self._link else ""
        return f"no state came on {' and '.join(missing)}{over} for {age:.2f} s{causes}"

    def _causes(self, topics: list[str], now: int) -> str:
        """Why there is no new reading on topics on which messages come, as " (...)"; "" where none come."""
        recent = [
            f"{topic}: {refused[1]}"
            for topic in topics
            if (refused := self._parts[topic].refused) is not None
            and (now - refused[0]) * 1e-9 <= self._plan.lost_after
        ]
        return f" ({'; '.join(recent)})" if recent else ""
