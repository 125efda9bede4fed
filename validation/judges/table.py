"""The table of all judges."""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain
from pathlib import Path

from rans.errors import ConfigError
from rans.registry import Registry
from rans.table import Table
from validation.judges import brick, contact, lvlh
from validation.judges.judge import Row

Judged = tuple[list[Row], list[str]]
"""A row for each case, and sentences on cases that were left out."""

WITH_LOGS: Registry[Callable[[Path | None], Judged]] = Registry(
    "judge", "rans.judges", {}, lambda judged: judged
)
"""Judges of packages, each a function of a folder with longer logs, or None."""


def judged(folder: Path | None = None) -> Judged:
    """A row for each case of each judge, and sentences on cases that were left out.

    Args:
        folder: with longer logs, such as those of JEOD in folders RUN_X; None: the figures that come with RANS.

    Raises:
        ConfigError: a judge refuses its logs, or no judge with logs is installed.
    """
    if folder is not None and not WITH_LOGS:
        raise ConfigError(
            f"--judges {folder} takes logs of JEOD, and no installed package has their judge."
        )
    found = [judged_by(folder) for _, judged_by in WITH_LOGS.each()]
    own = chain(brick.rows(), contact.rows(), lvlh.rows())
    return [*chain(*(rows for rows, _ in found)), *own], [*chain(*(left for _, left in found))]


def table(rows: list[Row]) -> Table:
    """A row a case."""
    columns = ("case", "what", "largest difference", "bound", "the judge's own spread", "")
    cells = [
        (row.case, row.about, row.differences(), row.bounds(), row.spread, bool(row.passed))
        for row in rows
    ]
    return Table(columns, cells, "Judged by others")
