"""The table of all judges."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from rans.table import Table
from validation.judges import brick, contact, jeod, lvlh
from validation.judges.judge import Row
from validation.judges.logs import logged


def judged(folder: Path | None = None) -> tuple[list[Row], list[str]]:
    """A row for each case of each judge, and sentences on cases that were left out.

    Args:
        folder: with longer logs of JEOD, in folders RUN_X; None: the figures that come with RANS.

    Raises:
        ConfigError: see `validation.judges.logs.logged`.
    """
    runs, left = ({}, []) if folder is None else logged(folder)
    left += [f"JEOD {names}: {reason}." for names, reason in jeod.NOT_FLOWN.items()]
    shipped = {
        name: (run, f"RUN_{name}/log_state_ASCII.csv")
        for name, run in jeod.RUNS.items()
        if name not in runs
    }
    rows: Iterator[Row] = chain(
        jeod.rows({**shipped, **runs}), brick.rows(), contact.rows(), lvlh.rows()
    )
    return list(rows), left


def table(rows: list[Row]) -> Table:
    """A row a case."""
    columns = ("case", "what", "largest difference", "bound", "the judge's own spread", "")
    cells = [
        (row.case, row.about, row.differences(), row.bounds(), row.spread, bool(row.passed))
        for row in rows
    ]
    return Table(columns, cells, "Judged by others")
