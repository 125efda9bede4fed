"""Figures of a stress report; see `rans.show.figures.figures` for what they share with all others."""

from __future__ import annotations

import numpy as np

from rans.evaluation.measure.statistics import Estimate
from rans.evaluation.stress.effects import Effect
from rans.evaluation.stress.outcome import WANTED
from rans.extend import Figure, label, styled
from rans.show.figures.panels import legend_beside
from rans.show.figures.plotting import Axes
from rans.show.palette import INK, series_style
from rans_assurance.stress.run import Stress


@styled
def effect_figure(stress: Stress, effect: Effect) -> Figure:
    """Solved episodes over the size of one trouble, with their intervals: small enough for a telephone."""
    figure = Figure(figsize=(3.9, 2.9), layout="constrained")
    axes = figure.subplots()
    for k, name in enumerate(stress.names):
        sizes, rates = stress.curve(effect, name)
        colour, marker = series_style(k)
        low, value, high = (
            100.0 * np.array([getattr(rate, end) for rate in rates])
            for end in ("low", "value", "high")
        )
        axes.fill_between(sizes, low, high, color=colour, alpha=0.18, linewidth=0)
        axes.plot(sizes, value, color=colour, marker=marker, markersize=4, label=name)
    axes.axhline(100.0 * WANTED, color=INK, linestyle=":", linewidth=0.8)
    axes.set_ylim(-3.0, 103.0)
    if effect.sizes[-1] < effect.nominal:
        axes.invert_xaxis()
    axes.legend(loc="best")
    label(axes, effect.name, f"{effect.name}, {effect.unit}", "solved, %")
    return figure


@styled
def named_figure(stress: Stress) -> Figure:
    """Solved episodes (%) with intervals in each world without a size: a row a world, a mark a contestant."""
    levels = stress.named
    names = stress.names
    figure = Figure(figsize=(6.6, 1.1 + 0.2 * len(levels) * (1 + len(names))), layout="constrained")
    cells = figure.add_gridspec(1, 2, width_ratios=(2.2, 1.0))
    left = figure.add_subfigure(cells[0])
    right = figure.add_subfigure(cells[1])
    axes = left.subplots()
    for k, name in enumerate(names):
        for row, level in enumerate(levels):
            if (level.name, name) in stress.outcomes:
                percentage = stress.outcomes[level.name, name].share.scaled(100.0)
                _draw(
                    axes,
                    percentage,
                    row + (k + 0.5) / len(names) * 0.8 - 0.4,
                    k,
                    name if row == 0 else "",
                )
    axes.axvline(100.0 * WANTED, color=INK, linestyle=":", linewidth=0.8)
    axes.set_yticks(range(len(levels)), [level.effect for level in levels])
    axes.set(ylim=(len(levels) - 0.4, -0.6), xlim=(-3.0, 103.0))
    legend_beside(right, axes)
    label(axes, "conditions and failed thrusters", "solved, %", "")
    return figure


def _draw(axes: Axes, result: Estimate, height: float, k: int, name: str) -> None:
    """Draw an estimate and its interval at a height, in colour and marker number k.

    A name puts it into the legend.
    """
    colour, marker = series_style(k)
    bars = [[result.value - result.low], [result.high - result.value]]
    axes.errorbar(
        [result.value],
        [height],
        xerr=np.maximum(bars, 0.0),
        color=colour,
        marker=marker,
        linestyle="",
        elinewidth=1.4,
        capsize=2.5,
        markersize=5,
        label=name or None,
    )
