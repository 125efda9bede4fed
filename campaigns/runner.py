"""One runner of campaigns: table.toml says what each measures, where it is kept, and what pages show of it.

``python -m campaigns NAME OPTIONS`` measures a campaign and prints its tables; with ``--docs docs`` it also writes
the evidence, a JSON file in docs/validation, and the tables of the pages. Options are the fields
of the class that measures.
"""

from __future__ import annotations

import math
import re
import string
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from campaigns.markdown import Table
from rans.base import table
from rans.base.files import environment, plain, read_json, write_json
from rans.base.terminal import Terminal

Columns = tuple[tuple[str, str], ...]
"""Headings, and the text of a cell with fields of a row in braces, see `cell`."""
ABSENT = "-"
"""Cell of a number that is not there."""


@dataclass(frozen=True)
class Shown:
    """A table of a page, made of the evidence of a campaign."""

    columns: Columns = ()
    rows: str = "rows"
    """Key of the rows in the evidence; or MODULE:FUNCTION, which takes the evidence and gives the rows, without
    columns headings and rows of text. Words behind it are further arguments."""
    reads_files: bool = False
    """Whether the function takes the folder of the documents, and reads its files itself."""
    source: str = ""
    """What stands below the table, with fields of the evidence in braces; {file} is a link to the evidence."""


@dataclass(frozen=True)
class Campaign:
    """What is measured, its evidence and tables, and how nearly a repetition must agree.

    Flights of a seed are deterministic: with the same processor and versions every cell is the same. Elsewhere, and
    with fewer flights, shares agree within three standard deviations and other numbers within a tolerance.
    """

    page: str
    """Page that has its tables or speaks of it, from docs."""
    tables: Mapping[str, Shown] = field(default_factory=dict)
    """By their names, which are also the marks of their places in the pages."""
    prints: Mapping[str, Shown] = field(default_factory=dict)
    """Further tables, for the terminal alone, by their titles."""
    measure: str = ""
    """MODULE:CLASS of what measures: a dataclass, whose fields are options, with a method ``measured`` that gives
    the evidence or its rows; empty: other commands do."""
    labels: tuple[str, ...] = ()
    """Fields of a row that say what it is about. A run with the option ``only`` keeps rows with other labels."""
    commands: tuple[str, ...] = ()
    """What measures them, in a folder with a copy of docs; empty: the campaign."""
    given: tuple[str, ...] = ()
    """Words in front of the options of a command line, with which the page's figures were measured: a command line
    that begins with a word is without them."""
    quick: tuple[str, ...] = ()
    """Commands of `--quick`, with fewer flights, or options of the campaign; empty: the whole reproduction."""
    seconds: float = 0.0
    """Processor time of the commands, s, on an AMD EPYC; 0: not measured."""
    quick_seconds: float = 0.0
    """Processor time of the quick commands, s; 0: not measured."""
    fewer_rows: bool = False
    """Whether the quick commands measure some rows of the tables only; the others are not compared."""
    named_by: int = 3
    """Number of first cells among which are those that say what a row is about: they pair rows where some are
    missing."""
    flights: tuple[int, int] = (0, 0)
    """Flights behind a share, and with ``quick``; 0: the table has no shares, or says the number in each row."""
    shares: tuple[str, ...] = ()
    """Parts of the headings of columns with shares in %, beside those whose heading or cell has a "%"."""
    tolerance: tuple[float, float] = (0.02, 0.25)
    """Relative difference of other numbers that is accepted, and with ``quick``."""
    uncompared: tuple[str, ...] = ()
    """Headings of columns that are not compared: times of a machine, and with fewer flights extremes."""
    evidence: tuple[str, ...] = ()
    """Files in docs/validation that the commands write; the first is that of the tables."""
    moved: tuple[tuple[str, str], ...] = ()
    """Files that the commands write elsewhere, and their names in docs/validation."""
    deterministic: bool = True
    """Whether two runs on one machine are equal; false where a limit of time ends a search."""

    def file(self, docs: Path) -> Path:
        """The evidence of the tables."""
        return docs / "validation" / self.evidence[0]

    def measured_by(self, name: str, quick: bool = False) -> Sequence[str]:
        """Commands that measure the campaign of this name."""
        own = f"python -m campaigns {name.replace(' ', '-')} --docs docs"
        if self.commands:
            return (self.quick if quick else ()) or self.commands
        return [f"{own} {options}" for options in self.quick] if quick and self.quick else [own]

    def time(self, quick: bool) -> float:
        """Processor time of all commands, s; 0: not measured."""
        return self.quick_seconds if quick and self.quick else self.seconds

    def table(self, docs: Path, name: str) -> Table:
        """One of the tables, of the evidence in docs/validation."""
        shown = self.tables[name]
        evidence = {} if shown.reads_files else read_json(self.file(docs))
        headings, rows = texts(shown, docs if shown.reads_files else evidence)
        # Pages of packages are in docs by a symbolic link.
        up = "../../../docs/" if "/" in self.page else ""
        file = self.evidence[0]
        link = f"[{file}]({up}validation/{file})"
        return Table(
            self.page, name, headings, rows, cell(shown.source, {**evidence, "file": link})
        )


