"""Figures of missions: margins over time, and what is spent beside its bound."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rans.evaluation.compare.contest import Entry
from rans.evaluation.compare.mission_bounds import MissionBounds
from rans.flight import Flight
from rans.show.figures.figures import styled
from rans.show.figures.panels import label
from rans.show.figures.plotting import Figure
from rans.show.palette import GREY, INK, RED, series_style


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


@styled
def spent_over_time(entries: Sequence[Entry], bounds: MissionBounds) -> Figure:
    """When contestants succeed from the first start and what they spend, and what no craft can do.

    On an orbit a craft may wait after it has succeeded, so that a bound holds for success by its time. That of a
    landing holds for landing at its time; bounds are joined by straight lines.
    """
    figure = Figure(figsize=(7.4, 3.8), layout="constrained")
    axes = figure.subplots()
    possible = np.isfinite(bounds.front)
    axes.plot(bounds.times[possible], bounds.front[possible], color=INK, label="certified least")
    top = [*bounds.front[possible]]
    for k, entry in enumerate(entries):
        flight = entry.flight
        assert flight.done is not None
        if not flight.done[0] or flight.violated()[0]:
            continue
        colour, marker = series_style(k)
        time = length(flight, 0) * flight.timing.control_period
        spent = float(bounds.spent(entry)[0])
        axes.plot([time], [spent], marker, color=colour, markersize=7, label=entry.name)
        top.append(spent)
    # Room above the highest, and the region that the bounds exclude.
    on_orbit = bounds.spending == "impulse"
    high = max(top, default=1.0)
    low = 0.0 if on_orbit else min(top, default=0.0)
    room = 0.15 * (high - low)
    if on_orbit:
        # Success by a time needs at least what success by any later time needs.
        edges = np.array([0.0, *bounds.times, max(bounds.times[-1], axes.get_xlim()[1])])
        least = np.array([*bounds.front, bounds.front[-1], bounds.front[-1]])
    else:
        edges, least = bounds.times, bounds.front
    axes.fill_between(
        edges,
        0.0,
        np.minimum(least, high + room),
        step="post" if on_orbit else None,
        color=GREY,
        alpha=0.2,
        linewidth=0.0,
        label="provably impossible",
    )
    axes.set(xlim=(edges[0], edges[-1]), ylim=(max(0.0, low - 2.0 * room), high + room))
    axes.legend(loc="best")
    label(
        axes,
        f"{bounds.spending} over time, start 0",
        "success after, s",
        f"{bounds.spending}, {bounds.unit}",
    )
    return figure


def length(flight: Flight, start: int) -> int:
    """Control periods of one flight until it succeeded, or all of them."""
    return int(len(flight.commands) if flight.lengths is None else flight.lengths[start])
