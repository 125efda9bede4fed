"""Output to a terminal: tables and sentences in which names are neither mark-up nor control sequences.

Names come from strangers: every text passes `Terminal`, which prints neither markup nor control sequences of them.
"""

from __future__ import annotations

import errno
import os
import threading
import time
import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import replace
from datetime import timedelta
from textwrap import wrap
from typing import Any, ClassVar, NoReturn

import rich.table
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskProgressColumn,
    TextColumn,
)
from rich.text import Text

from rans.base.errors import legible
from rans.base.progress import Progress as Step, Stages
from rans.base.table import Table, cell_text

_LONGEST = 20_000
"""Largest number of characters of a cell or sentence."""


_NARROWEST = 20
"""Columns that every output has."""
_FRAME = 3
"""Number of characters between two columns of a table."""


class Terminal(Console):
    """Console that prints names literally, without mark-up.

    Results go to standard output, progress and warnings to standard error.

    Args:
        stderr: whether to print to standard error.
        room: least width of the output in columns if it is no terminal, or one without columns, as a serial line.
    """

    def __init__(self, stderr: bool = False, room: int = _NARROWEST) -> None:
        super().__init__(stderr=stderr, markup=False, highlight=False, emoji=False)
        if not self.is_terminal or self.width < _NARROWEST:
            self.width = max(self.width, room)

    def on_broken_pipe(self) -> NoReturn:
        """Raise the error that Rich has caught, as `rans list | head -1` causes; Rich would end the process.

        Raises:
            BrokenPipeError: always.
        """
        raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))

    def say(self, text: str) -> None:
        """Print a sentence; lines are broken between words on a terminal only, and not in a multi-line text."""
        self.print(text, soft_wrap=not self.is_terminal or "\n" in text)

    def command(self, text: str) -> None:
        """Print a command to copy on a line of its own, without line breaks."""
        self.print(f"  {text}", soft_wrap=True)

    has_suggested: ClassVar[bool] = False
    """Whether this process has printed commands to run next, since whoever asks set it to False."""

    def suggest(self, *commands: str) -> None:
        """Print commands that a user may want to run next, one per line."""
        Terminal.has_suggested = True
        self.print("Next:")
        for text in commands:
            self.command(text)

    def table(self, table: Table) -> None:
        """Print a table; if its columns do not fit, every row is a block of lines."""
        self.print(rendered(table), crop=False)

    def render_str(self, text: str, **options: Any) -> Text:
        """Text without control characters; all texts of tables and sentences pass through this method."""
        return super().render_str(legible(text, _LONGEST), **options)


class _Titled(rich.table.Table):
    """Table in which no word is broken; if its columns do not fit, every row is printed as a block.

    Title and caption are broken at the width of the terminal; Rich breaks them at the width of the table.
    """

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        if self.title:
            yield console.render_str(str(self.title), style="table.title")
        heads = [str(column.header) for column in self.columns]
        cells = [[_plain(cell) for cell in column.cells] for column in self.columns]
        room = options.max_width - _FRAME * len(heads) - 1
        fixed = [column.no_wrap for column in self.columns]
        widths = _column_widths(heads, cells, room, fixed)
        if widths is None:
            yield from _blocks(heads, list(zip(*cells, strict=True)), options.max_width)
        else:
            rows = copy(self)
            rows.title = rows.caption = None
            rows.columns = [
                replace(column, width=width)
                for column, width in zip(self.columns, widths, strict=True)
            ]
            yield from rich.table.Table.__rich_console__(rows, console, options)
        if self.caption:
            yield console.render_str(str(self.caption), style="table.caption")


def _plain(cell: object) -> str:
    return cell.plain if isinstance(cell, Text) else legible(str(cell), _LONGEST)


def _column_widths(
    heads: Sequence[str], cells: Sequence[Sequence[str]], room: int, fixed: Sequence[bool]
) -> list[int] | None:
    """Width of each column such that lines break between words only; None if there is no room.

    The widest columns are narrowed first; those that are fixed are not narrowed.
    """
    lines = [
        [line for text in (head, *column) for line in text.splitlines() or [""]]
        for head, column in zip(heads, cells, strict=True)
    ]
    widths = [max(map(cell_len, some)) for some in lines]
    least = [
        width if fixed[k] else max(cell_len(word) for line in some for word in line.split() or [""])
        for k, (some, width) in enumerate(zip(lines, widths, strict=True))
    ]
    while sum(widths) > room:
        loose = [k for k in range(len(widths)) if widths[k] > least[k]]
        if not loose:
            return None
        widths[max(loose, key=lambda k: widths[k])] -= 1
    return widths


