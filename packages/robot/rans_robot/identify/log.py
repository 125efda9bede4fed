"""A log of a flight: the commands of a spacecraft and the readings of its motion, with their times.

Times are in s, positions in m in W, quaternions w first, rates in rad/s in B; every reader makes a log of this
form.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import rans.base.csv_file
from rans.extend import ConfigError, Spacecraft, brief, counted
from rans_robot.monitor import PERSISTS, Monitor, Reading

LARGEST_LOG = 2**28
"""Bytes of a CSV file: an hour of readings at 100 Hz has a quarter of it."""
_FEWEST_READINGS = 20
"""Readings of a log: fewer leave no residuals to judge a fit of a dozen parameters by."""
MOST_READINGS = 2**19
"""Readings of a log: an hour at 100 Hz has 360,000, and a fit takes some kilobytes for each."""
_LONGEST_LOG = 7200.0
"""s: longest log. Predictions have at least 50 instants a second, for each of which a fit takes some kilobytes."""
_SHORTEST_PERIOD = 1e-4
"""s: least median time between commands or readings, a tenth of that of the fastest motion capture."""
_LONGEST_PERIOD = 60.0
"""s: largest one; from windows of 5 to 40 s with one reading nothing is identified."""
_BOUNDS = {
    "position": (1e9, "m"),
    "attitude": (1e6, "rad"),
    "velocity": (1e6, "m/s"),
    "spin": (1e4, "rad/s"),
}
"""Largest readings, far above those of any laboratory; a heading of 1e6 rad still has nine digits of an angle."""

_POSE_NOISE = (0.002, 0.005)
"""m and rad: noise of poses, by which velocities are filtered where none were measured, as in flight."""
_MOST_WRONG = 0.2
"""Part of the readings up to which they may be left out."""

_COLUMNS = {
    2: {"x": "m", "y": "m", "heading": "rad", "vx": "m/s", "vy": "m/s", "spin": "rad/s"},
    3: {
        **dict.fromkeys("xyz", "m"),
        **dict.fromkeys(("qw", "qx", "qy", "qz"), ""),
        **dict.fromkeys(("vx", "vy", "vz"), "m/s"),
        **dict.fromkeys(("wx", "wy", "wz"), "rad/s"),
    },
}
"""Columns of a CSV file with their units, by the dimension: the pose (of a unit quaternion from body to world), the
velocity in the world and the angular velocity in the body."""
SIZES = {2: (2, 1, 2, 1), 3: (3, 4, 3, 3)}
"""Entries of position, attitude, velocity and spin in a state, by the dimension."""

_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units in parentheses that the heading of times may have, s."""
_SPELLINGS = {"t": "time", "w": "spin"}
"""Names of columns as `rans.episode.flight.Flight.to_csv` writes them."""


@dataclass(frozen=True)
class FlightLog:
    """Commands and readings of one flight.

    A planar craft has d = 2 and its heading as attitude, (M,); in space d = 3 and attitudes are unit quaternions
    (w, x, y, z) from body to world, (M, 4). Values that were not measured are NaN.
    """

    source: str
    """Where it comes from, for messages."""
    command_times: np.ndarray
    """(T,), s: when each command was given; it holds until the next one."""
    commands: np.ndarray
    """(T, C), in the order of the spacecraft's commands."""
    times: np.ndarray
    """(M,), s, ascending: when the readings were taken, by the same clock."""
    position: np.ndarray
    """(M, d), m, in the world frame W."""
    attitude: np.ndarray
    """(M,) heading, rad, or (M, 4) quaternion."""
    velocity: np.ndarray
    """(M, d), m/s, in W."""
    spin: np.ndarray
    """(M,) or (M, 3), rad/s, in the body frame B."""
    notes: tuple[str, ...] = ()
    """Sentences of its reader: units, frames and clocks as it took them, and what it left out."""

    @property
    def duration(self) -> float:
        """Time from the first reading to the last, s."""
        return float(self.times[-1] - self.times[0])

    @property
    def period(self) -> float:
        """Median time between commands, s: the control period."""
        return float(np.median(np.diff(self.command_times)))


