"""The figure of a benchmark: the engine under its roof, how long an agent takes to answer, and ratios."""

from __future__ import annotations

import math
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from rans.show.figures import styled
from rans.show.panels import BLUE, GREEN, INK, ORANGE, RED, label
from validation.speed.measurement import Measurement
from validation.speed.ratios import Ratio


@styled
def speed_figure(title: str, measured: Sequence[Measurement], ratios: Sequence[Ratio]) -> Figure:
    """Bars with their values; the engine's bound is a red line.

    Args:
        title: hardware and versions.
        measured: of `validation.speed.suite.measurements`.
        ratios: of ours over peers', if there are any.
    """
    engine = [m for m in measured if m.kind == "engine"]
    agents = [m for m in measured if m.kind == "policy" and m.value is not None]
    rows = [len(engine), len(agents), *([len(ratios)] if ratios else [])]
    figure = Figure(figsize=(9.0, 1.0 + 0.28 * sum(rows) + 0.7 * len(rows)), layout="constrained")
    figure.suptitle(title, fontsize=9, color=INK)
    panels = figure.subplots(len(rows), 1, height_ratios=rows, squeeze=False)[:, 0]
    _roofline(panels[0], engine)
    _bars(panels[1], [m.name for m in agents], [m.value or 0.0 for m in agents], 0.0)
    label(panels[1], "an agent on one CPU core", "microseconds to answer one observation", "")
    if ratios:
        _bars(panels[2], [r.name for r in ratios], [r.value for r in ratios], 1.0)
        panels[2].set_xscale("log")
        label(panels[2], "ours over peers on this machine", "ratio; 1: as fast", "")
    for axes in panels:
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


def _bars(axes: Axes, names: Sequence[str], values: Sequence[float], start: float) -> None:
    """One bar a row, from the top, green to the right of the start and orange to the left of it."""
    colours = [ORANGE if value < start else GREEN if start else BLUE for value in values]
    axes.barh(range(len(names)), [value - start for value in values], left=start, color=colours, height=0.7)
    for row, value in enumerate(values):
        axes.annotate(f"{value:,.3g}", (max(value, start), row), (3, 0), textcoords="offset points",
                      va="center", fontsize=8)
    axes.set(yticks=range(len(names)), yticklabels=names, ylim=(len(names) - 0.5, -0.5))
    axes.margins(x=0.12)
    axes.grid(visible=False, axis="y")
