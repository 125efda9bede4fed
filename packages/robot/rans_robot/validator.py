"""The validator of all messages, of every kind of robot: a message is a stranger's file.

What is refused raises a `ValueError`, whose sentence names the value and the usual cause, and changes nothing: no
reading, no velocity filter, no goal. The functions judge a message by itself, a `Validator` by those before it. The
pilot shuts all valves on what is refused here, so a new check needs its flight in `tests/test_node.py`.
"""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple

import numpy as np

from rans.extend import brief, is_finite
from rans_robot.messages import read_table

LARGEST_MESSAGE = 4096
"""Bytes: an Odometry with its covariances has 730."""

_LONGEST_PERIOD = 3600.0
"""s of a control period."""
_LENGTHS = (0.9, 1.1)
"""Lengths of a quaternion that is one: rounding and averaging change less, and an unset one has none."""
LIMITS = {"position": 1e5, "velocity": 100.0, "angular velocity": 100.0}
"""m, m/s and rad/s, of each number: beyond all that a thruster-driven craft near its goal does."""
_STEEPEST = np.cos(np.radians(30.0))
"""A craft on a floor tilts by less than a degree; markers may be mounted askew."""
_HIGHEST = 2.0
"""m above or below the plane of a planar craft, whose frame may begin at the floor or on the ceiling."""
_OF_THE_WORLD = ("map", "odom", "world", "earth")
"""Names that ROS's REP 105 gives to frames which are none of a body."""
_AGREEING = 3
"""Messages in a row that show that a clock was set: one alone is a stray."""
_MOST_OF_RUN = 50
"""Messages in a row by which it is judged whether they come as slowly as they were measured."""
_DRIFT = 1e-3
"""s a second by which a sender's clock may run slow: crystals drift by 1e-4, NTP corrects by 5e-4 at most."""


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


# One message by itself


def finite_vector(what: str, values: Any) -> np.ndarray:
    """Three numbers of a position (m), velocity (m/s) or angular velocity (rad/s), checked (`ValueError`)."""
    result = np.array(values, dtype=float)
    limit = LIMITS[what]
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
    low, high = _LENGTHS
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
    slack = 1e-6  # rounding of float32
    if (
        result.shape != np.shape(low)
        or not ((result >= np.subtract(low, slack)) & (result <= np.add(high, slack))).all()
    ):
        raise ValueError(
            f"the command is {_text(values)}, but must be {np.size(low)} numbers from {_text(low)} to "
            f"{_text(high)}: is it for another spacecraft?"
        )
    return np.clip(result, low, high)


class Description(NamedTuple):
    """Description of the spacecraft that a robot is."""

    name: str
    """As it may stand in a sentence."""
    sha256: str
    control_period: float
    """s."""


def description(data: bytes) -> Description:
    """Spacecraft in a message of `rans_robot.pilot.CRAFT_TOPIC`, checked (`ValueError`)."""
    table = _table(data)
    name, digest, period = (table.get(key) for key in ("name", "sha256", "control_period"))
    if not isinstance(name, str) or not isinstance(digest, str):
        raise ValueError(
            f"name and sha256 of the spacecraft must be texts, got {brief(name)} and {brief(digest)}"
        )
    if not is_finite(period) or not 0.0 < period <= _LONGEST_PERIOD:  # type: ignore[operator]
        raise ValueError(
            f"control_period must be a number of seconds above 0 and at most {_LONGEST_PERIOD:g}, got "
            f"{brief(period)}"
        )
    return Description(brief(name), digest, float(period))  # type: ignore[arg-type]


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
    if len(data) > LARGEST_MESSAGE:
        raise ValueError(
            f"a message has {len(data):,} bytes, and at most {LARGEST_MESSAGE:,} are read"
        )
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
        if position is not None and abs(position[2]) > _HIGHEST:
            raise ValueError(
                f"a craft of the plane is {position[2]:.3g} m above it, but must be within {_HIGHEST:g} m: is the "
                "sensor wrong, or z the axis that points up?"
            )
        if attitude is not None:
            _, x, y, _ = attitude
            upright = 1.0 - 2.0 * (x * x + y * y)  # z component of the body's z axis
            if upright < _STEEPEST:
                tilt = np.degrees(np.arccos(np.clip(upright, -1.0, 1.0)))
                raise ValueError(
                    f"a craft of the plane is tilted by {tilt:.0f} degrees, but must be by at most 30: is the "
                    "sensor wrong, or z the axis that points up?"
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
        self._recent: deque[int] = deque(maxlen=_AGREEING)
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
        difference = now - stamp
        least = self._difference + round(_DRIFT * (now - self._came))
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
                f"a message came {late:.2f} s later than it should by its time stamp: dropped; is the link "
                "behind, or was a process stopped?"
            )
        self._recent.append(difference)
        self._newest = stamp
        self._came = now
        self._difference = min(least, max(self._recent))
        return MessageVerdict(min(stamp + self._difference, now))

    def _begin(self, stamp: int, now: int) -> MessageVerdict:
        """The first message of a clock counts as measured when it came."""
        self._newest = stamp
        self._came = now
        self._difference = now - stamp
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
        if len(self._other) < _AGREEING:
            return False
        # Messages that waited come together, and are no clock.
        first, came = self._other[0]
        return now - came >= (stamp - first) // 2
