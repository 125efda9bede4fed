"""HTML of the package's values for notebooks: tables, and drawings of spacecraft."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import singledispatch
from typing import TYPE_CHECKING, Any

from rans.errors import legible
from rans.evaluation.measure.aggregate import COLUMNS, Metrics
from rans.flight import Flight
from rans.model.spacecraft import Spacecraft
from rans.randomization.conditions import Conditions
from rans.show import markup
from rans.show.figures.figures import episode_figure
from rans.show.figures.layout_figure import draw_layout
from rans.show.figures.svg import data_uri, svg
from rans.show.pages.page import Section, filled
from rans.show.tables.listing import (
    conditions_listing,
    spacecraft_listing,
    task_listings,
    thruster_listing,
)
from rans.table import Table
from rans.tasks import Task

if TYPE_CHECKING:
    from rans.evaluation.compare.run import Comparison

_SIDE = "display:flex;flex-wrap:wrap;gap:1.5em;align-items:flex-start"


@singledispatch
def html_of(value: Any) -> str:
    """A value as HTML; texts in it are no mark-up."""
    # Comparisons need packages that other values do not: if there is one, its module is imported.
    module = sys.modules.get("rans.evaluation.compare.run")
    if module is not None and isinstance(value, module.Comparison):
        return _comparison(value)
    raise TypeError(f"notebooks show no {type(value).__name__}")


@html_of.register
def _(craft: Spacecraft) -> str:
    picture = (
        f'<img style="width:24em;max-width:100%" src="{data_uri(svg(draw_layout(craft)))}" '
        f'alt="{_said(craft.name)}: force of each thruster">'
    )
    tables = _table(spacecraft_listing(craft)) + _table(thruster_listing(craft))
    return f'<div style="{_SIDE}"><div>{tables}</div>{picture}</div>'


@html_of.register
def _(task: Task) -> str:
    summary = (type(task).__doc__ or "").strip().partition("\n")[0]
    listings = (
        listing for listing in task_listings(task) if not listing.title.startswith("Observation")
    )
    return f"<p><b>{_said(type(task).__name__)}</b>: {_said(summary)}</p>{''.join(map(_table, listings))}"


@html_of.register
def _(conditions: Conditions) -> str:
    return _table(conditions_listing(conditions))


@html_of.register
def _(metrics: Metrics) -> str:
    rows = [
        (name, value, interval, meaning) for _, (name, value, interval, meaning) in metrics.lines()
    ]
    return _table(Table(COLUMNS, rows, metrics.title()))


def _comparison(comparison: Comparison) -> str:
    """HTML of a comparison: its scores as a table, then notes and failures."""
    from rans.show.tables.comparison_tables import score_table

    paragraphs = "".join(
        f"<p>{_said(text)}</p>" for text in (*comparison.notes, *comparison.failures)
    )
    return _table(replace(score_table(comparison), title=comparison.contest.title())) + paragraphs


@html_of.register
def _(flight: Flight) -> str:
    picture = data_uri(svg(episode_figure(flight)))
    return f'<p>{_said(repr(flight))}</p><img style="max-width:100%" src="{picture}" alt="The first episode">'


@html_of.register
def _(section: Section) -> str:
    sentences = (section.hero, *(text for _, text in section.checks), *section.notes)
    paragraphs = (f"<p>{_said(text)}</p>" for text in sentences if text)
    return "".join((*map(_table, section.tables), *paragraphs))


def listed(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table as HTML, of what has no form of its own here."""
    return _table(Table(columns, rows, title))


def _table(listing: Table) -> str:
    return filled("notebook.html.j2", table=listing)


def _said(text: str) -> str:
    return markup.text(legible(text)).replace("\n", "<br>")
