"""The figure of a benchmark: the engine under its roof and how long an agent takes to answer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

from rans.show.figures.figures import styled
from rans.show.figures.panels import label
from rans.show.figures.plotting import Axes, Figure, FuncFormatter
from rans.show.palette import BLUE, INK, RED
from validation.speed.measurement import Measurement


@styled
def speed_figure(title: str, measured: Sequence[Measurement]) -> Figure:
    """Bars with their values; the engine's bound is a red line. What was not measured has no panel.

    Args:
        title: hardware and versions.
        measured: of `validation.speed.suite.measurements`, all or some.
    """
    engine = [m for m in measured if m.kind == "engine"]
    agents = [m for m in measured if m.kind == "policy" and m.value is not None]
    panels = [
        (len(rows), draw)
        for rows, draw in (
            (engine, partial(_roofline, engine=engine)),
            (agents, partial(_answers, agents=agents)),
        )
        if rows
    ]
    sizes = [size for size, _ in panels]
    figure = Figure(figsize=(9.0, 1.0 + 0.28 * sum(sizes) + 0.7 * len(sizes)), layout="constrained")
    figure.suptitle(title, fontsize=9, color=INK)
    grid = figure.add_gridspec(len(sizes) or 1, 1, height_ratios=sizes or None)
    for row, (_, draw) in enumerate(panels):
        axes = figure.add_subplot(grid[row])
        draw(axes)
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:,g}"))
    return figure


def _roofline(axes: Axes, engine: Sequence[Measurement]) -> None:
    """Steps/s and, as a red line, how many the copy bandwidth allows; both over orders of magnitude."""
    values = [m.value or 0.0 for m in engine]
    start = 10.0 ** math.floor(math.log10(min(values)))
    _bars(axes, [m.name for m in engine], values, start)
    for row, m in enumerate(engine):
        axes.plot([m.bound or start] * 2, [row - 0.4, row + 0.4], color=RED)
    axes.set_xscale("log")
    axes.set_xlim(left=start)
    label(axes, "the engine; red: what the copy bandwidth allows", "M environment steps/s", "")


def _answers(axes: Axes, agents: Sequence[Measurement]) -> None:
    _bars(axes, [m.name for m in agents], [m.value or 0.0 for m in agents], 0.0)
    label(axes, "an agent on one CPU core", "microseconds to answer one observation", "")


def _bars(axes: Axes, names: Sequence[str], values: Sequence[float], start: float) -> None:
    """One bar a row, from the top, which begins at the start."""
    axes.barh(
        range(len(names)),
        [value - start for value in values],
        left=start,
        color=BLUE,
        height=0.7,
    )
    for row, value in enumerate(values):
        axes.annotate(
            f"{value:,.3g}",
            (max(value, start), row),
            (3, 0),
            textcoords="offset points",
            va="center",
            fontsize=8,
        )
    axes.set(yticks=range(len(names)), yticklabels=names, ylim=(len(names) - 0.5, -0.5))
    axes.margins(x=0.12)
    axes.grid(visible=False, axis="y")
