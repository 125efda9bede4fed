"""Figures of a comparison; see `rans.show.figures.figures` for what they share with all others."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from rans.errors import counted
from rans.evaluation.compare.bounds import Event
from rans.evaluation.compare.contest import Entry
from rans.evaluation.compare.run import Comparison
from rans.evaluation.measure.statistics import Bootstrap, Estimate
from rans.flight import Flight
from rans.optimal.trajectory.objectives import MinimumFuel, MinimumTime
from rans.show.figures import panels
from rans.show.figures.figures import styled
from rans.show.figures.panels import GREY, INK, PLAIN, RED, label, series_style
from rans.show.tables.comparison_tables import RETURN, Scores
from rans.tasks.quantities import QUANTITIES


def logarithmic(axes: Axes, axis: Axis, marks: Sequence[float] = (1.0, 2.0, 5.0)) -> None:
    """Plain numbers at these multiples of powers of ten; nothing where no value is positive."""
    least, scale = (
        (axes.dataLim.minposx, axes.set_xscale)
        if axis is axes.xaxis
        else (axes.dataLim.minposy, axes.set_yscale)
    )
    if not np.isfinite(least):
        return
    scale("log")
    axis.set_major_locator(LogLocator(subs=marks, numticks=20))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(PLAIN)


@styled
def plane(comparison: Comparison) -> Figure:
    """First arrival, and thrust-time until then: bounds, controls found and contestants, by medians.

    All are over the same starts: the certified ones if there are any, otherwise all.
    """
    starts = comparison.certified_starts() or list(range(comparison.contest.episodes))
    bootstrap = Bootstrap(len(starts))
    figure = Figure(figsize=(8.0, 4.2), layout="constrained")
    cells = figure.add_gridspec(1, 2, width_ratios=(1.4, 1.0))
    left = figure.add_subfigure(cells[0])
    right = figure.add_subfigure(cells[1])
    axes = left.subplots()
    if comparison.certified_starts():
        _draw_certified(axes, comparison)
    _draw_relaxed(axes, comparison, starts)
    _draw_sweep(axes, comparison, starts)
    for k, entry in enumerate(comparison.entries):
        _draw_contestant(axes, entry, starts, bootstrap, k)
    for axis in (axes.xaxis, axes.yaxis):
        logarithmic(axes, axis, (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0))
    label(
        axes,
        f"first arrival in the goal set, medians over {counted(len(starts), 'start')}",
        "time of first arrival, s",
        "thrust-time until then, N s",
    )
    panels.legend_beside(right, axes)
    return figure


def _draw_certified(axes: Axes, comparison: Comparison) -> None:
    """Least time as a line, least thrust-time as bars with what was found on or above them."""
    least = float(np.median(comparison.bounds(Event())[0].values))
    horizons = np.array(comparison.horizons())
    others = [
        [np.median(bound.values) for bound in comparison.bounds(Event(horizon=horizon))]
        for horizon in comparison.horizons()
    ]
    axes.axvspan(
        1e-3, least, color=GREY, alpha=0.15, linewidth=0, label="provably impossible (medians)"
    )
    axes.axvline(least, color=INK, linewidth=1.2, label="certified least time to arrive")
    lower, upper = np.transpose(others)
    shown = np.isfinite(lower)
    axes.plot(horizons[shown], lower[shown], linestyle=":", color=INK, linewidth=0.8)
    axes.plot(
        horizons[shown],
        lower[shown],
        linestyle="",
        marker="_",
        markersize=16,
        markeredgewidth=2.5,
        color=INK,
        label="certified least thrust-time at these times",
    )
    if np.isfinite(upper).any():
        axes.plot(
            horizons,
            upper,
            linestyle="",
            marker="o",
            markersize=8,
            markerfacecolor="none",
            markeredgecolor=RED,
            markeredgewidth=1.3,
            label="best on/off controls found, replayed",
        )
    axes.set_xlim(0.8 * least, 1.15 * horizons[-1])


def _draw_relaxed(axes: Axes, comparison: Comparison, starts: Sequence[int]) -> None:
    points = []
    lost = False
    for rows in comparison.relaxed.values():
        chosen = [rows[k] for k in starts if rows[k].solved]
        if chosen and isinstance(chosen[0].objective, MinimumTime | MinimumFuel):
            lost = lost or len(chosen) < len(starts)
            points.append(
                [np.median([getattr(row, key) for row in chosen]) for key in ("arrival", "thrust")]
            )
    if points:
        axes.plot(
            *np.transpose(points),
            linestyle="",
            marker="x",
            color=INK,
            label=f"relaxed thrust, exact goal (no controller{', where found' if lost else ''})",
        )


def _draw_sweep(axes: Axes, comparison: Comparison, starts: Sequence[int]) -> None:
    """The LQR of all weights as a curve, in their order."""
    points = np.array(
        [[np.median(x[starts]) for x in (e.arrival, e.arrival_thrust)] for e in comparison.curve]
    )
    for k in (0, -1) if len(points) else ():
        axes.annotate(
            comparison.curve[k].name, points[k], (4, 4), textcoords="offset points", fontsize=7
        )
    if len(points):
        axes.plot(
            *points[np.isfinite(points).all(axis=1)].T,
            color=GREY,
            marker=".",
            linewidth=1.0,
            label=f"LQR, {counted(len(points), 'weight')}",
        )


def _draw_contestant(
    axes: Axes, entry: Entry, starts: Sequence[int], bootstrap: Bootstrap, k: int
) -> None:
    """A point with its intervals; in the legend, how many never arrive."""
    colour, marker = series_style(k)
    x, y = (bootstrap.median(values[starts]) for values in (entry.arrival, entry.arrival_thrust))
    count = int(np.isfinite(entry.arrival[starts]).sum())
    name = entry.name + ("" if count == len(starts) else f" ({count} of {len(starts)} arrive)")
    axes.errorbar(
        [x.value],
        [y.value],
        xerr=_bars(x),
        yerr=_bars(y),
        color=colour,
        marker=marker,
        markersize=7,
        linestyle="",
        elinewidth=1.4,
        capsize=2.5,
        markeredgecolor="white",
        label=name,
        zorder=5,
    )


def _bars(estimate: Estimate) -> np.ndarray:
    """Distances to the interval's ends; an end at infinity is not drawn."""
    with np.errstate(invalid="ignore"):
        ends = np.array([[estimate.value - estimate.low], [estimate.high - estimate.value]])
    return np.where(np.isfinite(ends), ends, 0.0)


