"""HTML of the package's values for notebooks: each is a section, as pages have them."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

from rans.base.errors import legible
from rans.base.table import Table
from rans.episode.flight import Flight
from rans.evaluation.measure.aggregate import COLUMNS, Metrics
from rans.model.spacecraft import Spacecraft
from rans.randomization.conditions import Conditions
from rans.show import markup
from rans.show.figures.figures import episode_figure
from rans.show.figures.layout_figure import draw_layout
from rans.show.pages.page import Picture, Section, filled
from rans.show.tables.listing import (
    conditions_listing,
    spacecraft_listing,
    task_listings,
    thruster_listing,
)
from rans.tasks import Task


def html_of(value: Any) -> str:
    """A value as HTML: a table, a section, or what has one; texts in it are no mark-up."""
    section = _section(value)
    sentences = (section.text, section.hero, *(x for _, x in section.checks), *section.notes)
    parts = [f"<p>{_said(text)}</p>" for text in sentences if text]
    parts += (filled("notebook.html.j2", table=table) for table in section.tables)
    parts += (
        f'<img style="max-width:100%" src="{picture.source}" alt="{_said(picture.caption)}">'
        for picture in section.pictures
    )
    return "".join(parts)


def _section(value: Any) -> Section:
    """What a notebook says of a value."""
    match value:
        case Section():
            return value
        case Table():
            return Section(value.title, tables=[value])
        case Conditions():
            return _section(conditions_listing(value))
        case Metrics():
            return _section(Table(COLUMNS, [cells for _, cells in value.lines()], value.title()))
        case Spacecraft():
            picture = Picture.of(draw_layout(value), f"{value.name}: force of each thruster")
            tables = [spacecraft_listing(value), thruster_listing(value)]
            return Section(value.name, tables=tables, pictures=[picture])
        case Flight():
            picture = Picture.of(episode_figure(value), "The first episode")
            return Section("Flight", repr(value), pictures=[picture])
        case Task():
            name = type(value).__name__
            summary = (type(value).__doc__ or "").strip().partition("\n")[0]
            tables = [x for x in task_listings(value) if not x.title.startswith("Observation")]
            return Section(name, f"{name}: {summary}", tables)
    # Comparisons need packages that other values do not: if there is one, its module is imported.
    module = sys.modules.get("rans.evaluation.compare.run")
    if module is None or not isinstance(value, module.Comparison):
        raise TypeError(f"notebooks show no {type(value).__name__}")
    from rans.show.tables.comparison_tables import score_table, verdict

    table = replace(score_table(value), title=value.contest.title())
    said = " ".join(verdict(value))
    return Section("Comparison", said, [table], failures=value.failures, notes=value.notes)


def _said(text: str) -> str:
    return markup.text(legible(text)).replace("\n", "<br>")