def checked_log(log: FlightLog, craft: Spacecraft) -> FlightLog:
    """The log without readings before its first command, if it can be of this spacecraft; times are from that on.

    Times since 1970 have seven digits of a second: differences of such numbers would be those of rounding.

    Raises:
        ConfigError: there are too few or too many commands or readings, times do not ascend or cannot be seconds,
            numbers are not finite or beyond all measure, or the log has another number of commands than the
            spacecraft.
    """
    what = f"the log {log.source}"
    # Commands of this craft, and as many as a fit needs and takes.
    if log.commands.shape[1] != craft.command_count:
        raise ConfigError(
            f"{what} has {counted(log.commands.shape[1], 'command')} at a time, but {craft.name!r} takes "
            f"{craft.command_count}; is it the log of another spacecraft?"
        )
    if len(log.command_times) < 3:
        raise ConfigError(
            f"{what} has {counted(len(log.command_times), 'command')}; at least 3 are needed."
        )
    if len(log.times) > MOST_READINGS:
        raise ConfigError(
            f"{what} has {len(log.times):,} readings; at most {MOST_READINGS:,} are fitted: cut it, or thin it out."
        )
    # Times, then commands within their ranges.
    _check_times(what, "commands", log.command_times)
    _check_times(what, "readings", log.times)
    low, high = np.array([(command.low, command.high) for command in craft.commands]).T
    # Not a number is within no range.
    outside = ~((log.commands >= low - 1e-3) & (log.commands <= high + 1e-3))
    if outside.any():
        row, column = np.argwhere(outside)[0]
        raise ConfigError(
            f"{what}: command {column} is {log.commands[row, column]:g} at {log.command_times[row]:g} s, but it "
            f"lies between {low[column]:g} and {high[column]:g}; the usual cause is another order of columns."
        )
    # Readings while commands were given.
    inside = (log.times >= log.command_times[0]) & (
        log.times <= log.command_times[-1] + 2.0 * log.period
    )
    if inside.sum() < _FEWEST_READINGS:
        raise ConfigError(
            f"{what} has {counted(int(inside.sum()), 'reading')} while commands were given; at least "
            f"{_FEWEST_READINGS} are needed. Do both have the same clock?"
        )
    parts = {name: getattr(log, name)[inside] for name in ("times", *_BOUNDS)}
    result = replace(log, **parts)
    _check_readings(what, result)
    begin = log.command_times[0]
    times = {"command_times": log.command_times - begin, "times": result.times - begin}
    return _believed(what, replace(result, **times), craft)


def _believed(what: str, log: FlightLog, craft: Spacecraft) -> FlightLog:
    """The log without readings that a monitor of flights does not believe, in a note.

    Raises:
        ConfigError: they are more than a few, which is no fault of a moment.
    """
    has_rates = not (np.isnan(log.velocity).all() or np.isnan(log.spin).all())
    interface = SimpleNamespace(inputs=("pose", "twist")[: 1 + has_rates], has_velocity=has_rates)
    plan = SimpleNamespace(lost_after=np.inf, wait=np.inf, pose_noise=_POSE_NOISE)
    contract = {"control_period": log.period, "readings": {"oldest": np.inf}, "observation": []}
    monitor = Monitor(craft, contract, interface, plan)
    # Readings in space, of which a planar craft has its plane; those of a message are complete.
    position, attitude, velocity, spin = log.position, log.attitude, log.velocity, log.spin
    if craft.dimension == 2:
        position, velocity = (np.pad(x, ((0, 0), (0, 1))) for x in (position, velocity))
        attitude = Rotation.from_euler("z", attitude[:, None]).as_quat(scalar_first=True)
        spin = np.pad(spin[:, None], ((0, 0), (2, 0)))
    pose: Any = ~np.isnan(np.hstack([position, attitude])).any(axis=1)
    twist: Any = ~np.isnan(np.hstack([velocity, spin])).any(axis=1)
    # Readings and commands as they came, by a clock that begins at a second.
    stamps = 10**9 + np.rint(1e9 * log.times).astype(np.int64)
    wrong = np.zeros(len(log.times), bool)
    why = ""
    last = max(log.command_times[-1], log.times[-1]) + log.period
    decisions = np.arange(0.0, last, max(log.period, last / MOST_READINGS))
    held = np.searchsorted(log.command_times, decisions + 1e-9, side="right") - 1
    ends = np.searchsorted(log.times, decisions + 1e-9, side="right")
    begin = 0
    for time, command, end in zip(decisions, held, ends, strict=True):
        for k in range(begin, end):
            stamp = int(stamps[k])
            try:
                if pose[k]:
                    monitor.take("pose", Reading(stamp, position[k], attitude[k]), stamp)
                if has_rates and twist[k]:
                    monitor.take("twist", Reading(stamp, None, None, velocity[k], spin[k]), stamp)
            except ValueError as error:
                wrong[k] = True
                why = why or str(error)
        begin = end
        alarm = monitor.contradiction(10**9 + round(1e9 * time))
        if alarm is not None:
            # A rule needs some periods to be sure.
            since = (alarm[0] - 10**9) * 1e-9 - (1 + PERSISTS) * log.period
            wrong[(log.times > since) & (log.times <= time + 1e-9)] = True
            why = why or alarm[1]
        monitor.gave(log.commands[command])
    if not wrong.any():
        return log
    first = f"the first at {log.times[wrong][0]:.4g} s: {why}"
    if wrong.mean() > _MOST_WRONG:
        raise ConfigError(
            f"{what} has {counted(int(wrong.sum()), 'reading')} of {len(wrong)} that cannot be, {first}. The usual "
            "cause is a column in other units, such as a heading in degrees, or in another frame or order."
        )
    parts = {name: getattr(log, name)[~wrong] for name in ("times", *_BOUNDS)}
    note = f"{log.source}: {counted(int(wrong.sum()), 'reading')} left out, {first}."
    return replace(log, **parts, notes=(*log.notes, note))