@styled
def gap_histograms(gaps: dict[str, dict[str, np.ndarray]], questions: Sequence[str]) -> Figure:
    """How far above the certified bounds flights are: a panel for each of these questions of `gaps`."""
    names = list(dict.fromkeys(name for question in questions for name in gaps[question]))
    figure = Figure(figsize=(4.6 * len(questions), 1.3 + 0.5 * len(names)), layout="constrained")
    grid = figure.subplots(1, len(questions), squeeze=False)[0]
    for axes, question in zip(grid, questions, strict=True):
        _histograms(axes, gaps[question], names)
        label(axes, question, "times the certified bound", "")
    return figure


def _histograms(axes: Axes, ratios: dict[str, np.ndarray], names: Sequence[str]) -> None:
    """Who stands where: everybody's bars are at their own values; the highest of a panel fills its row."""
    finite = np.concatenate([r[np.isfinite(r)] for r in ratios.values()])
    top = max(1.2, 1.02 * float(finite.max(initial=1.0)))
    edges = np.linspace(1.0, top, 21)
    width = edges[1] - edges[0]
    never = top + 1.5 * width
    bins = [*edges, never - width / 2, never + width / 2]
    counts = {
        name: np.histogram(np.where(np.isfinite(r), r, never), bins)[0]
        for name, r in ratios.items()
    }
    highest = max(1, *(count.max() for count in counts.values()))
    for k, name in enumerate(names):
        if name in counts:
            colour = INK if name == "best found" else series_style(k)[0]
            axes.bar(
                bins[:-1],
                0.85 * counts[name] / highest,
                np.diff(bins),
                -k,
                color=colour,
                align="edge",
            )
        axes.axhline(-k, color=GREY, linewidth=0.6)
    axes.set_yticks([0.35 - k for k in range(len(names))], names)
    ticks = [float(x) for x in axes.get_xticks() if 1.0 <= x <= top]
    axes.set_xticks([*ticks, never], [*(f"{x:g}" for x in ticks), "not\nthere"])
    axes.set(xlim=(1.0 - width / 2, never + width), ylim=(0.9 - len(names), 1.0))
    axes.grid(axis="y", visible=False)


