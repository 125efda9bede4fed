"""One HTML page that opens offline, with the verdict on top: what reports and comparisons are made of."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined

from rans.base.errors import counted, installing, is_installed
from rans.base.files import write_text
from rans.base.table import Table, cell_text
from rans.show import markup
from rans.show.pages.chart import Chart

if TYPE_CHECKING:
    from rans.base.terminal import Terminal
    from rans.show.figures.plotting import Figure
    from rans.show.pages.race import Race


@dataclass(frozen=True)
class Picture:
    """A figure inside the page, as an image: no browser runs a script of one, or fetches what it names."""

    source: str
    """See `rans.show.figures.svg.data_uri`; empty where Matplotlib is not installed."""
    caption: str
    """Also read out to those who cannot see it."""

    @classmethod
    def of(cls, figure: Callable[[], Figure] | Figure | Chart | str, caption: str = "") -> Picture:
        """A picture from a figure or what draws it, from a chart with its caption, or the text of an SVG file.

        Where Matplotlib is not installed only texts of files are pictures, and the page goes without the others.
        """
        if not isinstance(figure, str) and not is_installed("matplotlib"):
            return cls("", caption)
        from rans.show.figures.svg import data_uri, svg

        if isinstance(figure, str):
            return cls(data_uri(figure), caption)
        if isinstance(figure, Chart):
            from rans.show.figures.chart_figure import charts_figure

            return cls(data_uri(svg(charts_figure([figure]))), figure.caption)
        return cls(data_uri(svg(figure() if callable(figure) else figure)), caption)


Part = Literal["domain", "requirement", "evidence", "limits"]
"""Question of a dossier that a fact answers: for what an agent was made, what it must do, what shows that it does,
and where it ends."""


class Fact(NamedTuple):
    """What was found, in a line: a tile or a verdict of a page, a row of a dossier, a line of a terminal."""

    what: str
    value: str
    part: Part = "evidence"
    passed: bool | None = None
    """Whether a bound is kept; None: there is none."""
    note: str = ""
    """In small letters: its interval, or what it is compared with."""
    is_asked: bool = False
    """Whether a bound is asked, so that it is undecided where ``passed`` is None."""
    leads: bool = False
    """Whether a dossier begins with it."""

    @property
    def amount(self) -> str:
        """The value, and its note in brackets."""
        return f"{self.value} ({'; '.join(self.note.splitlines())})" if self.note else self.value


@dataclass(frozen=True)
class Section:
    """What one result says, which terminals, notebooks, pages, reports and dossiers print."""

    title: str
    text: str = ""
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()
    facts: Sequence[Fact] = ()
    """The most telling first: some are tiles of the page that the section leads."""
    failures: Sequence[str] = ()
    """What could not be done, a sentence each."""
    notes: Sequence[str] = ()
    """Sentences of which nothing is to pass."""
    details: Sequence[Table] = ()
    """Tables that a page folds, and a terminal leaves out."""
    link: str = ""
    """File beside the page that says more."""
    folded: bool = False
    """Whether readers have to ask for it."""
    race: Race | None = None
    """A replay."""
    first: bool = False
    """Whether it belongs to the sheet that is printed, see `Page.sheet`."""
    hero: str = ""
    """Its result in one sentence, where it may stand above everything else."""
    flies: bool = False
    """Whether its results are flights, without which no page of an agent is green."""
    sure: Fact | None = None
    """How sure a result is: a tile of every first screen."""

    @property
    def checks(self) -> list[tuple[bool, str]]:
        """What has failed, then what has passed, each in a line."""
        lines = [(fact.passed, f"{fact.what}: {fact.amount}") for fact in self.facts]
        judged = [(passed, text) for passed, text in lines if passed is not None]
        return sorted([*((False, text) for text in self.failures), *judged], key=lambda x: x[0])

    @property
    def undrawn(self) -> int:
        """Number of pictures that Matplotlib would draw, and that are left out without it."""
        return sum(not picture.source for picture in self.pictures)

    @property
    def is_shown(self) -> bool:
        """Whether it has more than pictures that are left out."""
        more = self.text, self.tables, self.details, self.link, self.race
        return not self.undrawn or any(more) or self.undrawn < len(self.pictures)


def say(section: Section, console: Terminal) -> None:
    """Print a section: its tables but the details, its result, what is judged of it, and notes."""
    for table in section.tables:
        if table.rows:
            console.table(table)
    if section.hero:
        console.say(section.hero)
    for passed, text in section.checks:
        console.say(f"{'Pass' if passed else 'FAIL'}: {text}")
    for note in section.notes:
        console.say(note)


_TILES = 6
"""Tiles of a row on a wide screen."""
_TILE = 24
"""Most characters of a tile's value; longer ones stand in tables and dossiers alone."""


