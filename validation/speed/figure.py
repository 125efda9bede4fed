"""The figure of a benchmark: the engine under its roof, ratios, and how long an agent takes to answer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rans.evaluation.figures import styled
from rans.evaluation.panels import BLUE, GREEN, INK, RED, label
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
    agents = [m for m in measured if m.kind == "policy" and m.name.endswith("median") and m.value]
    rows = [len(engine), len(agents), *([len(ratios)] if ratios else [])]
    figure = Figure(figsize=(9.0, 1.6 + 0.34 * sum(rows) + 0.5 * len(rows)), layout="constrained")
    figure.suptitle(title, fontsize=9, color=INK)
    panels = figure.subplots(len(rows), 1, height_ratios=rows, squeeze=False)[:, 0]
    _bars(panels[0], [(m.name, m.value or 0.0, f"{m.value:,.3g}") for m in engine], BLUE)
    for row, m in enumerate(engine):
        panels[0].plot([m.bound or 0.0] * 2, [row - 0.4, row + 0.4], color=RED)
    label(panels[0], "engine; red: what copying its bytes would allow", "M environment steps/s", "")
    _bars(panels[1], [(m.name.removesuffix(", median"), m.value or 0.0, f"{m.value:,.3g}") for m in agents], GREEN)
    label(panels[1], "agent on one CPU core", "microseconds to answer one observation, median", "")
    if ratios:
        _bars(panels[2], [(r.name, r.value, f"{r.value:,.3g}") for r in ratios], BLUE)
        panels[2].axvline(1.0, color=RED)
        label(panels[2], "ours over peers on this machine; red: equal", "ratio", "")
    return figure


def _bars(axes: Axes, rows: Sequence[tuple[str, float, str]], colour: str) -> None:
    """One bar a row, from the top, on a logarithmic axis: figures differ by orders of magnitude."""
    values: Any = [value for _, value, _ in rows]
    bars = axes.barh(range(len(rows)), values, color=colour, height=0.7)
    axes.bar_label(bars, [text for _, _, text in rows], padding=3, fontsize=8)
    axes.set(yticks=range(len(rows)), yticklabels=[name for name, _, _ in rows], xscale="log",
             ylim=(len(rows) - 0.5, -0.5))
    axes.margins(x=0.12)
    axes.grid(visible=False, axis="y")
