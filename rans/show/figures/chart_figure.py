"""Charts (`rans.show.pages.chart`) as figures for papers and in pages: the same axes, marks and intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rans.base.errors import legible
from rans.show.figures.panels import PLAIN, STYLE, label, styled
from rans.show.figures.picture_file import save_picture
from rans.show.figures.plotting import (
    Axes,
    Axis,
    Figure,
    FuncFormatter,
    LogLocator,
    MaxNLocator,
    NullLocator,
    rc_context,
)
from rans.show.palette import GREY, INK

if TYPE_CHECKING:
    from rans.show.pages.chart import Chart, Mark, Series

_COLOURS = {"var(--ink)": INK, "var(--soft)": GREY}
"""Colours of pages that follow the reader's choice of light or dark, on paper."""
_PAPER: dict[Any, Any] = {"pdf.fonttype": 42, "lines.markersize": 6}
"""TrueType, which publishers ask for in place of Matplotlib's Type 3."""
_COLUMNS = 3
"""Most charts beside each other."""
_MARKERS = {"ring": "o", "": ""} | {one: one for one in "osD^vx_P."}
"""Matplotlib's markers by those of series."""


def save_chart(chart: Chart, file: Path) -> list[Path]:
    """Write a chart as FILE.svg and FILE.pdf, and return both.

    Raises:
        ConfigError: a file cannot be written.
    """
    files = [file.with_name(f"{file.name}{suffix}") for suffix in (".svg", ".pdf")]
    figure = charts_figure([chart])
    with rc_context(STYLE | _PAPER):
        for one in files:
            save_picture(figure, one)
    return files


@styled
def charts_figure(charts: Sequence[Chart]) -> Figure:
    """Charts side by side, each as wide as a column and a half of a paper, with its legend below."""
    columns = min(len(charts), _COLUMNS)
    rows = math.ceil(len(charts) / columns)
    with rc_context(_PAPER):
        figure = Figure(figsize=(5.4 * columns, 4.2 * rows), layout="constrained")
        for number, chart in enumerate(charts, 1):
            axes = figure.add_subplot(rows, columns, number)
            _draw(axes, chart)
            if axes.get_legend_handles_labels()[1]:
                axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)
    return figure


def _draw(axes: Axes, chart: Chart) -> None:
    """Everything of a chart but its legend: shaded ranges, series, axes."""
    for low, high in chart.shaded:
        axes.axvspan(low, high, color=GREY, alpha=0.16, linewidth=0, label="provably impossible")
    lowest = _lowest(chart)
    for series in chart.series:
        _draw_series(axes, series, lowest)
    for name, axis in (("x", axes.xaxis), ("y", axes.yaxis)):
        if name in chart.logarithmic:
            _logarithmic(axes, axis)
        else:
            axis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
            axis.set_major_formatter(FuncFormatter(lambda x, _: tick_label(x)))
    if chart.shaded:
        # From the left edge on: a range from 0 has no beginning on a logarithmic axis.
        marks = (max(mark.x, lowest[0]) for series in chart.series for mark in series.finite)
        axes.set_xlim(left=0.9 * min(*(high for _, high in chart.shaded), *marks))
    if chart.y_range is not None:
        low, high = chart.y_range
        axes.set_ylim(low - 0.02 * (high - low), high + 0.02 * (high - low))
    texts = (
        f"{text} (logarithmic)" if name in chart.logarithmic else text
        for name, text in (("x", chart.x_label), ("y", chart.y_label))
    )
    label(axes, "", *map(legible, texts))


def _logarithmic(axes: Axes, axis: Axis) -> None:
    """Plain numbers at 1, 2 and 5 times powers of ten; nothing where no value is positive."""
    least, scale = (
        (axes.dataLim.minposx, axes.set_xscale)
        if axis is axes.xaxis
        else (axes.dataLim.minposy, axes.set_yscale)
    )
    if not np.isfinite(least):
        return
    scale("log")
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=20))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(PLAIN)


def _lowest(chart: Chart) -> tuple[float, float]:
    """Where marks at 0 stand along x and y: a logarithm has no place for them, and they are below all others."""
    marks = [mark for series in chart.series for mark in series.finite]
    x, y = (
        0.5 * min((value for value in values if value > 0.0), default=2.0)
        if name in chart.logarithmic
        else -math.inf
        for name, values in (("x", [mark.x for mark in marks]), ("y", [mark.y for mark in marks]))
    )
    return x, y


def _draw_series(axes: Axes, series: Series, lowest: tuple[float, float]) -> None:
    """The line of a series, and its marks with their intervals; marks below the axis stand at its edge."""
    marks = series.finite
    if not marks:
        return
    colour = _COLOURS.get(series.colour, series.colour)
    hollow: dict[str, Any] = {"markerfacecolor": "none"} if series.marker == "ring" else {}
    x = [max(mark.x, lowest[0]) for mark in marks]
    is_band = not series.marker and marks[0].y_interval is not None
    if is_band:
        low, high = zip(*(mark.y_interval for mark in marks if mark.y_interval), strict=True)
        axes.fill_between(x, low, high, color=colour, alpha=0.2, linewidth=0)
    axes.errorbar(
        x,
        [max(mark.y, lowest[1]) for mark in marks],
        xerr=_bars(marks, "x"),
        yerr=None if is_band else _bars(marks, "y"),
        color=colour,
        marker=_MARKERS.get(series.marker, "o"),
        linestyle={"solid": "-", "dotted": ":"}.get(series.line, ""),
        elinewidth=1.2,
        capsize=2.5,
        label=series.name,
        clip_on=False,
        **hollow,
    )


def _bars(marks: list[Mark], axis: str) -> list[list[float]] | None:
    """Distances of the ends of intervals from their marks, below and above; an end at infinity is not drawn."""
    bars = []
    for mark in marks:
        value = getattr(mark, axis)
        interval = getattr(mark, f"{axis}_interval") or (value, value)
        bars.append([abs(end - value) if math.isfinite(end) else 0.0 for end in interval])
    return [list(ends) for ends in zip(*bars, strict=True)] if any(map(any, bars)) else None


def tick_label(value: float) -> str:
    """A tick's number; millions as "5 M", thousands from 10,000 on as "20 k".

    >>> tick_label(2_500_000.0), tick_label(20_000.0), tick_label(0.3), tick_label(-0.0)
    ('2.5 M', '20 k', '0.3', '0')
    """
    if abs(value) >= 1e6:
        return f"{value / 1e6:g} M"
    if abs(value) >= 1e4:
        return f"{value / 1e3:g} k"
    return f"{round(value, 9) + 0.0:g}"