def _blocks(heads: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> Iterator[Text]:
    """Yield every row as lines: its first cell, then the other cells with their headings."""
    for first, *others in rows:
        yield Text(first, "bold", no_wrap=True, overflow="ignore")
        for head, text in zip(heads[1:], others, strict=True):
            if text:
                line = f"{' '.join(head.split())}: {text}" if head else text
                for part in wrap(
                    line,
                    width - 4,
                    break_long_words=False,
                    break_on_hyphens=False,
                    subsequent_indent="  ",
                ):
                    yield Text(f"  {part}", no_wrap=True, overflow="ignore")


def rendered(table: Table) -> rich.table.Table:
    """A table for Rich: long words are folded, columns named by `whole` are not, numbers stand right."""
    printed = _Titled(title=table.title or None, caption=table.note or None)
    whole = table.whole or table.columns[:1]
    for k, column in enumerate(table.columns):
        justify = "right" if table.is_numeric(k) else "left"
        printed.add_column(column, overflow="fold", justify=justify, no_wrap=column in whole)
    for number, row in enumerate(table.rows):
        is_marked = len(row) == 1 or number in table.marked
        if len(row) == 1 and number:
            printed.add_section()
        printed.add_row(*map(_cell, row), style="bold" if is_marked else None)
    return printed


def _cell(cell: Any) -> str | Text:
    return verdict(cell) if isinstance(cell, bool) else cell_text(cell)


class _Bar(BarColumn):
    """A bar, or the time so far where the number of units is not known: Rich's pulse colours every letter."""

    def render(self, task: Task) -> Any:
        """The bar of a stage."""
        if task.total is None:
            return Text(f"... {task.elapsed or 0.0:.0f} s")
        return super().render(task)


class _Left(ProgressColumn):
    """Time left of a stage, by its mean time per unit; Rich's own forgets units that ended over 30 s ago."""

    def render(self, task: Task) -> Text:
        """Text of a stage: empty until its first unit is done."""
        return Text(_left(task.elapsed or 0.0, task.completed, task.total))


def _left(elapsed: float, done: float, total: float | None) -> str:
    """Time left (h:mm:ss), as words, of a stage with so many of its units done in so many s; "": not known."""
    if not done or not total:
        return ""
    return f"{timedelta(seconds=round(elapsed * max(total - done, 0.0) / done))} left"


def progress() -> Progress:
    """Progress bars on a terminal (stderr), which disappear at the end; nothing elsewhere."""
    terminal = Terminal(stderr=True)
    return Progress(
        TextColumn("{task.description}", markup=False),
        _Bar(),
        TaskProgressColumn(),
        _Left(),
        console=terminal,
        transient=True,
        disable=not terminal.is_terminal,
        refresh_per_second=REDRAWN,
    )


REDRAWN = 2.0
"""Times a second that moving lines are drawn anew: each takes some hundred bytes, which logs keep."""


def stages(bars: Progress) -> Stages:
    """`Stages` callback that shows each stage as a progress bar, or in a log as lines if it takes long.

    Bars of stages that have ended are gone, so that they are not drawn anew: those that are full, and those without
    a number of units, which end when the next stage begins.
    """
    if bars.disable:
        return _in_log

    def stage(name: str, total: int | None, /) -> Step:
        """Begin a bar of this name (total None: unknown), and return what advances it; finished ones go."""
        for task in bars.tasks:
            if task.total is None or task.finished:
                bars.remove_task(task.id)
        number = bars.add_task(name, total=total)

        def advance(count: int, /) -> None:
            if number in bars.task_ids:
                bars.advance(number, count)

        return advance

    return stage


_LINE_EVERY = 10.0
"""Time between two lines of a stage in a log, s."""


def _in_log(name: str, total: int | None, /) -> Step:
    """A stage as lines on standard error, from some seconds after its begin on, with the time left.

    Its name alone is the first line where no unit is done by then.
    """
    done = 0
    begun = last = time.monotonic()
    of = f" of {total:,}" if total else ""
    waiting = threading.Timer(_LINE_EVERY, lambda: Terminal(stderr=True).say(f"{name} ..."))
    waiting.daemon = True
    waiting.start()

    def advance(count: int, /) -> None:
        nonlocal done, last
        waiting.cancel()
        done += count
        now = time.monotonic()
        if now - last >= _LINE_EVERY:
            last = now
            left = _left(now - begun, done, total)
            Terminal(stderr=True).say(", ".join(filter(None, (f"{name}: {done:,}{of}", left))))

    # A stage may end without a unit, as after an error.
    weakref.finalize(advance, waiting.cancel)
    return advance


@contextmanager
def doing(what: str, in_log: bool = True) -> Iterator[None]:
    """Context that says what a command does while it prints nothing, as a stage without units.

    Args:
        what: what is done, without a period.
        in_log: whether a log has a line of it, too, if it takes long.
    """
    with progress() as bars:
        stage = stages(bars)(what, None) if in_log or not bars.disable else None
        yield
        del stage


def verdict(passed: bool) -> Text:
    """Text "pass" or "FAIL" with its colour, for tables."""
    return Text("pass", "green") if passed else Text("FAIL", "bold red")