def _check_times(what: str, name: str, times: np.ndarray) -> None:
    """Refuse (`ConfigError`) times (n,) that do not ascend, or that cannot be those of one flight in seconds."""
    if len(times) < 2:
        return
    with np.errstate(over="ignore", invalid="ignore"):  # of times of 1e308
        gaps = np.diff(times)
        length = times[-1] - times[0]
    if not (gaps > 0.0).all():
        k = int(np.argmin(gaps > 0.0))
        raise ConfigError(
            f"{what}: the times of its {name} must be finite and ascend, and {times[k + 1]:.15g} s follows "
            f"{times[k]:.15g} s; the usual causes are lines that stand twice or unsorted, and two flights."
        )
    period = float(np.median(gaps))
    largest = int(np.argmax(gaps))
    if not _SHORTEST_PERIOD <= period <= _LONGEST_PERIOD:
        unit = next((x for x, s in _SECONDS.items() if period * s <= _LONGEST_PERIOD), "s")
        question = "other units than s" if unit == "s" else unit
        raise ConfigError(
            f"{what}: the times of its {name} have a period of {period:g} s, and one from {_SHORTEST_PERIOD:g} to "
            f"{_LONGEST_PERIOD:g} s is read; are the times in {question}?"
        )
    if not length <= _LONGEST_LOG:
        if gaps[largest] > 0.5 * length:
            raise ConfigError(
                f"{what}: the times of its {name} jump by {gaps[largest]:.3g} s after {times[largest]:g} s; are "
                "there messages without a time stamp, or two flights?"
            )
        raise ConfigError(
            f"{what}: the times of its {name} cover {length:.4g} s, and at most {_LONGEST_LOG:g} s are fitted: cut "
            "it, or name its parts as logs of their own."
        )


def _check_readings(what: str, log: FlightLog) -> None:
    """Refuse (`ConfigError`) readings beyond all measure, quaternions that are none, and logs without poses."""
    tables = {name: getattr(log, name).reshape(len(log.times), -1) for name in _BOUNDS}
    for name, (bound, unit) in _BOUNDS.items():
        beyond = np.abs(tables[name]) > bound  # NaN, which was not measured, is not
        if beyond.any():
            row, column = np.argwhere(beyond)[0]
            raise ConfigError(
                f"{what}: the {name} at {log.times[row]:g} s is {tables[name][row, column]:g} {unit}, beyond "
                f"{bound:g} {unit}; is it in other units, or damaged?"
            )
    if log.attitude.ndim == 2:
        length = np.linalg.norm(log.attitude, axis=1)
        # Of four digits each, as people write them, it is within 1e-4 of 1.
        wrong = np.abs(length - 1.0) > 0.01
        if wrong.any():
            row = int(np.argmax(wrong))
            raise ConfigError(
                f"{what}: the quaternion at {log.times[row]:g} s has the length {length[row]:.4g} instead of 1; is "
                "the order of columns another one?"
            )
    lacks = {name for name in ("position", "attitude") if np.isnan(tables[name]).all()}
    if lacks or np.isnan(np.hstack([tables["position"], tables["attitude"]])).any(axis=1).all():
        missing = " and no ".join(f"{name}s" for name in sorted(lacks, reverse=True))
        raise ConfigError(
            f"{what} has no {missing or 'reading with both position and attitude'}: a fit of a craft with "
            "thrusters needs positions in the world and attitudes."
        )


