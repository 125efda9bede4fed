"""The table of all judges."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain

from rans.base.registry import Registry
from rans.base.table import Table
from validation.judges import brick, lvlh
from validation.judges.judge import Row

FURTHER: Registry[Callable[[], Iterator[Row]]] = Registry("judge", "rans.judges")
"""Judges of packages."""


def judged() -> list[Row]:
    """A row for each case of each judge."""
    judges = [rows for _, rows in FURTHER.each()]
    return [*chain(*(rows() for rows in (*judges, brick.rows, lvlh.rows)))]


def table(rows: list[Row]) -> Table:
    """A row a case."""
    columns = ("case", "what", "largest difference", "bound", "the judge's own spread", "")
    cells = [
        (row.case, row.about, row.differences(), row.bounds(), row.spread, bool(row.passed))
        for row in rows
    ]
    return Table(columns, cells, "Judged by others")
