"""Figure of missions: margins over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rans.evaluation.compare.contest import Entry
from rans.show.figures.figures import styled
from rans.show.figures.panels import label
from rans.show.figures.plotting import Figure
from rans.show.palette import RED, series_style


@styled
def margins_over_time(entries: Sequence[Entry]) -> Figure:
    """Least margin of every constraint over all starts, in each control period: below zero it is violated."""
    names = list(entries[0].flight.margins)
    figure = Figure(figsize=(4.6 * len(names), 3.4), layout="constrained")
    grid = figure.subplots(1, len(names), squeeze=False)[0]
    for axes, name in zip(grid, names, strict=True):
        for k, entry in enumerate(entries):
            flight = entry.flight
            least = flight.margins[name].min(axis=1)
            least = np.where(np.isfinite(least), least, np.nan)  # after all have succeeded
            axes.plot(flight.times[1:], least, color=series_style(k)[0], label=entry.name)
        axes.axhline(0.0, color=RED, linestyle="--", linewidth=1.0, label="violated below")
        axes.legend(loc="best")
        label(axes, f"margin of {name}", "time, s", "least margin of all starts, SI units")
    return figure
