"""What a terminal shows: tables and sentences in which names are neither mark-up nor commands."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import replace
from functools import partial
from textwrap import fill, wrap
from typing import Any

from rich.cells import cell_len
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

    def command(self, text: str) -> None:
        """A command to copy: on a line of its own, which nothing breaks."""
        self.print(f"  {text}", soft_wrap=True)

    def suggest(self, *commands: str) -> None:
        """What a user may want to run next, one command a line."""
        self.print("Next:")
        for text in commands:
            self.command(text)

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
                    fill(
                        name,
                        max(_HEADING, *(len(row[k]) for row in kept), 0),
                        break_long_words=False,
                        break_on_hyphens=False,
                    )
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
    """A table in which no word is broken; where its columns do not fit beside each other, one row a block.

    Title and caption break where the terminal does: Rich breaks them at the table's edge.
    """

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        if self.title:
            yield console.render_str(str(self.title), style="table.title")
        heads = [str(column.header) for column in self.columns]
        cells = [[_plain(cell) for cell in column.cells] for column in self.columns]
        room = options.max_width - _FRAME * len(heads) - 1
        widths = _column_widths(heads, cells, room, fixed=1)
        if widths is None:
            yield from _blocks(heads, list(zip(*cells, strict=True)), options.max_width)
        else:
            rows = copy(self)
            rows.title = rows.caption = None
            rows.columns = [
                replace(column, width=width)
                for column, width in zip(self.columns, widths, strict=True)
            ]
            yield from Table.__rich_console__(rows, console, options)
        if self.caption:
            yield console.render_str(str(self.caption), style="table.caption")


def _plain(cell: object) -> str:
    return cell.plain if isinstance(cell, Text) else legible(str(cell), _LONGEST)


def _column_widths(
    heads: Sequence[str], cells: Sequence[Sequence[str]], room: int, fixed: int
) -> list[int] | None:
    """Characters of each column, so that lines break between words only; None where there is no room.

    The widest columns give way first; the first ``fixed`` ones never do.
    """
    lines = [
        [line for text in (head, *column) for line in text.splitlines() or [""]]
        for head, column in zip(heads, cells, strict=True)
    ]
    widths = [max(map(cell_len, some)) for some in lines]
    least = [
        width
        if k < fixed
        else max(cell_len(word) for line in some for word in line.split() or [""])
        for k, (some, width) in enumerate(zip(lines, widths, strict=True))
    ]
    while sum(widths) > room:
        loose = [k for k in range(len(widths)) if widths[k] > least[k]]
        if not loose:
            return None
        widths[max(loose, key=lambda k: widths[k])] -= 1
    return widths


def _blocks(heads: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> Iterator[Text]:
    """Every row as lines of its own: its first cell, then what the others hold."""
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
def writing_at_end(write: Callable[[], object]) -> Iterator[None]:
    """Context that writes results when it ends, also after an error or Ctrl-C."""
    try:
        yield
    except KeyboardInterrupt:
        Terminal(stderr=True).say("Interrupted: results so far are written, if there are any.")
        raise
    finally:
        write()


def verdict(passed: bool) -> Text:
    """For a table."""
    return Text("pass", "green") if passed else Text("FAIL", "bold red")
