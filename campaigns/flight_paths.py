"""Paths of several flights with the zones, cones and slopes of their task: the picture of a mission."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from rans.drawing import columns, outlines
from rans.flight import Flight
from rans.model.fields import map_leaves
from rans.show.figures.figures import styled
from rans.show.figures.panels import label
from rans.show.figures.plotting import Axes, Figure
from rans.show.palette import BLUE, GREY, INK, RED, SKY
from rans.tasks.shapes import Ball, GlideSlope

_SHOWN = 3
"""Largest number of flights with a panel of their own."""
_MARGIN = 0.08
"""Part of the width of all paths that is left free around them."""
_HIGHEST = 4.2
"""Height of a figure at most, inches."""
_AROUND = 0.8
"""Inches of a figure above and below its panels."""
_LEAST_HEIGHT = 0.45
"""Least height of a panel, as a part of its width: a flat path needs room for its ball."""


class _View(NamedTuple):
    """A projection of points (..., 3) onto the paper."""

    x: str
    y: str
    across: Callable[[np.ndarray], np.ndarray]
    up: Callable[[np.ndarray], np.ndarray]


_PLANE = _View("x, m", "y, m", lambda p: p[..., 0], lambda p: p[..., 1])
_ORBIT = (
    _View("along the track, m", "radially outwards, m", lambda p: p[..., 1], lambda p: p[..., 0]),
    _View("along the track, m", "across the orbit, m", lambda p: p[..., 1], lambda p: p[..., 2]),
)
_DESCENT = _View(
    "distance from the site over ground, m",
    "height, m",
    lambda p: np.hypot(p[..., 0], p[..., 1]),
    lambda p: p[..., 2],
)


@styled
def paths_figure(flight: Flight) -> Figure:
    """Paths of flights relative to the origin of W, and what their task forbids.

    On an orbit they are seen along the orbit's normal and from above, landings as height over distance, others
    along z. Where each episode has zones of its own, a few flights have a panel each. Flights that broke a limit
    are red.
    """
    positions = columns(flight.states.p)  # (T + 1, N, 3)
    views = _views(flight)
    groups = _groups(flight)
    panels = [(view, group) for group in groups for view in views]
    figure = Figure(figsize=(min(4.6 * len(panels), 11.0), _HIGHEST), layout="constrained")
    grid = figure.subplots(1, len(panels), squeeze=False)[0]
    broken = flight.violated() if flight.margins else np.zeros(positions.shape[1], dtype=bool)
    for axes, (view, group) in zip(grid, panels, strict=True):
        drawn = []
        for episode in group:
            path = positions[: _length(flight, episode) + 1, episode]
            drawn.append(np.stack([view.across(path), view.up(path)], axis=1))
            colour = RED if broken[episode] else BLUE
            axes.plot(*drawn[-1].T, color=colour, alpha=0.8, linewidth=1.0)
            axes.plot(*drawn[-1][:1].T, "o", color=INK, markersize=3)
            axes.plot(*drawn[-1][-1:].T, "+", color=GREY, markersize=6)
        drawn += _zones(view, flight, group[0])
        _bounds(axes, np.concatenate(drawn))
        _scenery(axes, view, flight, group[0])
        name = f"episode {group[0]}" if len(groups) > 1 else ""
        label(axes, name, view.x, view.y)
    # No higher than the highest panel needs, with its labels, title and legend.
    room = figure.get_figwidth() / len(panels)
    tallest = max(np.ptp(axes.get_ylim()) / np.ptp(axes.get_xlim()) for axes in grid)
    figure.set_figheight(min(_HIGHEST, tallest * room + _AROUND))
    grid[0].plot([], [], "o", color=INK, markersize=3, label="start")
    grid[0].plot([], [], "+", color=GREY, markersize=6, label="end")
    entries = grid[0].get_legend_handles_labels()
    figure.legend(*entries, loc="outside lower center", ncol=len(entries[0]))
    return figure


def _views(flight: Flight) -> tuple[_View, ...]:
    """Projections that show a flight of this task."""
    if flight.task.optimal_problem == "landing":
        return (_DESCENT,)
    if flight.task.drift.rate() is not None:
        return _ORBIT[: flight.craft.dimension - 1]
    return (_PLANE,)


def _groups(flight: Flight) -> list[list[int]]:
    """Episodes of each panel: all in one if they have the same zones."""
    count = flight.commands.shape[1]
    first = _shapes(flight, 0, 0)
    if all(_shapes(flight, episode, 0) == first for episode in range(count)):
        return [list(range(count))]
    return [[episode] for episode in range(min(count, _SHOWN))]


def _shapes(flight: Flight, episode: int, instant: int) -> tuple[Any, ...]:
    """Shapes of the task with the numbers of an episode at an instant."""

    def now(x: Any) -> float:
        return float(x[instant, episode] if np.ndim(x) == 2 else np.asarray(x)[episode])

    return tuple(flight.task.scenery(map_leaves(now, flight.goals)))


def _zones(view: _View, flight: Flight, episode: int) -> list[np.ndarray]:
    """Outlines (K, 2) of keep-out zones at both ends of an episode, which are always drawn whole."""
    instants = (0, _length(flight, episode))
    balls = (
        shape
        for instant in instants
        for shape in _shapes(flight, episode, instant)
        if isinstance(shape, Ball)
    )
    return [
        np.stack([view.across(outline), view.up(outline)], axis=1)
        for ball in balls
        for outline in outlines(ball, 0.0)
    ]


def _length(flight: Flight, episode: int) -> int:
    """Periods that an episode lasted."""
    return len(flight.commands) if flight.lengths is None else int(flight.lengths[episode])


def _bounds(axes: Axes, points: np.ndarray) -> None:
    """Limits around points (K, 2) m, the same scale along both axes."""
    low = points.min(axis=0)
    high = points.max(axis=0)
    middle = 0.5 * (low + high)
    width = max(high[0] - low[0], 1e-3) * (1.0 + 2.0 * _MARGIN)
    height = max((high[1] - low[1]) * (1.0 + 2.0 * _MARGIN), _LEAST_HEIGHT * width)
    axes.set(
        xlim=(middle[0] - 0.5 * width, middle[0] + 0.5 * width),
        ylim=(middle[1] - 0.5 * height, middle[1] + 0.5 * height),
        aspect="equal",
    )


def _scenery(axes: Axes, view: _View, flight: Flight, episode: int) -> None:
    """Outlines of zones, cones and slopes: dotted as the episode begins where they move, full as it ends."""
    last = _length(flight, episode)
    reach = 2.0 * max(map(abs, (*axes.get_xlim(), *axes.get_ylim())))
    begun = _shapes(flight, episode, 0)
    ended = _shapes(flight, episode, last)
    named = set()
    moments = [
        ([shape for shape in begun if shape not in ended], ":", " at the start"),
        ([shape for shape in ended if shape not in begun], "-", " at the end"),
        ([shape for shape in ended if shape in begun], "-", ""),
    ]
    for shapes, line, when in moments:
        for shape in shapes:
            keep_out = isinstance(shape, Ball)
            name = "keep-out zone" if keep_out else "approach cone"
            if isinstance(shape, GlideSlope):
                name = "glide slope"
            name += when
            for outline in outlines(shape, reach):
                axes.plot(
                    view.across(outline),
                    view.up(outline),
                    line,
                    color=RED if keep_out else SKY,
                    linewidth=0.9,
                    label="" if name in named else name,
                    scalex=False,
                    scaley=False,
                )
                named.add(name)
