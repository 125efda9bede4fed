"""Figures of flights and trainings, for reports and papers.

Every function returns a `matplotlib.figure.Figure` that nobody else holds: no window, no global state.
Colours are those of Okabe and Ito ("Color Universal Design", 2008), which everybody can tell apart.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import ParamSpec, TypeVar

import numpy as np

from rans.files import write_text
from rans.flight import Flight
from rans.show.figures import panels
from rans.show.figures.panels import STYLE, label
from rans.show.figures.plotting import Figure, rc_context
from rans.show.figures.svg import svg

P = ParamSpec("P")
R = TypeVar("R")


def styled(draw: Callable[P, R]) -> Callable[P, R]:
    """Decorator of a function that draws a figure: it has the project's style, and no axis of rounding errors."""

    @wraps(draw)
    def drawn(*arguments: P.args, **named: P.kwargs) -> R:
        with rc_context(STYLE):
            result = draw(*arguments, **named)
            if isinstance(result, Figure):
                _widen(result)
            return result

    return drawn


_LEAST = 1e-3
"""Least span of a linear axis, in its unit, and as a part of its largest number: below it are solvers' remains."""


def _widen(figure: Figure) -> None:
    """Widen linear axes that show less than `_LEAST`, so that nobody reads rounding errors."""
    for axes in figure.axes:
        for axis in axes._axis_map.values() if axes.axison else ():
            low, high = axis.get_view_interval()
            more = 0.5 * (_LEAST * max(1.0, abs(low), abs(high)) - abs(high - low))
            if axis.get_scale() == "linear" and more > 0.0:
                axis.set_view_interval(min(low, high) - more, max(low, high) + more, ignore=True)


@styled
def evaluation_figure(flight: Flight) -> Figure:
    """All episodes in eight panels, after figure "gotopose_eval" of the paper.

    (a) thruster activations, (b) and (f) every episode's errors, (c) and (g) their summaries,
    (d) angular speed, (e) trajectories, (h) reward. A task with one error leaves (f) and (g) empty.
    Best and worst are the episodes whose mean over time is.
    """
    figure = Figure(figsize=(14.0, 6.6), layout="constrained")
    grid = figure.subplots(2, 4)
    panels.activation_spread(grid[0, 0], flight)
    panels.trajectories(grid[1, 0], flight)
    for row, letters in enumerate(("bc", "fg")):
        panels.errors(grid[row, 1], grid[row, 2], flight, row, letters)
    spin = np.linalg.norm(np.asarray(flight.states.spin()), axis=0)
    panels.summary(grid[0, 3], flight.times, spin, best=np.argmin, worst=np.argmax)
    label(grid[0, 3], "(d) angular speed", "time, s", "angular speed, rad/s")
    rewards = np.sum(list(flight.rewards().values()), axis=0)
    panels.summary(grid[1, 3], flight.times[1:], rewards, best=np.argmax, worst=np.argmin)
    label(grid[1, 3], "(h) reward", "time, s", "reward per step")
    return figure


@styled
def episode_figure(flight: Flight, episode: int = 0, zones: panels.Zones = ()) -> Figure:
    """One episode of the batch: its path with headings and zones, its errors, and when each thruster fired."""
    figure = Figure(figsize=(9.4, 4.6), layout="constrained")
    cells = figure.add_gridspec(1, 2, width_ratios=(1.0, 1.3))
    left = figure.add_subfigure(cells[0])
    right = figure.add_subfigure(cells[1])
    panels.path(left, flight, episode, zones)
    stack = right.subplots(2, 1, sharex=True)
    panels.episode_errors(stack[0], flight, episode)
    panels.timeline(stack[1], flight, episode)
    return figure


def save_flight_figures(flight: Flight, folder: Path, suffix: str = "") -> None:
    """Write ``evaluation.svg`` and, of the first episode, ``episode.svg``, the suffix before the dot."""
    for name, draw in (("evaluation", evaluation_figure), ("episode", episode_figure)):
        write_text(folder / f"{name}{suffix}.svg", svg(draw(flight)))
