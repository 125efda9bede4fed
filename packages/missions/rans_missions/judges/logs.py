"""Longer logs of JEOD, from a folder that the user fetched."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from rans.csv_file import read_csv
from rans.extend import ConfigError
from rans_missions.judges import jeod
from rans_missions.judges.jeod import RUNS, Motion, Run, Turning
from validation.judges.judge import Row

FILE = "log_state_ASCII.csv"
"""Name of a log in its folder RUN_X."""
_BODY = "vehicle.dyn_body.composite_body.state"
TIME = "sys.exec.out.time {s}"
COLUMNS = {
    "position": [f"{_BODY}.trans.position[{k}] {{m}}" for k in range(3)],
    "velocity": [f"{_BODY}.trans.velocity[{k}] {{m/s}}" for k in range(3)],
    "spin": [f"{_BODY}.rot.ang_vel_this[{k}] {{rad/s}}" for k in range(3)],
    "attitude": [
        f"{_BODY}.rot.Q_parent_this.scalar {{--}}",
        *(f"{_BODY}.rot.Q_parent_this.vector[{k}] {{--}}" for k in range(3)),
    ],
}
"""Columns that are read, with their units as in the header; others are ignored."""
_LARGEST = 4_000_000
"""Bytes: a log of 481 rows has 820,000."""


def judged(folder: Path | None) -> tuple[list[Row], list[str]]:
    """Rows of JEOD's runs, and sentences on those that are left out; a judge of `validation.judges.table`.

    Args:
        folder: with logs; None: the figures that stand here.

    Raises:
        ConfigError: see `logged`.
    """
    runs, left = ({}, []) if folder is None else logged(folder)
    left += [f"JEOD {names}: {reason}." for names, reason in jeod.NOT_FLOWN.items()]
    shipped = {
        name: (run, f"RUN_{name}/log_state_ASCII.csv")
        for name, run in jeod.RUNS.items()
        if name not in runs
    }
    return list(jeod.rows({**shipped, **runs})), left


def logged(folder: Path) -> tuple[dict[str, tuple[Run, str]], list[str]]:
    """Runs whose logs lie in or below a folder, by name, each with its file; and sentences on those left out.

    The start is the first row of a log, and its figures are all others.

    Raises:
        ConfigError: the folder has no log, or a log has not the columns, units or times of JEOD's, or ends early.
    """
    if not folder.is_dir():
        raise ConfigError(f"{str(folder)!r} is no folder: --judges takes the one with JEOD's logs.")
    files = {
        match[1]: file
        for file in sorted(folder.rglob(FILE))
        if (match := re.fullmatch(r"RUN_(\w+)", file.parent.name))
    }
    if not files:
        raise ConfigError(
            f"{str(folder)!r} has no RUN_X/{FILE}: copy SET_test_val of nasa/jeod, verif/SIM_dyncomp, there."
        )
    runs, left = {}, []
    for name, file in files.items():
        template = RUNS.get(name)
        if template is None:
            left.append(
                f"{file}: what acts in run {name} is not something that RANS flies near a target."
            )
            continue
        motion, turning = _rows(file)
        end, last = max(template.motion), max(motion)
        if last < end:
            raise ConfigError(
                f"{file} ends at {last} s, and the flight lasts {end} s; the usual cause is a copy that was cut "
                "short."
            )
        turning = turning if template.turning else {}
        runs[name] = replace(template, motion=motion, turning=turning), str(file)
    return runs, left


def _rows(file: Path) -> tuple[dict[int, Motion], dict[int, Turning]]:
    """Motion and rotation of a log by time (whole s), in SI units as JEOD writes them; times must rise."""
    table = read_csv(file, _LARGEST, "the log ")
    header = [*table.header]
    missing = [
        name
        for name in (TIME, *(c for names in COLUMNS.values() for c in names))
        if header.count(name) != 1
    ]
    if missing:
        raise ConfigError(
            f"{file} has {header.count(missing[0])} columns {missing[0]!r}: a log of JEOD's SIM_dyncomp has one of "
            "this name and unit."
        )
    # Columns by name, then rows with finite numbers.
    places = {key: [header.index(name) for name in names] for key, names in COLUMNS.items()}
    at = header.index(TIME)
    motion: dict[int, Motion] = {}
    turning: dict[int, Turning] = {}
    for number, row in table.rows:
        time = table.number(number, TIME, row[at])
        read = {
            key: tuple(table.number(number, header[k], row[k]) for k in ks)
            for key, ks in places.items()
        }
        last = next(reversed(motion), -1)
        if time != round(time) or time <= last:
            raise ConfigError(
                f"{file}, line {number}: the time {time!r} s must be a whole number above {last}."
            )
        motion[int(time)] = read["position"], read["velocity"]  # type: ignore[assignment]
        turning[int(time)] = read["spin"], read["attitude"]  # type: ignore[assignment]
    if 0 not in motion or len(motion) < 2:
        raise ConfigError(
            f"{file} has no row at 0 s, from which the flight starts, or none after it."
        )
    return motion, turning
