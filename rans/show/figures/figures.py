"""Figures of flights and trainings, for reports and papers.

Every function returns a `matplotlib.figure.Figure` that nobody else holds: no window, no global state.
Colours are those of Okabe and Ito ("Color Universal Design", 2008), which everybody can tell apart.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np

from rans.files import write_text
from rans.flight import Flight
from rans.show.figures import panels
from rans.show.figures.axes import settle
from rans.show.figures.panels import MILLIONS, STYLE, label, only
from rans.show.figures.plotting import Axes, Figure, MaxNLocator, rc_context
from rans.show.figures.svg import svg
from rans.show.palette import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY

P = ParamSpec("P")
R = TypeVar("R")


def styled(draw: Callable[P, R]) -> Callable[P, R]:
    """Decorator of a function that draws a figure: it has the project's style, and axes of `settle`."""

    @wraps(draw)
    def drawn(*arguments: P.args, **named: P.kwargs) -> R:
        with rc_context(STYLE):
            result = draw(*arguments, **named)
            if isinstance(result, Figure):
                settle(result)
            return result

    return drawn


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
def episode_figure(flight: Flight, episode: int = 0) -> Figure:
    """One episode of the batch: its path with headings, its errors, and when each thruster fired."""
    figure = Figure(figsize=(9.4, 4.6), layout="constrained")
    cells = figure.add_gridspec(1, 2, width_ratios=(1.0, 1.3))
    left = figure.add_subfigure(cells[0])
    right = figure.add_subfigure(cells[1])
    panels.path(left, flight, episode)
    stack = right.subplots(2, 1, sharex=True)
    panels.episode_errors(stack[0], flight, episode)
    panels.timeline(stack[1], flight, episode)
    return figure


@styled
def learning_curve(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Curves of ``success`` (0 to 1) and ``return/<term>`` over ``steps``, from lines of ``metrics.jsonl``."""
    figure = Figure(figsize=(9.4, 3.4), layout="constrained")
    success, returns = figure.subplots(1, 2)
    _series(success, rows, "success", 100.0, BLUE, "")
    success.set_ylim(-2.0, 102.0)
    seconds = [float(row["seconds"]) for row in rows if "seconds" in row]
    took = f" ({seconds[-1]:.3g} s in all)" if seconds else ""
    label(success, f"solved while training{took}", "environment steps", "episodes, %")
    terms = sorted({key for row in rows for key in row if key.startswith("return/")})
    for term, colour in zip(terms, (GREEN, ORANGE, PURPLE, RED, SKY, GREY, BLUE), strict=False):
        _series(returns, rows, term, 1.0, colour, term.removeprefix("return/"))
    label(returns, "return by term", "environment steps", "mean return of an episode")
    if terms:
        returns.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))  # beside the curves
    for axes in (success, returns):
        axes.xaxis.set_major_locator(MaxNLocator(4))  # whose labels have room on a telephone
        axes.xaxis.set_major_formatter(MILLIONS)
    return figure


def save_flight_figures(flight: Flight, folder: Path, suffix: str = "") -> None:
    """Write ``evaluation.svg`` and, of the first episode, ``episode.svg``, the suffix before the dot."""
    for name, draw in (("evaluation", evaluation_figure), ("episode", episode_figure)):
        write_text(folder / f"{name}{suffix}.svg", svg(draw(flight)))


def _series(
    axes: Axes, rows: Sequence[Mapping[str, Any]], key: str, factor: float, colour: str, name: str
) -> None:
    points = [(row["steps"], factor * row[key]) for row in rows if key in row and "steps" in row]
    if points:
        axes.plot(*zip(*points, strict=True), color=colour, label=name, marker=only(points))
