"""A chart of a page as a figure for papers: the same series, marks and intervals, drawn by Matplotlib."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from rans.show.figures.comparison_figures import logarithmic
from rans.show.figures.figures import styled
from rans.show.figures.panels import STYLE, label
from rans.show.figures.picture_file import save_picture
from rans.show.figures.plotting import Axes, Figure, rc_context
from rans.show.pages.chart import Chart, Mark, Series
from rans.show.palette import GREY, INK

_COLOURS = {"var(--ink)": INK, "var(--soft)": GREY}
"""Colours of pages that follow the reader's choice of light or dark, on paper."""
_FONTS: dict[Any, Any] = {"pdf.fonttype": 42}
"""TrueType, which publishers ask for in place of Matplotlib's Type 3."""


def save_chart(chart: Chart, file: Path) -> list[Path]:
    """Write a chart as FILE.svg and FILE.pdf, and return both.

    Raises:
        ConfigError: a file cannot be written.
    """
    files = [file.with_name(f"{file.name}{suffix}") for suffix in (".svg", ".pdf")]
    figure = chart_figure(chart)
    with rc_context(STYLE | _FONTS):
        for one in files:
            save_picture(figure, one)
    return files


@styled
def chart_figure(chart: Chart) -> Figure:
    """The figure of a chart, as wide as a column and a half of a paper, with the legend below."""
    figure = Figure(figsize=(5.4, 4.2), layout="constrained")
    axes = figure.subplots()
    for low, high, _ in chart.shaded:
        axes.axvspan(low, high, color=GREY, alpha=0.16, linewidth=0, label="provably impossible")
    for series in chart.series:
        _draw(axes, series)
    if chart.logarithmic:
        for axis in (axes.xaxis, axes.yaxis):
            logarithmic(axes, axis)
    if chart.shaded:
        # From the left edge on: a range from 0 has no beginning on a logarithmic axis.
        axes.set_xlim(left=0.9 * min(high for _, high, _ in chart.shaded))
    if chart.y_range is not None:
        axes.set_ylim(*chart.y_range)
    label(axes, "", chart.x_label, chart.y_label)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)
    return figure


def _draw(axes: Axes, series: Series) -> None:
    """The line of a series, and its marks with their intervals."""
    marks = [mark for mark in series.marks if math.isfinite(mark.x) and math.isfinite(mark.y)]
    if not marks:
        return
    colour = _COLOURS.get(series.colour, series.colour)
    hollow = series.marker == "ring"
    style: dict[str, Any] = {"markerfacecolor": "none"} if hollow else {}
    axes.errorbar(
        [mark.x for mark in marks],
        [mark.y for mark in marks],
        xerr=_bars(marks, "x"),
        yerr=_bars(marks, "y"),
        color=colour,
        marker="o" if hollow else series.marker,
        linestyle={"solid": "-", "dotted": ":"}.get(series.line, ""),
        markersize=6,
        elinewidth=1.2,
        capsize=2.5,
        label=series.name,
        **style,
    )


def _bars(marks: list[Mark], axis: str) -> list[list[float]] | None:
    """Distances of the ends of intervals from their marks, below and above; an end at infinity is not drawn."""
    bars = []
    for mark in marks:
        value = getattr(mark, axis)
        interval = getattr(mark, f"{axis}_interval") or (value, value)
        bars.append([abs(end - value) if math.isfinite(end) else 0.0 for end in interval])
    return [list(ends) for ends in zip(*bars, strict=True)] if any(map(any, bars)) else None
