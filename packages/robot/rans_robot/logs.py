"""Logs of flights from bags: what a robot published and what it was commanded.

Bags are strangers' files: sizes, times and frames are checked; a log has the form of `rans_robot.identify.log`.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rans.extend import ConfigError, Spacecraft, brief, counted
from rans_robot.bag import BagMessage, bag_entries
from rans_robot.identify.log import MOST_READINGS, FlightLog
from rans_robot.interfaces import Interface, RobotName
from rans_robot.monitor import Validator
from rans_robot.node import FLIGHT_TOPIC, plan_in

_MOST_LISTED = 20
"""Topics of a bag that a message lists."""
_LATEST = 2**62
"""ns: largest time that is read, a century hence; times and their differences fit 64 bits."""
_NEAR = 30 * 10**9
"""ns: messages of so long a part, and of those beside it, give the difference of two clocks, which drift apart by
1 ms in that time at worst."""
_RATE = 0.01
"""Difference of the rates of two clocks that is refused, a hundred times that of crystals."""
_SET = 5 * 10**8
"""ns: difference of the lengths of a log by two clocks that is refused, if it is above that of `_RATE` too."""


@dataclass
class _Topic:
    """Readings of one topic, in the order of the bag."""

    arrived: list[int] = field(default_factory=list)
    """When the bag recorded each, ns."""
    stamps: list[int] = field(default_factory=list)
    """When each was measured by its sender's clock, ns; 0: not said."""
    parts: list[tuple[Any, ...]] = field(default_factory=list)
    """Position, attitude, velocity and spin; None: not in this message."""


def read_bag(
    source: Path, craft: Spacecraft, robot: RobotName | None = None, namespace: str = ""
) -> FlightLog:
    """Log of a bag (.mcap), of `rans fly` or of ``ros2 bag record``.

    Readings have the times at which they were measured, by their time stamps: the message that came soonest gives
    the difference of the sender's clock from the bag's, as in flight (`rans_robot.monitor`). Commands have
    no time stamp: theirs are the times at which they were recorded.

    Args:
        source: the bag, which may end anywhere, or the folder of ``ros2 bag record`` with its parts.
        craft: spacecraft, in whose order commands are.
        robot: kind of robot (`rans_robot.interfaces`); None: the bag says it, or "ros".
        namespace: name before the topics of the robot, such as "robot1".

    Raises:
        ConfigError: the file is no bag, none of its messages is a pose or a command of this kind of robot, or the
            clocks of messages and bag do not agree.
    """
    kind: RobotName = robot or "ros"
    ends = Interface(kind, craft.command_count, craft.thruster_count)
    prefix = namespace.strip("/") + "/" if namespace.strip("/") else ""
    topics: dict[str, _Topic] = {}
    commands: dict[int, np.ndarray] = {}
    validator = Validator(craft.dimension == 2, np.inf)
    counts: Counter[str] = Counter()
    refused: Counter[str] = Counter()
    reasons: dict[str, str] = {}
    """Why the first message of a topic was refused."""
    seen: set[str] = set()
    is_of_rans = False
    # Commands and readings, message by message, and why others are refused.
    for entry in _entries(source):
        if entry.topic == FLIGHT_TOPIC and robot is None:
            plan = plan_in(source, entry)
            ends = Interface(plan.robot, craft.command_count, craft.thruster_count)
            is_of_rans = True
            continue
        seen.add(entry.topic)
        if not entry.topic.startswith(prefix):
            continue
        topic = entry.topic.removeprefix(prefix)
        kinds = ends.inputs | ends.outputs
        if topic not in kinds:
            continue
        counts[topic] += 1
        if counts[topic] > MOST_READINGS:
            raise ConfigError(
                f"the bag {source} has more than {MOST_READINGS:,} messages of {topic}, the most that are fitted: "
                "cut it."
            )
        try:
            if entry.kind != kinds[topic]:
                raise ValueError(f"its type is {brief(entry.kind)}, and {kinds[topic]} is read")
            if not 0 <= entry.time < _LATEST:
                raise ValueError(f"its time is {entry.time:,} ns")
            if topic in ends.outputs:
                command = ends.commanded(topic, entry.data)
                if command is not None:
                    commands[entry.time] = command
                continue
            stamp, parts = _reading(ends, validator, topic, entry.data)
            column = topics.setdefault(topic, _Topic())
            column.arrived.append(entry.time)
            column.stamps.append(stamp)
            column.parts.append(parts)
        except ValueError as error:  # a message that the robot's node would refuse too
            refused[topic] += 1
            reasons.setdefault(topic, f"; {topic}: {error}")
    given = np.array(sorted(commands), dtype=np.int64)
    count = sum(len(column.parts) for column in topics.values())
    if not count or not len(given):
        raise ConfigError(
            f"the bag {source} has {count} readings and {len(given)} commands on the topics "
            f"{', '.join(prefix + topic for topic in (*ends.inputs, *ends.outputs))}{''.join(reasons.values())}; "
            f"{_cause(ends, prefix, seen, is_of_rans)}."
        )
    # Both by the bag's clock, in the order of time, in seconds since the first.
    dated, notes = _dated(source, prefix, topics)
    times, position, attitude, velocity, spin = _merged(dated, topics)
    notes = [
        f"{source}: commands have no time stamp; theirs are the times at which they were recorded.",
        *notes,
        *(
            f"{source}: {counted(count, 'message')} left out{reasons[topic]}."
            for topic, count in refused.items()
        ),
    ]
    begin = min(int(times[0]), int(given[0]))
    # Of readings in space a planar craft has its plane.
    flat = craft.dimension == 2
    return FlightLog(
        str(source),
        (given - begin) * 1e-9,
        np.array([commands[int(time)] for time in given]),
        (times - begin) * 1e-9,
        position[:, :2] if flat else position,
        2.0 * np.arctan2(attitude[:, 3], attitude[:, 0]) if flat else attitude,
        velocity[:, :2] if flat else velocity,
        spin[:, 2] if flat else spin,
        tuple(notes),
    )