def _spelled(cell: str) -> str:
    """A heading in the spelling of this reader; its unit in parentheses stays."""
    name, opened, unit = cell.lower().partition("(")
    name = name.strip().replace("_", "")
    return _SPELLINGS.get(name, name) + opened + unit


def read_csv(file: Path, craft: Spacecraft) -> FlightLog:
    """Log of a CSV file whose first line names its columns.

    ``time`` (s) is needed, the pose (`_COLUMNS`), and ``u0`` to ``u<C-1>``, the commands from this row on; the
    velocities may be missing. An empty cell is a value that was not measured, or the last command;
    an empty line counts as none. The file that
    `rans.episode.flight.Flight.to_csv` writes is such a file: units in parentheses and underscores are left out,
    and ``t`` and ``w`` are ``time`` and ``spin``. Columns of other names are not read.

    Times are in s, or in the unit that stands in the heading, such as ``time (ms)``; they may begin anywhere.

    Raises:
        ConfigError: the file cannot be read, a column is missing, there twice or in another unit, or a cell is no
            number.
    """
    table = rans.base.csv_file.read_csv(file, LARGEST_LOG, "the log ")
    what = table.what
    # The header names the columns, in any order.
    header = tuple(_spelled(cell) for cell in table.header)
    inputs = [f"u{k}" for k in range(craft.command_count)]
    d = craft.dimension
    needed = ["time", *list(_COLUMNS[d])[: sum(SIZES[d][:2])], *inputs]
    units = {
        "time": tuple(_SECONDS),
        **{name: (unit,) if unit else () for name, unit in _COLUMNS[d].items()},
        **dict.fromkeys(inputs, ()),
    }
    places = replace(table, header=header).columns(units)
    if missing := [name for name in needed if name not in places]:
        raise ConfigError(
            f"{what} has no {', '.join(missing)} among its columns, {brief(', '.join(table.header))}; "
            f"{craft.name} has the commands {inputs[0]} to {inputs[-1]}."
        )
    if more := [name for name in header if re.fullmatch(r"u\d+", name) and name not in inputs]:
        raise ConfigError(
            f"{what} has the commands {', '.join(more)} too, but those of {craft.name} are {inputs[0]} to "
            f"{inputs[-1]}; the usual cause is another spacecraft."
        )
    # Cells: an empty one is NaN, since commands and readings have lines of their own; tables of NumPy say nan.
    none = [np.nan] * len(table.rows)
    numbers = dict.fromkeys(units, none) | {
        name: [
            table.number(line, f"column {name}", row[place])
            if row[place].strip().lower() not in ("", "nan")
            else np.nan
            for line, row in table.rows
        ]
        for name, place in places.items()
    }
    _, _, unit = header[places["time"]].partition("(")
    time = np.array(numbers["time"]) * _SECONDS[unit.rstrip(") ") or "s"]

    # Lines with a command, and lines with a reading.
    readings = np.column_stack([numbers[name] for name in _COLUMNS[d]])
    commands = np.column_stack([numbers[name] for name in inputs])
    given = np.flatnonzero(~np.isnan(commands).any(axis=1))
    taken = np.flatnonzero(~np.isnan(readings).all(axis=1))
    notes = [
        f"{file}: times are read in s, positions and velocities in the world in m and m/s, attitudes from body to "
        "world, and angular velocities in the body in rad/s.",
    ]
    if others := [cell for k, cell in enumerate(table.header) if k not in places.values()]:
        notes.append(f"{file}: columns that were not read: {brief(', '.join(others))}.")
    parts = np.split(readings[taken], np.cumsum(SIZES[d])[:-1], axis=1)
    if d == 2:
        parts[1::2] = [part[:, 0] for part in parts[1::2]]
    return FlightLog(
        str(file), time[given], commands[given], time[taken], *parts, notes=tuple(notes)
    )
