"""What a terminal shows: tables and sentences in which names are neither mark-up nor commands."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from rich.console import Console, JustifyMethod
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from rans.errors import legible

_LONGEST = 20_000
"""Characters of one cell or sentence: more than any of ours has."""


class Terminal(Console):
    """Shows what users and other people named as it is spelt.

    Results go to standard output, progress and warnings to ``stderr``; a file gets as many columns as
    ``room`` says, where a terminal has its own.
    """

    def __init__(self, stderr: bool = False, room: int = 0) -> None:
        super().__init__(stderr=stderr, markup=False, highlight=False)
        if not self.is_terminal:
            self.width = max(self.width, room)

    def render_str(self, text: str, **options: Any) -> Text:
        """Every text of a table or a sentence passes here."""
        return super().render_str(legible(text, _LONGEST), **options)


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[Any]], caption: str = "",
          justify: JustifyMethod = "left") -> Table:
    """A table whose first column never breaks, and in which no end of a long word is lost."""
    made = Table(title=title or None, title_justify="left", caption=caption or None, caption_justify="left")
    for column in columns:
        made.add_column(column, overflow="fold", justify=justify, no_wrap=not made.columns)
    for row in rows:
        made.add_row(*row)
    return made


def progress() -> Progress:
    """Bars on a terminal while something takes long, gone when it is done."""
    terminal = Terminal(stderr=True)
    return Progress(TextColumn("{task.description}", markup=False), BarColumn(), TaskProgressColumn(),
                    TimeRemainingColumn(), console=terminal, transient=True, disable=not terminal.is_terminal)


def verdict(passed: bool) -> Text:
    """For a table."""
    return Text("pass", "green") if passed else Text("FAIL", "bold red")
