"""Charts (`rans.show.pages.chart`) as figures for papers and in pages: the same axes, marks and intervals."""

from __future__ import annotations

import math
import re
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rans.errors import legible
from rans.show.figures.comparison_figures import logarithmic
from rans.show.figures.figures import styled
from rans.show.figures.panels import STYLE, label
from rans.show.figures.picture_file import save_picture
from rans.show.figures.plotting import Axes, Figure, FuncFormatter, MaxNLocator, rc_context
from rans.show.figures.svg import svg
from rans.show.markup import Markup, drawing
from rans.show.pages.chart import Chart, Mark, Series
from rans.show.palette import GREY, INK, LINES

_COLOURS = {"var(--ink)": INK, "var(--soft)": GREY}
"""Colours of pages that follow the reader's choice of light or dark, on paper."""
_PAPER: dict[Any, Any] = {"pdf.fonttype": 42, "text.parse_math": False, "lines.markersize": 6}
"""TrueType, which publishers ask for in place of Matplotlib's Type 3; names with a $ are no mathematics."""
_MARKERS = {"ring": "o", "": "o"} | {one: one for one in "osD^vx_P."}
"""Matplotlib's markers by those of series; without one the marks cannot be seen, but pointed at."""
_PAGE: dict[Any, Any] = _PAPER | {"font.size": 13, "svg.fonttype": "none", "lines.markersize": 9}
"""Sizes in CSS pixels of a page, where letters are the browser's."""
_PAGE_INCHES = 10.0, 5.6
"""720 by 403 points, which are the pixels of the picture's own coordinates."""
_PAGE_PADS = 12.0, 18.0
"""Points between an axis and its name: on a telephone the numbers there are 21 pixels high."""
_SVG = "{http://www.w3.org/2000/svg}"
_LINK = "{http://www.w3.org/1999/xlink}href"
"""As files have it; the SVG of a page has href alone."""
_INKS = {INK: "var(--ink)", GREY: "var(--soft)", LINES: "var(--line)"}


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
    with rc_context(_PAPER):
        figure = Figure(figsize=(5.4 * len(charts), 4.2), layout="constrained")
        grid = figure.subplots(1, len(charts), squeeze=False)[0]
        for axes, chart in zip(grid, charts, strict=True):
            _draw(axes, chart)
            if axes.get_legend_handles_labels()[1]:
                axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)
    return figure


@styled
def _page_figure(chart: Chart) -> Figure:
    """A chart without a legend, which is the page's own."""
    with rc_context(_PAGE):
        figure = Figure(figsize=_PAGE_INCHES, layout="constrained")
        axes = figure.subplots()
        _draw(axes, chart)
        axes.xaxis.labelpad = _PAGE_PADS[0]
        axes.yaxis.labelpad = _PAGE_PADS[1]
    return figure


