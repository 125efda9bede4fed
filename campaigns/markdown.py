"""Tables of documents that studies write, between two lines that say so."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from rans.base.errors import ConfigError
from rans.base.files import write_text

_END = "<!-- end of table -->"


class Table(NamedTuple):
    """One table of a document."""

    page: str
    """Its file, from the folder of the documents."""
    command: str
    """What measured it."""
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    source: str
    """Where its figures are, a sentence."""

    def within(self, docs: Path) -> str:
        """The page's text with this table in its place; ConfigError see `with_table`."""
        return with_table((docs / self.page).read_text("utf-8"), *self[1:])

    def write(self, docs: Path) -> None:
        """Into its page."""
        write_text(docs / self.page, self.within(docs))


def lines(headings: Sequence[str], rows: Iterable[Sequence[Any]]) -> Iterator[str]:
    """Lines of a table, each as soon as its row is known."""
    for cells in chain([headings, ["---"] * len(headings)], rows):
        yield f"| {' | '.join(map(str, cells))} |"


def with_table(
    page: str,
    command: str,
    headings: Sequence[str],
    rows: Iterable[Sequence[str]],
    source: str = "",
) -> str:
    """The page with the table that this command makes replaced, and below it where its figures are.

    Raises:
        ConfigError: the page has no place for it.
    """
    begin = f"<!-- table: {command} -->"
    body = "\n".join(lines(headings, rows))
    before, found, rest = page.partition(begin)
    _, end, after = rest.partition(_END)
    if not (found and end):
        raise ConfigError(
            f"the page must have the lines {begin} and {_END}, between which the table goes."
        )
    return f"{before}{begin}\n{body}\n" + (f"\n{source}\n" if source else "") + f"{_END}{after}"
