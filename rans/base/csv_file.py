"""Tables in CSV files of others: columns by their names, and every cell accounted for."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from rans.base.errors import ConfigError, brief
from rans.base.files import LARGEST_TEXT, read_text


@dataclass(frozen=True)
class CsvFile:
    """Cells of a CSV file; all rows have as many."""

    what: str
    """The file as messages name it, such as "the log flight.csv"."""
    header: tuple[str, ...]
    """Cells of the first line, without the space around them."""
    rows: tuple[tuple[int, list[str]], ...]
    """Number of the line, from 1, and cells of all further lines that are not empty."""

    def columns(self, units: Mapping[str, Collection[str]]) -> dict[str, int]:
        """Places in a row of the columns that a reader takes, by their names; other columns are passed over.

        Capitals count as small letters, and a unit stands behind the name in parentheses: ``X (m)``.

        Args:
            units: the names, each with the units that its numbers may have.

        Raises:
            ConfigError: a column is there twice, or has another unit.
        """
        places: dict[str, int] = {}
        for place, cell in enumerate(self.header):
            name, opened, unit = cell.lower().partition("(")
            name, unit = name.strip(), unit.rstrip(") ")
            if name not in units:
                continue
            if name in places:
                raise ConfigError(f"{self.what} has the column {name} twice.")
            if opened and unit not in units[name]:
                raise ConfigError(
                    f"{self.what} has the column {brief(cell)}; its numbers must be in "
                    f"{' or '.join(units[name]) or 'no unit'}."
                )
            places[name] = place
        return places

    def number(self, line: int, name: str, cell: str) -> float:
        """The finite number in a cell; ``line`` and ``name`` of its column say where it stands.

        Raises:
            ConfigError: it holds no finite number.
        """
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise ConfigError(
                f"{self.what}, line {line}: {name} must be a finite number, got {brief(cell.strip())}."
            )
        return value


def read_csv(file: Path, most: int = LARGEST_TEXT, what: str = "") -> CsvFile:
    """Cells of a CSV file in UTF-8, with commas between its columns.

    Args:
        file: the file.
        most: largest number of bytes that is read.
        what: words before its name in messages, with a space at their end.

    Raises:
        ConfigError: the file cannot be read, is empty or larger, has another separator, a cell longer than any
            number, or a line with more or fewer cells than the first one.
    """
    named = f"{what}{file}"
    reader = csv.reader(io.StringIO(read_text(file, most, what)))
    try:
        rows = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:  # a cell of more characters than csv takes, or a zero byte
        raise ConfigError(
            f"{named}, line {reader.line_num}, is no line of a table: {error}."
        ) from error
    if not rows:
        raise ConfigError(f"{named} is empty.")
    (_, first), *further = rows
    for name, character in (("semicolons", ";"), ("tabs", "\t")):
        if len(first) == 1 and character in first[0]:
            raise ConfigError(f"{named} has {name} between its columns: write commas.")
    if first[0].startswith("#") or first[0].lower().startswith("sep="):
        raise ConfigError(
            f"the first line of {named} must name its columns, got {brief(first[0])}: delete that line, or its #."
        )
    for line, row in further:
        if len(row) != len(first):
            raise ConfigError(
                f"{named}, line {line}, has {len(row)} cells instead of {len(first)}; the usual causes are "
                "a decimal comma and a missing cell."
            )
    return CsvFile(named, tuple(cell.strip() for cell in first), tuple(further))
