"""What a terminal shows: tables and sentences in which names are neither mark-up nor commands."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from functools import partial
from textwrap import fill
from typing import Any

from rich.console import Console, ConsoleOptions, JustifyMethod, RenderResult
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from rans.errors import legible
from rans.progress import Stages

_LONGEST = 20_000
"""Characters of one cell or sentence: more than any of ours has."""


_FRAME = 3
"""Characters between two columns of a table."""
_HEADING = 12
"""Characters of a heading that is broken between words, where its column is no wider."""


class Terminal(Console):
    """Shows what users and other people named as it is spelt.

    Results go to standard output, progress and warnings to ``stderr``; a file gets as many columns as
    ``room`` says, where a terminal has its own.
    """

    def __init__(self, stderr: bool = False, room: int = 0) -> None:
        super().__init__(stderr=stderr, markup=False, highlight=False, emoji=False)
        if not self.is_terminal:
            self.width = max(self.width, room)

    def say(self, text: str) -> None:
        """A sentence: lines break between words on a terminal, and nowhere in a file or a drawing."""
        self.print(text, soft_wrap=not self.is_terminal or "\n" in text)

    def show(
        self,
        title: str,
        columns: Sequence[str],
        rows: Iterable[Sequence[Any]],
        shorter: Iterable[Sequence[Any]] | None = None,
        caption: str = "",
    ) -> None:
        """A table; where it is too wide, with broken headings and shorter cells, which the caption tells of.

        Where it is still too wide, it becomes several, with some of its columns each, and the first in all.
        """
        kept = _texts(rows)
        note = ""
        if len(_fitting(columns, kept, self.width)) > 1:
            kept, note = (kept, "") if shorter is None else (_texts(shorter), caption)
            columns = [
                columns[0],
                *(
                    fill(name, max(_HEADING, *(len(row[k]) for row in kept), 0))
                    for k, name in enumerate(columns[1:], 1)
                ),
            ]
        groups = _fitting(columns, kept, self.width)
        for number, some in enumerate(groups):
            cells = [[row[0], *(row[k] for k in some)] for row in kept]
            self.print(
                table("" if number else title, [columns[0], *(columns[k] for k in some)], cells)
            )
        if note:
            self.say(note)

    def render_str(self, text: str, **options: Any) -> Text:
        """Every text of a table or a sentence passes here."""
        return super().render_str(legible(text, _LONGEST), **options)


def _texts(rows: Iterable[Sequence[Any]]) -> list[list[str]]:
    return [["-" if cell is None else str(cell) for cell in row] for row in rows]


def _fitting(columns: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> list[list[int]]:
    """Numbers of the columns after the first, in groups that fit beside it; one at least in each."""
    first, *widths = (
        _FRAME + max(len(line) for cell in column for line in (cell.splitlines() or [""]))
        for column in zip(columns, *rows, strict=True)
    )
    groups: list[list[int]] = [[]]
    left = width - first - 1
    for number, needed in enumerate(widths, 1):
        if groups[-1] and needed > left:
            groups.append([])
            left = width - first - 1
        groups[-1].append(number)
        left -= needed
    return groups


class _Titled(Table):
    """Title and caption break where the terminal does: Rich breaks them at the table's edge."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        rows = copy(self)
        rows.title = rows.caption = None
        if self.title:
            yield console.render_str(str(self.title), style="table.title")
        yield from Table.__rich_console__(rows, console, options)
        if self.caption:
            yield console.render_str(str(self.caption), style="table.caption")


def table(
    title: str,
    columns: Sequence[str],
    rows: Iterable[Sequence[Any]],
    caption: str = "",
    justify: JustifyMethod = "left",
) -> Table:
    """A table whose first column never breaks, and in which no end of a long word is lost."""
    made = _Titled(title=title or None, caption=caption or None)
    for column in columns:
        made.add_column(column, overflow="fold", justify=justify, no_wrap=not made.columns)
    for row in rows:
        made.add_row(*row)
    return made


def progress() -> Progress:
    """Bars on a terminal while something takes long, gone when it is done."""
    terminal = Terminal(stderr=True)
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        console=terminal,
        transient=True,
        disable=not terminal.is_terminal,
    )


def stages(bars: Progress) -> Stages:
    """Show every stage of some work as a bar of its own."""
    return lambda name, total, /: partial(bars.advance, bars.add_task(name, total=total))


@contextmanager
def kept(write: Callable[[], object]) -> Iterator[None]:
    """Write what was found when the block ends, however it does; who pressed Ctrl-C is told what takes on."""
    try:
        yield
    except KeyboardInterrupt:
        Terminal(stderr=True).say("Interrupted; writing what was found, if anything was.")
        raise
    finally:
        write()


def verdict(passed: bool) -> Text:
    """For a table."""
    return Text("pass", "green") if passed else Text("FAIL", "bold red")