def _entries(source: Path) -> Iterator[BagMessage]:
    """Messages of a bag, or of the parts in a folder of ``ros2 bag record`` in the order of their numbers.

    Raises:
        ConfigError: the folder holds no MCAP.
    """
    if not source.is_dir():
        yield from bag_entries(source)
        return
    parts = sorted(source.glob("*.mcap"), key=_number)
    if not parts:
        raise ConfigError(
            f"the folder {source} has no .mcap: it is no bag, or one in another form, which `ros2 bag convert` "
            "writes as MCAP (storage mcap, no compression_mode)."
        )
    for part in parts:
        yield from bag_entries(part)


def _number(part: Path) -> tuple[int, str]:
    """Number of a part, as that of mybag_10.mcap, by which parts are sorted."""
    number = re.search(r"_(\d{1,9})$", part.stem)
    return (int(number[1]) if number else 0, part.name)


def _reading(
    ends: Interface, validator: Validator, topic: str, data: bytes
) -> tuple[int, tuple[Any, ...]]:
    """Time stamp (ns), and pose and twist of a message, in SI (else `ValueError`).

    Every message goes through the validator of flights, which raises for what it refuses.
    """
    reading = ends.read(topic, data)
    validator.pose(topic, reading)
    if not 0 <= reading.measured < _LATEST:
        raise ValueError(f"its time stamp is {reading.measured:,} ns")
    parts = reading.position, reading.attitude, reading.velocity, reading.spin
    return reading.measured, parts


def _cause(ends: Interface, prefix: str, seen: set[str], is_of_rans: bool) -> str:
    """Why a bag may have no readings or no commands, from the topics that it has."""
    below = {
        topic.removesuffix(f"/{end}")
        for topic in seen
        for end in (*ends.inputs, *ends.outputs)
        if topic.endswith(f"/{end}")
    } - {prefix.rstrip("/")}
    listed = ", ".join(sorted(seen)[:_MOST_LISTED]) or "none"
    more = f" and {len(seen) - _MOST_LISTED:,} more" if len(seen) > _MOST_LISTED else ""
    has = f"the bag has {listed}{more}"
    if below:
        names = " or ".join(f"--namespace {name}" for name in sorted(below)[:_MOST_LISTED])
        return f"{has}: name what stands before the topics with {names}"
    if is_of_rans:
        return "no state came while `rans fly` recorded it, as when the robot or its twin was not there"
    return f"{has}: name the kind of robot with --robot"