def inline(chart: Chart) -> Markup:
    """The SVG element of a page: every mark says what it is, and inks follow the reader's choice.

    Groups of series have the class series and their number as data-series; marks have the class point.
    """
    if chart.is_empty:
        return drawing(())
    with rc_context(_PAGE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # the browser has its own letters
        root = ET.fromstring(svg(_page_figure(chart)))
    # What only a file of its own needs, and names that several charts of a page would have.
    for parent in [*root.iter()]:
        for child in [*parent]:
            if child.tag in {f"{_SVG}metadata", f"{_SVG}style"}:
                parent.remove(child)
    for name in ("width", "height", "version"):
        root.attrib.pop(name, None)
    root.attrib |= {"role": "group", "aria-label": chart.caption}
    for use in root.iter(f"{_SVG}use"):
        use.set("href", use.attrib.pop(_LINK))
    # Lines, bars and marks of series.
    for group in root.iter(f"{_SVG}g"):
        kind, _, number = group.attrib.pop("id", "").partition(" ")
        if kind == "shade":
            ET.SubElement(group, f"{_SVG}title").text = chart.shaded[int(number)][2]
        if kind not in ("series", "bars"):
            continue
        group.attrib |= {"class": "series", "data-series": number}
        if kind == "bars":
            continue
        marks = chart.series[int(number)].finite
        for use, mark in zip(group.iter(f"{_SVG}use"), marks, strict=False):
            use.attrib |= {
                "class": "point",
                "tabindex": "0",
                "role": "img",
                "aria-label": mark.text,
            }
            ET.SubElement(use, f"{_SVG}title").text = mark.text
    ET.register_namespace("", _SVG[1:-1])
    text = re.sub(r"font-family: [^;]*; ", "", ET.tostring(root, "unicode"))
    for ink, name in _INKS.items():
        text = re.sub(rf"(?<=: ){ink}(?=[;\"])", name, text, flags=re.IGNORECASE)
    return drawing((text,))


def _draw(axes: Axes, chart: Chart) -> None:
    """Everything of a chart but its legend: shaded ranges, series, axes; ids name them for dark pages."""
    for number, (low, high, _) in enumerate(chart.shaded):
        band = axes.axvspan(low, high, color=GREY, alpha=0.16, linewidth=0)
        band.set(label="provably impossible", gid=f"shade {number}")
    lowest = _lowest(chart)
    for number, series in enumerate(chart.series):
        _draw_series(axes, series, number, lowest)
    for axis in (axes.xaxis, axes.yaxis):
        if chart.logarithmic:
            logarithmic(axes, axis)
        else:
            axis.set_major_locator(MaxNLocator(6))
            axis.set_major_formatter(FuncFormatter(lambda x, _: tick_label(x)))
    if chart.shaded:
        # From the left edge on: a range from 0 has no beginning on a logarithmic axis.
        marks = (max(mark.x, lowest[0]) for series in chart.series for mark in series.finite)
        axes.set_xlim(left=0.9 * min(*(high for _, high, _ in chart.shaded), *marks))
    if chart.y_range is not None:
        low, high = chart.y_range
        axes.set_ylim(low - 0.02 * (high - low), high + 0.02 * (high - low))
    label(axes, "", legible(chart.x_label), legible(chart.y_label))


def _lowest(chart: Chart) -> tuple[float, float]:
    """Where marks at 0 stand along x and y: a logarithm has no place for them, and they are below all others."""
    if not chart.logarithmic:
        return -math.inf, -math.inf
    marks = [mark for series in chart.series for mark in series.finite]
    x, y = (
        0.5 * min((value for value in values if value > 0.0), default=2.0)
        for values in ((mark.x for mark in marks), (mark.y for mark in marks))
    )
    return x, y


def _draw_series(axes: Axes, series: Series, number: int, lowest: tuple[float, float]) -> None:
    """The line of a series, and its marks with their intervals; marks below the axis stand at its edge.

    `inline` finds series and bars by these ids, and takes marks in the order of `Series.finite`.
    """
    marks = series.finite
    if not marks:
        return
    colour = _COLOURS.get(series.colour, series.colour)
    hollow = series.marker in ("ring", "")
    unseen: dict[str, Any] = {"markerfacecolor": "none"} if hollow else {}
    if not series.marker:
        unseen["markeredgecolor"] = "none"
    drawn = axes.errorbar(
        [max(mark.x, lowest[0]) for mark in marks],
        [max(mark.y, lowest[1]) for mark in marks],
        xerr=_bars(marks, "x"),
        yerr=_bars(marks, "y"),
        color=colour,
        marker=_MARKERS.get(series.marker, "o"),
        linestyle={"solid": "-", "dotted": ":"}.get(series.line, ""),
        elinewidth=1.2,
        capsize=2.5,
        label=series.name,
        clip_on=False,
        **unseen,
    )
    line, *bars = drawn.get_children()
    line.set_gid(f"series {number}")
    for bar in bars:
        bar.set_gid(f"bars {number}")


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
