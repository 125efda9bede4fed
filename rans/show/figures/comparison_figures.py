"""Figures of a comparison; see `rans.show.figures.figures` for what they share with all others."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from rans.evaluation.compare.contest import Entry
from rans.evaluation.measure.statistics import Estimate
from rans.flight import Flight
from rans.show.figures import panels
from rans.show.figures.figures import styled
from rans.show.figures.panels import PLAIN, label
from rans.show.figures.plotting import Axes, Axis, Figure, LogLocator, NullLocator
from rans.show.palette import FOUND, GREY, INK, series_style
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


def _bars(estimate: Estimate) -> np.ndarray:
    """Distances to the interval's ends; an end at infinity is not drawn."""
    with np.errstate(invalid="ignore"):
        ends = np.array([[estimate.value - estimate.low], [estimate.high - estimate.value]])
    return np.where(np.isfinite(ends), ends, 0.0)


@styled
def gap_histograms(gaps: dict[str, dict[str, np.ndarray]], questions: Sequence[str]) -> Figure:
    """Histograms of gaps (N,) to certified bounds by question and contestant: a panel for each question."""
    names = list(dict.fromkeys(name for question in questions for name in gaps[question]))
    figure = Figure(figsize=(4.6 * len(questions), 1.3 + 0.5 * len(names)), layout="constrained")
    grid = figure.subplots(1, len(questions), squeeze=False)[0]
    for axes, question in zip(grid, questions, strict=True):
        _histograms(axes, gaps[question], names)
        label(axes, question, "times the certified bound", "")
    return figure


def _histograms(axes: Axes, ratios: dict[str, np.ndarray], names: Sequence[str]) -> None:
    """Histograms of all contestants, each at its own values; the highest bar of a panel fills its row."""
    # Equal bins up to the largest ratio, and one beyond for starts that never arrive.
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
    # A row of bars a contestant, from the top to the bottom.
    highest = max(1, *(count.max() for count in counts.values()))
    for k, name in enumerate(names):
        if name in counts:
            colour = FOUND if name == "best found" else series_style(k)[0]
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
        # Below the axes: inside it would lie on the curves or on the tolerance.
        axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.18), ncols=2)
    return figure


@styled
def shares_and_computing_time(board: dict[str, Scores]) -> Figure:
    """Share of the possible return, where it is known, and time an action takes."""
    keys = [
        key for key in (RETURN, "computing time, ms") if all(key in row for row in board.values())
    ]
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
def side_by_side(flights: Sequence[tuple[str, Flight, int]], contestants: int) -> Figure:
    """Paths and open thrusters of everybody from one start: name, flight and the episode in it.

    Contestants are first, in the order of their colours; controls that were found follow them.
    """
    figure = Figure(figsize=(max(7.0, 3.0 * len(flights)), 5.4), layout="constrained")
    columns = figure.add_gridspec(1, len(flights))
    limits = dict(zip(("xlim", "ylim", "zlim"), _common_limits(flights), strict=False))
    for k, (name, flight, episode) in enumerate(flights):
        column = figure.add_subfigure(columns[0, k])
        cells = column.add_gridspec(2, 1, height_ratios=(1.5, 1.0))
        above, below = (column.add_subfigure(cells[row]) for row in (0, 1))
        colour = series_style(k)[0] if k < contestants else FOUND
        panels.path(above, flight, episode, colour)
        axes: Any = above.axes[0]
        axes.set_title(textwrap.fill(name, 26))
        axes.set_aspect("equal", adjustable="box")
        axes.set(**limits)
        if axes.get_legend() and k:
            axes.get_legend().remove()
        timeline = below.subplots()
        panels.timeline(timeline, flight, episode, colour)
        timeline.set(title="", xlim=(0.0, max(flight.times[-1] for _, flight, _ in flights)))
    return figure


def _common_limits(flights: Sequence[tuple[str, Flight, int]]) -> Iterator[tuple[float, float]]:
    """One range per axis of W around the goal for all paths, m, equally wide."""
    paths = [[x[:, episode] for x in panels.from_goal(flight)] for _, flight, episode in flights]
    low, high = (
        np.array([pick(np.concatenate([[0.0], *x])) for x in zip(*paths, strict=True)])
        for pick in (np.min, np.max)
    )
    half = 0.5 * float((high - low).max()) + 0.5
    for centre in 0.5 * (low + high):
        yield centre - half, centre + half