def _dated(
    source: Path, prefix: str, topics: dict[str, _Topic]
) -> tuple[dict[str, np.ndarray], list[str]]:
    """When the readings of each topic were measured, by the bag's clock, ns, and sentences on how that was found.

    Raises:
        ConfigError: the clock of time stamps runs at another rate than the bag's, or was set.
    """
    times = {}
    notes = []
    for topic, column in topics.items():
        arrived = np.array(column.arrived, dtype=np.int64)
        stamps = np.array(column.stamps, dtype=np.int64)
        name = prefix + topic
        if not (stamps > 0).all() or (len(stamps) > 1 and np.ptp(stamps) == 0):
            notes.append(
                f"{source}: {name} lacks time stamps in headers; its readings are dated by when they were "
                "recorded, which a link makes late and uneven: forces and delays err by it, beyond their intervals."
            )
            times[topic] = arrived
            continue
        by_bag = int(np.ptp(arrived))
        by_stamps = int(np.ptp(stamps))
        if abs(by_bag - by_stamps) > max(_SET, _RATE * by_bag):
            raise ConfigError(
                f"the bag {source}: {name} covers {by_stamps * 1e-9:.4g} s by its time stamps and "
                f"{by_bag * 1e-9:.4g} s by the bag's clock; a simulator that is slower than real time is recorded "
                "with --use-sim-time, and a clock may not be set during a flight."
            )
        # Topics that have stamps in common have one clock, and what was measured at once stays at one time.
        others = [other for other in times if np.isin(stamps, topics[other].stamps).any()]
        both_arrived = np.concatenate([arrived, *(topics[other].arrived for other in others)])
        both_stamps = np.concatenate([stamps, *(topics[other].stamps for other in others)])
        measured = _by_bag_s_clock(both_arrived, both_stamps)
        ends = np.cumsum([len(stamps), *(len(topics[other].stamps) for other in others)])
        times |= dict(zip([topic, *others], np.split(measured, ends[:-1]), strict=True))
    # What the delays on the way were, as sentences.
    for topic, measured in times.items():
        late = (np.array(topics[topic].arrived) - measured) * 1e-6
        if late.any():
            notes.append(
                f"{source}: {prefix}{topic} is dated by its time stamps; its messages were recorded up to "
                f"{late.max():.3g} ms later than the soonest, {np.median(late):.3g} ms in the median."
            )
    return times, notes


def _by_bag_s_clock(arrived: np.ndarray, stamps: np.ndarray) -> np.ndarray:
    """When messages (N,) were measured by the clock of their arrival, ns.

    The least difference of both clocks nearby is that of the message that came soonest, and that delay is part of
    it: it cannot be told from a difference of the clocks.
    """
    difference = arrived - stamps
    parts, which = np.unique((arrived - arrived.min()) // _NEAR, return_inverse=True)
    least = np.full(len(parts), np.iinfo(np.int64).max)
    np.minimum.at(least, which, difference)
    # With the parts beside it, where there are any.
    beside = np.diff(parts) == 1
    near = least.copy()
    near[1:][beside] = np.minimum(near[1:][beside], least[:-1][beside])
    near[:-1][beside] = np.minimum(near[:-1][beside], least[1:][beside])
    return stamps + near[which]


def _merged(dated: dict[str, np.ndarray], topics: dict[str, _Topic]) -> tuple[np.ndarray, ...]:
    """Times (M,) of readings, ns, ascending, and what was measured then; NaN is what was not.

    That is position (M, 3), attitude (M, 4), velocity (M, 3) and spin (M, 3).
    """
    times = np.unique(np.concatenate(list(dated.values())))
    rows = tuple(np.full((len(times), size), np.nan) for size in (3, 4, 3, 3))
    for topic, own in dated.items():
        for row, parts in zip(np.searchsorted(times, own), topics[topic].parts, strict=True):
            for values, part in zip(rows, parts, strict=True):
                if part is not None:
                    values[row] = part
    return times, *rows
