"""A log of a flight: the commands of a spacecraft and the readings of its motion, with their times."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rans.errors import ConfigError, brief, counted
from rans.files import read_text
from rans.model.spacecraft import Spacecraft

LARGEST_LOG = 2**28
"""Bytes of a CSV file: an hour of readings at 100 Hz has a quarter of it."""
_FEWEST_READINGS = 20
"""Readings of a log: fewer leave no residuals to judge a fit of a dozen parameters by."""

POSE_COLUMNS = {2: ("x", "y", "heading"), 3: ("x", "y", "z", "qw", "qx", "qy", "qz")}
"""Columns of a CSV file with the pose: m, and rad or the unit quaternion from body to world."""
RATE_COLUMNS = {2: ("vx", "vy", "spin"), 3: ("vx", "vy", "vz", "wx", "wy", "wz")}
"""Columns of a CSV file with the velocity in the world, m/s, and the angular velocity in the body, rad/s."""

_UNITS = ("", "s", "m", "rad", "m/s", "rad/s")
"""Units in parentheses that headings may have."""


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
    wheel_speeds: np.ndarray | None = None
    """(M, W), rad/s: speed of each reaction wheel about its axis, relative to the body; None: not measured."""

    @property
    def duration(self) -> float:
        """Time from the first reading to the last, s."""
        return float(self.times[-1] - self.times[0])

    @property
    def period(self) -> float:
        """Median time between commands, s: the control period."""
        return float(np.median(np.diff(self.command_times)))


def checked_log(log: FlightLog, craft: Spacecraft) -> FlightLog:
    """The log without readings before its first command, if it can be of this spacecraft.

    Raises:
        ConfigError: there are too few commands or readings, times do not ascend, numbers are not finite, or the
            log has another number of commands than the spacecraft.
    """
    what = f"the log {log.source}"
    if log.commands.shape[1] != craft.command_count:
        raise ConfigError(
            f"{what} has {counted(log.commands.shape[1], 'command')} at a time, but {craft.name!r} takes "
            f"{craft.command_count}; is it the log of another spacecraft?"
        )
    if len(log.command_times) < 3:
        raise ConfigError(
            f"{what} has {counted(len(log.command_times), 'command')}; at least 3 are needed."
        )
    for name, times in (("commands", log.command_times), ("readings", log.times)):
        if not (np.isfinite(times).all() and (np.diff(times) > 0.0).all()):
            raise ConfigError(f"{what}: the times of its {name} must be finite and ascend.")
    if not np.isfinite(log.commands).all():
        raise ConfigError(f"{what} has commands that are not finite numbers.")
    low = np.array([command.low for command in craft.commands])
    high = np.array([command.high for command in craft.commands])
    outside = (log.commands < low - 1e-3) | (log.commands > high + 1e-3)
    if outside.any():
        row, column = np.argwhere(outside)[0]
        raise ConfigError(
            f"{what}: command {column} is {log.commands[row, column]:g} at {log.command_times[row]:g} s, but it "
            f"lies between {low[column]:g} and {high[column]:g}; the usual cause is another order of columns."
        )
    inside = (log.times >= log.command_times[0]) & (
        log.times <= log.command_times[-1] + 2.0 * log.period
    )
    if inside.sum() < _FEWEST_READINGS:
        raise ConfigError(
            f"{what} has {counted(int(inside.sum()), 'reading')} while commands were given; at least "
            f"{_FEWEST_READINGS} are needed. Do both have the same clock?"
        )
    parts = {
        name: getattr(log, name)[inside]
        for name in ("times", "position", "attitude", "velocity", "spin")
    }
    speeds = log.wheel_speeds
    if speeds is None:
        speeds = np.full((len(log.times), craft.wheel_count), np.nan)
    if speeds.shape != (len(log.times), craft.wheel_count):
        raise ConfigError(
            f"{what} has speeds of {speeds.shape[1]} wheels, but {craft.name!r} has {craft.wheel_count}."
        )
    parts["wheel_speeds"] = speeds[inside]
    poses = np.column_stack([parts["position"], parts["attitude"]])
    if np.isnan(poses).all():
        raise ConfigError(f"{what} has no poses: positions and attitudes are needed.")
    return FlightLog(log.source, log.command_times, log.commands, **parts)


def _column(cell: str, what: str) -> str:
    """Name of a column from a cell of the first line, which may have a unit in parentheses."""
    name, _, unit = cell.strip().lower().partition("(")
    unit = unit.rstrip(") ")
    if unit not in _UNITS:
        raise ConfigError(
            f"{what} has the column {brief(cell.strip())}; units are {', '.join(_UNITS[1:])}, in which its numbers "
            "must be."
        )
    name = name.strip().replace("_", "")
    return {"t": "time", "w": "spin"}.get(name, name)


def read_csv(file: Path, craft: Spacecraft) -> FlightLog:
    """Log of a CSV file whose first line names its columns.

    ``time`` (s) is needed, the pose (`POSE_COLUMNS`), and ``u0`` to ``u<C-1>``, the commands from this row on;
    the velocities (`RATE_COLUMNS`) and the speeds of wheels, ``s0`` and so on (rad/s), may be missing. An empty
    cell is a value that was not measured, or the last command. The file that `rans.Flight.to_csv` writes is such a
    file: units in parentheses and underscores are left out, and ``t`` and ``w`` are ``time`` and ``spin``.

    Raises:
        ConfigError: the file cannot be read, a column is missing, or a cell is no number.
    """
    rows = list(csv.reader(io.StringIO(read_text(file, LARGEST_LOG, "the log "))))
    if not rows:
        raise ConfigError(f"the log {file} is empty.")
    if len(rows[0]) == 1 and ";" in rows[0][0]:
        raise ConfigError(f"the log {file} has semicolons between its columns: write commas.")
    # The header names the columns, in any order.
    header = [_column(cell, f"the log {file}") for cell in rows[0]]
    inputs = [f"u{k}" for k in range(craft.command_count)]
    needed = ["time", *POSE_COLUMNS[craft.dimension], *inputs]
    if missing := [name for name in needed if name not in header]:
        raise ConfigError(
            f"the log {file} has no {', '.join(missing)} among its columns, {brief(', '.join(rows[0]))}; the "
            f"commands of {craft.name} are {inputs[0]} to {inputs[-1]}."
        )
    if more := [name for name in header if re.fullmatch(r"u\d+", name) and name not in inputs]:
        raise ConfigError(
            f"the log {file} has the commands {', '.join(more)} too, but those of {craft.name} are {inputs[0]} to "
            f"{inputs[-1]}; the usual cause is another spacecraft."
        )
    # Cells: an empty one is NaN, since commands and readings have lines of their own.
    numbers = np.full((len(rows) - 1, len(header)), np.nan)
    for k, row in enumerate(rows[1:]):
        if len(row) != len(header):
            raise ConfigError(
                f"the log {file}, line {k + 2}, has {len(row)} cells instead of {len(header)}."
            )
        for j, cell in enumerate(row):
            if not cell.strip():
                continue
            try:
                numbers[k, j] = float(cell)
            except ValueError as error:
                raise ConfigError(
                    f"the log {file}, line {k + 2}, column {header[j]}: {brief(cell)} is no number."
                ) from error

    def columns(names: tuple[str, ...] | list[str]) -> np.ndarray:
        empty = np.full(len(numbers), np.nan)
        return np.column_stack(
            [numbers[:, header.index(name)] if name in header else empty for name in names]
        )

    # Lines with a command, and lines with a reading.
    d = craft.dimension
    pose = columns(POSE_COLUMNS[d])
    rates = columns(RATE_COLUMNS[d])
    speeds = columns([f"s{k}" for k in range(craft.wheel_count)]) if craft.wheels else None
    commands = columns(inputs)
    has_command = ~np.isnan(commands).any(axis=1)
    measured = ~np.isnan(pose).all(axis=1) | ~np.isnan(rates).all(axis=1)
    if speeds is not None:
        measured |= ~np.isnan(speeds).all(axis=1)
    time = columns(["time"])[:, 0]
    return FlightLog(
        str(file),
        time[has_command],
        commands[has_command],
        time[measured],
        pose[measured, :d],
        pose[measured, 2] if d == 2 else pose[measured, 3:],
        rates[measured, :d],
        rates[measured, 2] if d == 2 else rates[measured, 3:],
        None if speeds is None else speeds[measured],
    )
