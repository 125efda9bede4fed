"""The figure of a front: the line of a trade-off, everybody else, and what is certified to be impossible."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rans.errors import counted
from rans.evaluation.compare.bounds import Event
from rans.evaluation.compare.contest import Entry
from rans.evaluation.compare.front import Front, point
from rans.show.figures import panels
from rans.show.figures.comparison_figures import logarithmic
from rans.show.figures.figures import styled
from rans.show.figures.panels import GREY, INK, label, series_style


@styled
def front_figure(front: Front, curve: Sequence[Entry] = ()) -> Figure:
    """Everybody's mean time and impulse above the bounds; the curve is of a controller's weights."""
    figure = Figure(figsize=(8.0, 4.4), layout="constrained")
    cells = figure.add_gridspec(1, 2, width_ratios=(1.4, 1.0))
    left = figure.add_subfigure(cells[0])
    right = figure.add_subfigure(cells[1])
    axes = left.subplots()
    _draw_bounds(axes, front)
    if curve:
        axes.plot(
            *_places(curve),
            color=GREY,
            marker=".",
            linewidth=1.0,
            zorder=2,
            label=f"LQR, {counted(len(curve), 'weight')}",
        )
    lines = front.lines()
    for k, (agent, line) in enumerate(lines.items()):
        _draw_line(axes, front, agent, line, k)
    for k, other in enumerate(front.others(), len(lines)):
        colour, marker = series_style(k)
        axes.plot(
            *_places([other]),
            color=colour,
            marker=marker,
            markersize=7,
            linestyle="",
            markeredgecolor="white",
            label=_named(other),
            zorder=5,
        )
    for axis in (axes.xaxis, axes.yaxis):
        logarithmic(axes, axis, (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0))
    label(
        axes,
        f"time against impulse, means over {counted(front.contest.episodes, 'start')}",
        "time first at rest in the goal set, s",
        f"impulse of {front.contest.duration:g} s, N s",
    )
    panels.legend_beside(right, axes)
    return figure


def _draw_bounds(axes: Axes, front: Front) -> None:
    """Least time as a line, least impulse at each horizon as bars, and for the times of every position."""
    result = front.front()
    if not result:
        return
    least = result[Event()]
    starts = f"mean of {counted(len(front.starts()), 'start')}"
    axes.axvspan(1e-3, least, color=GREY, alpha=0.15, linewidth=0)
    axes.axvline(
        least,
        color=INK,
        linewidth=1.2,
        label=f"certified least time to be at rest\nin the goal set, {starts}",
    )
    bars = np.array(
        [(event.horizon, bound) for event, bound in result.items() if event.horizon is not None]
    )
    axes.plot(
        *bars[np.isfinite(bars).all(axis=1)].T,
        linestyle=":",
        linewidth=0.8,
        color=INK,
        marker="_",
        markersize=8,
        markeredgewidth=2.5,
        label=f"certified least impulse to be at rest in it\nat this time from each start, {starts}",
    )
    axes.set_xlim(0.8 * least, 1.15 * front.horizons[-1])


def _draw_line(axes: Axes, front: Front, agent: str, line: Sequence[Entry], k: int) -> None:
    """All positions, the first, middle and last with the trade-off; below each its own bound."""
    colour, marker = series_style(k)
    axes.plot(
        *_places(line),
        color=colour,
        marker=marker,
        markersize=4.5,
        linewidth=1.6,
        zorder=4,
        label=f"{agent}, trade-off at {counted(len(line), 'position')}",
    )
    for one in (line[0], line[len(line) // 2], line[-1]):
        place = point(one)
        axes.annotate(
            f"{one.contestant.trade_off:g}",
            (place.time, place.impulse),
            (4, 4),
            textcoords="offset points",
            fontsize=7,
        )
    bounds = [(own.time, own.bound) for one in line if (own := front.multiple(one))]
    if bounds:
        axes.plot(
            *np.transpose(bounds),
            color=colour,
            marker="+",
            markersize=5,
            linestyle="",
            zorder=3,
            label="certified least impulse to be at rest in it\nwhen the flight was, from each start",
        )


def _places(entries: Sequence[Entry]) -> np.ndarray:
    """(2, N): times and impulses."""
    return np.array([point(entry)[:2] for entry in entries]).T


def _named(entry: Entry) -> str:
    """With the share of starts from which it gets there, if not all."""
    there = point(entry).there
    return entry.name if there == 1.0 else f"{entry.name} ({100.0 * there:.3g} % get there)"
