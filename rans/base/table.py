"""A table as a value: what a result says in rows. Terminals, pages, notebooks and JSON print the same one."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Number
from typing import Any


@dataclass(frozen=True)
class Table:
    """Rows of texts, numbers, truth values (printed as pass or FAIL) and None (printed as a dash).

    A row of one cell is a heading of the rows below it.
    """

    columns: Sequence[str]
    """Headings, with units."""
    rows: Sequence[Sequence[Any]]
    title: str = ""
    note: str = ""
    """Sentences that explain it."""
    right: Collection[str] = ()
    """Columns whose texts stand right, as numbers do."""
    whole: Collection[str] = ()
    """Columns whose cells are not broken where a terminal is narrow; empty: the first one."""
    marked: Collection[int] = ()
    """Numbers of the rows that stand out."""
    colours: Mapping[str, str] = field(default_factory=dict)
    """CSS colours of columns in a page, by their names: those of contestants in its charts."""

    def is_numeric(self, k: int) -> bool:
        """Whether column k holds numbers, which stand right; a dash stands where its column does."""
        cells = [row[k] for row in self.rows if len(row) > 1]
        return self.columns[k] in self.right or (
            bool(cells)
            and all(
                cell is None or (isinstance(cell, Number) and not isinstance(cell, bool))
                for cell in cells
            )
        )

    def to_json(self) -> list[dict[str, Any]]:
        """A mapping a row, by the columns' names."""
        return [dict(zip(self.columns, row, strict=True)) for row in self.rows if len(row) > 1]


def cell_text(cell: Any) -> str:
    """A cell as text; infinite times never come."""
    if cell is None:
        return "-"
    if isinstance(cell, float):
        return "never" if cell == math.inf else f"{cell:.4g}"
    return str(cell)