def texts(shown: Shown, evidence: Any) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
    """Headings and cells of a table, of the evidence or of the folder of the documents (`Shown.rows`)."""
    rows = found(shown.rows)(evidence) if ":" in shown.rows else evidence[shown.rows]
    if not shown.columns:
        return rows
    headings = [heading for heading, _ in shown.columns]
    return headings, [[cell(text, row) for _, text in shown.columns] for row in rows]


def found(name: str) -> Callable[..., Any]:
    """Function of the name MODULE:FUNCTION in this package, with the words behind it as last arguments."""
    first, *rest = name.split(" ", 1)
    module, _, function = first.partition(":")
    result = getattr(import_module(f"campaigns.{module}"), function)
    return (lambda evidence: result(evidence, *rest)) if rest else result


def cell(text: str, row: Any) -> str:
    """Text with fields of a row in braces, or MODULE:FUNCTION of the row; ABSENT if a number is not finite.

    Fields of a row that is a list are numbers. Beside the formats of Python, ``{won:%.1f}`` is a share in per cent,
    and ``{spent:~3}`` a number of three digits with commas between thousands.
    """
    if re.fullmatch(r"\w+:\w+", text):
        return found(text)(row)
    try:
        return _Fields().vformat(text, *((), row) if isinstance(row, Mapping) else (row, {}))
    except _NoNumber:
        return ABSENT


class _NoNumber(Exception):
    """A field that is to be formatted as a number is none."""


class _Fields(string.Formatter):
    def format_field(self, value: Any, format_spec: str) -> str:
        if not format_spec:
            return str(value)
        try:
            x = float("nan" if value is None else value)  # files have infinite numbers as text
        except ValueError:
            return format(value, format_spec)
        if not math.isfinite(x):
            raise _NoNumber
        kind, rest = format_spec[0], format_spec[1:]
        if kind == "%":
            return format(100.0 * x, rest)
        if kind == "~":
            return f"{float(f'{x:.{rest}g}'):,g}"
        return format(value if isinstance(value, int) else x, format_spec)


def merged(before: Sequence[Any], new: Sequence[Any], labels: Sequence[str]) -> list[Any]:
    """Rows in which new ones stand where those with the same labels stood, or at the end."""
    fresh = {_label(row, labels): row for row in new}
    rows = [fresh.pop(_label(row, labels), row) for row in before]
    return [*rows, *fresh.values()]


def _label(row: Any, labels: Sequence[str]) -> tuple[Any, ...]:
    return tuple(row[label] for label in labels)


def run(campaign: Campaign, plan: Any, docs: Path | None) -> int:
    """Measure, print, and with a folder of documents write: the evidence after every row, and the tables.

    Returns:
        1 if the plan says of the evidence that it failed.
    """
    file = campaign.file(docs) if docs is not None and campaign.evidence else None
    options = {x: _plain(value) for x, value in vars(plan).items() if x not in ("only", "workers")}
    about = {**options, "environment": environment()}
    before: dict[str, Any] = {}
    if file and campaign.labels and getattr(plan, "only", ()) and file.exists():
        before = read_json(file)
    evidence = before or about
    rows: list[Any] = []
    answer = plan.measured()
    for part in [answer] if isinstance(answer, dict) else ({"rows": [row]} for row in answer):
        evidence = evidence | part
        rows += part.get("rows", ())
        if rows:
            evidence["rows"] = merged(before["rows"], rows, campaign.labels) if before else rows
        if file is not None:
            write_json(file, evidence)
    for name in campaign.tables:
        if docs is not None:
            campaign.table(docs, name).write(docs)
    for name, shown in {**campaign.tables, **campaign.prints}.items():
        if not shown.reads_files:
            Terminal().table(table.Table(*texts(shown, plain(evidence)), name))
    return int(hasattr(plan, "failed") and plan.failed(evidence))


def _plain(value: Any) -> Any:
    """Option for JSON: paths as text."""
    if isinstance(value, tuple):
        return [_plain(one) for one in value]
    return str(value) if isinstance(value, Path) else value


def command(name: str, campaign: Campaign, arguments: Sequence[str]) -> int:
    """Run a campaign with options of a command line, the fields of what measures, and ``--docs FOLDER``."""
    import tyro

    docs = None
    named = bool(arguments) and not arguments[0].startswith("-")
    rest = [*(() if named else campaign.given), *arguments]
    if "--docs" in rest:
        at = rest.index("--docs")
        docs = Path(*rest[at + 1 : at + 2])
        del rest[at : at + 2]
    plan = tyro.cli(found(campaign.measure), args=rest, prog=f"python -m campaigns {name}")
    return run(campaign, plan, docs)
