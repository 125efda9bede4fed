"""Telemetry of the satellite InnoCube, from a clone of the repository kdjebko/lelar-in-orbit-data.

A folder a manoeuvre has CSV files of the attitude (quaternion, scalar first), rates (degrees/s), speeds of the
wheels (revolutions a minute) and commands to them (revolutions a minute and second), a row about every 2 s. Units
are in the cells, and others are refused. Speeds and commands are counted against the axes of the body, which no
file says: a fit with the other sign has wheels of negative inertia. The attitude is that of the body relative to
its goal: it is the identity where the satellite points as it should, and jumps where it is given another goal.
"""

from __future__ import annotations

import csv
import io
from datetime import datetime
from pathlib import Path

import numpy as np

from rans.extend import ConfigError, Spacecraft, brief, read_text
from rans_robot.identify.log import FlightLog

_LARGEST = 2**24
"""Bytes of a file of telemetry; a manoeuvre has 30,000."""
_FILES = {
    "attitude": (("Attitude quaternion*.csv", "attitude.csv"), ("q0", "q1", "q2", "q3"), ""),
    "rates": (("Rates*.csv", "rates.csv"), ("X", "Y", "Z"), "°/s"),
    "speeds": (("RW Speeds*.csv", "wheel-speeds.csv"), ("X", "Y", "Z"), "rpm"),
    "commands": (("RW CMDs*.csv", "wheel-commands.csv"), ("X", "Y", "Z"), "RPM/s"),
}
"""Names of the files, their columns after the time, and the unit of each cell."""
_RPM = 2.0 * np.pi / 60.0
"""rad/s of a revolution a minute."""


def is_telemetry(folder: Path) -> bool:
    """Whether a folder has the attitudes of a manoeuvre."""
    return any(any(folder.glob(pattern)) for pattern in _FILES["attitude"][0])


def rows_of(file: Path, columns: tuple[str, ...], unit: str) -> dict[datetime, list[float]]:
    """Numbers (columns,) of a file of telemetry by their time; later rows of a time win.

    Raises:
        ConfigError: the file cannot be read, or has other columns, units or cells than a time and numbers.
    """
    text = read_text(file, _LARGEST, "the telemetry ").removeprefix("\ufeff")
    lines = list(csv.reader(io.StringIO(text)))
    wanted = ["Time", *columns]
    if not lines or lines[0] != wanted:
        raise ConfigError(
            f"the telemetry {file} must have the columns {', '.join(wanted)}, got "
            f"{brief(', '.join(lines[0]) if lines else '')}."
        )
    rows = {}
    for line, row in enumerate(lines[1:], 2):
        if not row:
            continue
        try:
            time = datetime.fromisoformat(row[0])
            cells = [cell.split() for cell in row[1:]]
            numbers = [float(cell[0]) for cell in cells]
        except (ValueError, IndexError) as error:
            raise ConfigError(
                f"the telemetry {file}, line {line}: a time and numbers are needed, got {brief(row)}."
            ) from error
        if len(numbers) != len(columns) or not np.isfinite(numbers).all():
            raise ConfigError(
                f"the telemetry {file}, line {line}: {len(columns)} finite numbers are needed, got {brief(row)}."
            )
        if any(" ".join(cell[1:]) != unit for cell in cells):
            raise ConfigError(
                f"the telemetry {file}, line {line}: the unit of each number must be "
                f"{unit or 'none'}, got {brief(row)}."
            )
        rows[time] = numbers
    return rows


def read_telemetry(folder: Path, craft: Spacecraft) -> FlightLog:
    """Log of a folder at the times that all its files have.

    Raises:
        ConfigError: a file is missing or cannot be read, no time is in all of them, or the craft has not three
        wheels.
    """
    if len(craft.wheels) != 3 or craft.thrusters:
        raise ConfigError(
            f"{folder} is telemetry of a satellite with three reaction wheels alone, and {craft.name!r} has "
            f"{len(craft.wheels)} and {len(craft.thrusters)} thrusters."
        )
    tables = []
    for patterns, columns, unit in _FILES.values():
        files = sorted({file for pattern in patterns for file in folder.glob(pattern)})
        if len(files) != 1:
            raise ConfigError(f"{folder} must have one file {patterns[0]}, got {len(files)}.")
        tables.append(rows_of(files[0], columns, unit))
    times = sorted(set.intersection(*(set(table) for table in tables)))
    if len(times) < 3:
        raise ConfigError(f"{folder} has {len(times)} times that are in all of its files.")
    # Units and signs as RANS has them.
    q, rates, speeds, commands = (np.array([table[time] for time in times]) for table in tables)
    seconds = np.array([(time - times[0]).total_seconds() for time in times])
    rates = np.deg2rad(rates)
    largest = np.array([wheel.max_torque / wheel.inertia for wheel in craft.wheels])
    nothing = np.full_like(rates, np.nan)
    return FlightLog(
        str(folder),
        seconds,
        -commands * _RPM / largest,
        seconds,
        nothing,
        q,
        nothing,
        rates,
        -speeds * _RPM,
        (
            f"{folder}: quaternions are read scalar first, from body to the goal, rates in degrees/s, speeds in "
            "revolutions a minute against the axes of the body.",
        ),
    )