@styled
def final_error_curves(entries: Sequence[Entry]) -> Figure:
    """Share of all starts whose mean error over the last fifth is at most so much."""
    quantities = list(entries[0].errors)
    figure = Figure(figsize=(4.6 * len(quantities), 3.4), layout="constrained")
    grid = figure.subplots(1, len(quantities), squeeze=False)[0]
    for axes, quantity in zip(grid, quantities, strict=True):
        factor, unit = QUANTITIES[quantity].display
        for k, entry in enumerate(entries):
            axes.ecdf(factor * entry.errors[quantity], color=series_style(k)[0], label=entry.name)
        bound = entries[0].flight.task.tolerances().get(quantity)
        if bound is not None:
            axes.axvline(
                factor * bound, color=INK, linestyle="--", linewidth=1.0, label="tolerance"
            )
        axes.set_ylim(0.0, 1.02)
        logarithmic(axes, axes.xaxis)
        label(
            axes,
            f"final {quantity} error",
            f"{quantity} error, mean of the last fifth, {unit}",
            "share of starts",
        )
        axes.legend(loc="best")
    return figure


@styled
def shares_and_latency(board: dict[str, Scores]) -> Figure:
    """Share of the possible return, where it is known, and time an action takes."""
    keys = [key for key in (RETURN, "latency, ms") if all(key in row for row in board.values())]
    figure = Figure(figsize=(4.6 * len(keys), 1.3 + 0.32 * len(board)), layout="constrained")
    grid = figure.subplots(1, len(keys), squeeze=False)[0]
    for axes, key in zip(grid, keys, strict=True):
        for k, row in enumerate(board.values()):
            colour, marker = series_style(k)
            axes.errorbar(
                [row[key].value],
                [-k],
                xerr=_bars(row[key]),
                color=colour,
                marker=marker,
                linestyle="",
                elinewidth=1.6,
                capsize=3,
                markersize=6,
            )
        axes.set_yticks([-k for k in range(len(board))], list(board))
        axes.set_ylim(0.6 - len(board), 0.6)
        label(axes, key.split(",")[0], key, "")
    logarithmic(grid[-1], grid[-1].xaxis)
    return figure


@styled
def side_by_side(flights: Sequence[tuple[str, Flight, int]]) -> Figure:
    """Paths and open thrusters of everybody from one start: name, flight and the episode in it."""
    figure = Figure(figsize=(max(7.0, 3.0 * len(flights)), 5.4), layout="constrained")
    columns = figure.add_gridspec(1, len(flights))
    limits = dict(zip(("xlim", "ylim", "zlim"), _common_limits(flights), strict=False))
    for k, (name, flight, episode) in enumerate(flights):
        column = figure.add_subfigure(columns[0, k])
        cells = column.add_gridspec(2, 1, height_ratios=(1.5, 1.0))
        above, below = (column.add_subfigure(cells[row]) for row in (0, 1))
        panels.path(above, flight, episode)
        axes: Any = above.axes[0]
        axes.set_title(textwrap.fill(name, 26))
        axes.set_aspect("equal", adjustable="box")
        axes.set(**limits)
        if axes.get_legend() and k:
            axes.get_legend().remove()
        timeline = below.subplots()
        panels.timeline(timeline, flight, episode)
        timeline.set(title="", xlim=(0.0, max(flight.times[-1] for _, flight, _ in flights)))
    return figure


def _common_limits(flights: Sequence[tuple[str, Flight, int]]) -> Iterator[tuple[float, float]]:
    """One range per axis of W for all paths, m, equally wide."""
    way = [[x[:, episode] for x in panels.from_goal(flight)] for _, flight, episode in flights]
    low, high = (
        np.array([pick(np.concatenate([[0.0], *x])) for x in zip(*way, strict=True)])
        for pick in (np.min, np.max)
    )
    half = 0.5 * float((high - low).max()) + 0.5
    for centre in 0.5 * (low + high):
        yield centre - half, centre + half