@dataclass(frozen=True)
class Page:
    """Sections on one page, the first of which that has a result gives its sentence and its tiles."""

    title: str
    sections: Sequence[Section]
    header: Mapping[str, Any] = field(default_factory=dict)
    """How it was made: command, revision, versions, hardware, seeds."""
    sheet: bool = False
    """Whether it prints as one sheet: the result, the verdict and the sections that are first."""
    written: str = ""
    """When it was written; empty: now."""

    @property
    def hero(self) -> str:
        """The result in one sentence, above everything else."""
        return next((section.hero for section in self.sections if section.hero), "")

    @property
    def tiles(self) -> list[Fact]:
        """How good, against what, how sure."""
        leading = next((section.facts for section in self.sections if section.hero), ())
        sure = [section.sure for section in self.sections if section.sure][:1]
        short = [fact for fact in leading if len(fact.value) <= _TILE and fact not in sure]
        return [*short[: _TILES - len(sure)], *sure]

    @property
    def checks(self) -> list[tuple[bool, str]]:
        """What has failed or passed, failures first; where several sections are judged, with their titles."""
        judged = [(section.title, section.checks) for section in self.sections if section.checks]
        lines = [
            (passed, f"{title}: {text}" if len(judged) > 1 else text)
            for title, checks in judged
            for passed, text in checks
        ]
        return sorted(lines, key=lambda line: line[0])

    @property
    def notes(self) -> list[str]:
        """Sentences of which nothing is to pass."""
        left_out = sum(section.undrawn for section in self.sections)
        sentence = (
            f"{counted(left_out, 'picture')} left out, which the package matplotlib draws: "
            f"{installing('plots')}"
        )
        notes = [note for section in self.sections for note in section.notes]
        return [*dict.fromkeys(notes), *([sentence] if left_out else [])]

    @property
    def passed(self) -> bool | None:
        """Whether all has passed; None where nothing was checked, no agent has flown, or a bound is undecided."""
        checks = self.checks
        if checks and not checks[0][0]:
            return False
        return True if checks and self._has_flown and not self.undecided else None

    @property
    def _has_flown(self) -> bool:
        """Whether an agent has flown, where the page is of one."""
        return not self.sheet or any(section.flies for section in self.sections)

    @property
    def undecided(self) -> list[str]:
        """Bounds that were asked for, and that too few flights decide."""
        facts = (fact for section in self.sections for fact in section.facts)
        return [f"{x.what}: {x.amount}" for x in facts if x.is_asked and x.passed is None]

    @property
    def verdict(self) -> str:
        """What was checked and how it ended, in a sentence."""
        kept = sum(passed for passed, _ in self.checks)
        text = f"{kept} of {counted(len(self.checks), 'check')} passed"
        text += f", {len(self.undecided)} undecided" if self.undecided else ""
        return text + (
            "." if self._has_flown else ": no flight of an agent is among what was checked."
        )

    def summary(self) -> Table:
        """The few most telling lines of every section, for the terminal."""
        rows = [
            ("" if number else section.title, fact.what, fact.amount)
            for section in self.sections
            for number, fact in enumerate(section.facts)
        ]
        return Table(("part", "what", "value"), rows, self.title)

    def html(self) -> str:
        """The page."""
        written = self.written or datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
        return filled(
            "page.html.j2",
            page=self,
            sections=[s for s in self.sections if s.is_shown],
            written=written,
        )

    def write(self, file: Path) -> None:
        """Write the page: readers see the old or the new one; `ConfigError` if it cannot be written."""
        write_text(file, self.html())


def filled(template: str, **values: Any) -> str:
    """The text of a template of this folder, filled with values, of which all must be there."""
    return _templates().get_template(template).render(**values)


@cache
def _templates() -> Environment:
    environment = Environment(
        loader=PackageLoader("rans.show.pages", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"show": show, "interval": _interval, "data": markup.data}
    return environment


def show(value: Any) -> str:
    """A table's cell as text."""
    return "–" if value is None else cell_text(value)  # noqa: RUF001


_WITH_INTERVAL = re.compile(r"(\S{1,12}) (\([^()]{1,36}\))")


def _interval(text: str) -> tuple[str, str]:
    """A cell as its value and the interval behind it, which may stand on a line of its own."""
    match = _WITH_INTERVAL.fullmatch(text)
    return (match[1], match[2]) if match else (text, "")


def header(about: Mapping[str, Any]) -> dict[str, str]:
    """Description of how a result was made, by name; a group of values in one line, without unknown ones ("")."""
    return {
        name: ", ".join(f"{key} {show(value)}".strip() for key, value in named(group))
        for name, group in about.items()
        if group != ""
    }


def named(value: Any, name: str = "") -> list[tuple[str, Any]]:
    """The plain values of nested mappings, by dotted name; lists become texts."""
    if not isinstance(value, Mapping):
        return [(name, ", ".join(map(show, value)) if isinstance(value, list) else value)]
    return [
        leaf
        for key, inner in value.items()
        for leaf in named(inner, f"{name}.{key}" if name else key)
    ]
