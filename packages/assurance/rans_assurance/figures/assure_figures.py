"""Figures of an assurance, each small enough for a telephone; see `rans.show.figures.figures`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rans.extend import Figure, Flight, label, last_fifth, styled
from rans.show.figures import panels
from rans.show.figures.panels import PLAIN
from rans.show.palette import BLUE, GREY, ORANGE, RED

_SIZE = (3.9, 2.9)


@styled
def errors_figure(flight: Flight, episodes: Sequence[int]) -> Figure:
    """The largest error of some episodes in tolerances over time, the first of them on top."""
    figure = Figure(figsize=_SIZE, layout="constrained")
    axes = figure.subplots()
    bounds = flight.task.tolerances()
    errors = flight.errors()
    worst = np.max([errors[name] / bounds[name] for name in bounds], axis=0)
    _each(axes.semilogy, episodes, lambda k: (flight.times, np.maximum(worst[:, k], 1e-2)))
    begins = flight.times[-1 - last_fifth(len(flight.commands))]
    axes.axvspan(begins, flight.times[-1], color=GREY, alpha=0.15, linewidth=0)
    axes.axhline(1.0, color=RED, linestyle="--", linewidth=1.0)
    axes.yaxis.set_major_formatter(PLAIN)
    label(axes, "largest error", "time, s", "error / tolerance")
    return figure


@styled
def paths_figure(flight: Flight, episodes: Sequence[int]) -> Figure:
    """Ways of these episodes from above (x, y in m), the goal in the middle."""
    figure = Figure(figsize=_SIZE, layout="constrained")
    axes = figure.subplots()
    (x, y, *_) = panels.from_goal(flight)
    _each(axes.plot, episodes, lambda k: (x[:, k], y[:, k]))
    axes.plot([0.0], [0.0], "+", color=RED, markersize=10)
    axes.set_aspect("equal", adjustable="datalim")
    label(axes, "ways to the goal", "x, m", "y, m")
    return figure


@styled
def commands_figure(flight: Flight, episode: int, title: str) -> Figure:
    """When each thruster of one episode was open."""
    figure = Figure(figsize=_SIZE, layout="constrained")
    axes = figure.subplots()
    panels.timeline(axes, flight, episode)
    label(axes, f"open thrusters, {title}", "time, s", "thruster")
    return figure


def _each(
    plot: Callable[..., object],
    episodes: Sequence[int],
    points: Callable[[int], tuple[np.ndarray, np.ndarray]],
) -> None:
    """Draw the curve of every episode k, (x, y) arrays of `points(k)`, and the first strongly above them."""
    for k in reversed(episodes):
        first = k == episodes[0]
        plot(
            *points(k),
            color=ORANGE if first else BLUE,
            linewidth=1.6 if first else 1.0,
            alpha=1.0 if first else 0.9,
        )
