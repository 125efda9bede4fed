"""Telemetry of the satellite InnoCube, from a clone of the repository kdjebko/lelar-in-orbit-data.

A folder a manoeuvre has CSV files of the attitude (quaternion, scalar first), rates (degrees/s), speeds of the
wheels (revolutions a minute, counted against the axes of the body) and commands to them (revolutions a minute and
second), a row about every 2 s. The attitude is that of the body relative to its goal: it is the identity where the
satellite points as it should, and jumps where it is given another goal. The repository has no licence, so that
nothing of it is in this one.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from rans.errors import ConfigError, brief
from rans.files import read_text

_LARGEST = 2**24
"""Bytes of a file of telemetry; a manoeuvre has 30,000."""
_FEWEST = 40
"""Rows with which the unknowns of a manoeuvre are fitted to three equations each."""
_FILES = {"Attitude quaternion": 4, "Rates": 3, "RW Speeds": 3, "RW CMDs": 3}
"""First words of the files' names, and numbers in their rows."""
_JUMP = np.deg2rad(60.0)
"""Turn between two rows, beyond that of the rates, from which on the goal has changed. Rates and gaps in the rows
leave up to 25 degrees; new goals are 107 degrees away and more."""
_RPM = 2.0 * np.pi / 60.0
"""rad/s of a revolution a minute."""


@dataclass(frozen=True)
class Telemetry:
    """Readings of a manoeuvre at common times."""

    times: np.ndarray
    """(N,), s from the first."""
    attitude: np.ndarray
    """(N, 3, 3), rotation from body to the frame of the goal."""
    rates: np.ndarray
    """(N, 3), rad/s, in the body."""
    speeds: np.ndarray
    """(N, 3), rad/s, of the wheels against the axes of the body."""
    commands: np.ndarray
    """(N, 3), rad/s^2, accelerations of the wheels that were commanded."""
    goals: np.ndarray
    """(N,), number of the goal, from 0; it rises by one where the attitude jumps."""


def manoeuvre_folders(folder: Path) -> list[Path]:
    """Folders of manoeuvres in a clone, sorted.

    Raises:
        ConfigError: there is none.
    """
    folders = sorted({file.parent for file in folder.rglob("Attitude quaternion*.csv")})
    if not folders:
        raise ConfigError(
            f"{folder} has no file Attitude quaternion*.csv: give a clone of kdjebko/lelar-in-orbit-data."
        )
    return folders


def rows_of(file: Path, columns: int) -> dict[datetime, list[float]]:
    """Numbers (columns,) of a file of telemetry by their time; units after them are left out, later rows win.

    Raises:
        ConfigError: the file cannot be read, or a row has other cells than a time and numbers.
    """
    text = read_text(file, _LARGEST, "the telemetry ")
    rows = {}
    for line, row in enumerate(csv.reader(io.StringIO(text)), 1):
        if line == 1 or not row:
            continue
        try:
            time = datetime.fromisoformat(row[0])
            numbers = [float(cell.split()[0]) for cell in row[1:]]
        except (ValueError, IndexError) as error:
            raise ConfigError(
                f"the telemetry {file}, line {line}: a time and numbers are needed, got {brief(row)}."
            ) from error
        if len(numbers) != columns or not np.isfinite(numbers).all():
            raise ConfigError(
                f"the telemetry {file}, line {line}: {columns} finite numbers are needed, got {brief(row)}."
            )
        rows[time] = numbers
    return rows


def read_manoeuvre(folder: Path) -> Telemetry:
    """Readings of a folder at the times that all its files have.

    Raises:
        ConfigError: a file is missing or cannot be read, or too few times are in all of them.
    """
    tables = []
    for name, columns in _FILES.items():
        files = sorted(folder.glob(f"{name}*.csv"))
        if len(files) != 1:
            raise ConfigError(f"{folder} must have one file {name}*.csv, got {len(files)}.")
        tables.append(rows_of(files[0], columns))
    times = sorted(set.intersection(*(set(table) for table in tables)))
    if len(times) < _FEWEST:
        raise ConfigError(
            f"{folder} has {len(times)} times that are in all of its files; {_FEWEST} are needed."
        )
    q, rates, speeds, commands = (np.array([table[time] for time in times]) for table in tables)
    seconds = np.array([(time - times[0]).total_seconds() for time in times])
    rotation = Rotation.from_quat(q, scalar_first=True)
    rates = np.deg2rad(rates)

    # What turns the attitude between two rows and the rates do not is a change of the goal.
    mean = 0.5 * (rates[1:] + rates[:-1])
    expected = rotation[:-1] * Rotation.from_rotvec(mean * np.diff(seconds)[:, None])
    jumps = (expected.inv() * rotation[1:]).magnitude() > _JUMP
    goals = np.concatenate([[0], np.cumsum(jumps)])
    return Telemetry(seconds, rotation.as_matrix(), rates, speeds * _RPM, commands * _RPM, goals)
