"""The panels that figures of flights are made of: each draws one quantity into given axes.

Panels get flights as `rans.episode.flight.Flight` has them: (T + 1, N) states in SI units, shown in display units.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np

from rans.episode.drawing import columns, outlines, rotations
from rans.episode.flight import Flight
from rans.model.fields import map_leaves
from rans.show.figures.plotting import (
    Axes,
    Figure,
    FuncFormatter,
    LinearSegmentedColormap,
    MaxNLocator,
    SubFigure,
    rc_context,
)
from rans.show.palette import (
    BLUE,
    GREEN,
    GREY,
    INK,
    LINES,
    ORANGE,
    PURPLE,
    RED,
    SKY,
)
from rans.tasks.quantities import QUANTITIES
from rans.tasks.shapes import Ball

STYLE: dict[Any, Any] = {
    "axes.axisbelow": True,
    "axes.edgecolor": GREY,
    "axes.formatter.useoffset": False,
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.titlecolor": INK,
    "font.size": 9,
    "text.color": INK,
    "text.parse_math": False,  # names with a $ are no mathematics
    **{f"axes3d.{axis}axis.panecolor": (0.5, 0.5, 0.5, 0.07) for axis in "xyz"},
    "grid.color": LINES,
    "grid.linewidth": 0.7,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "lines.linewidth": 1.4,
    "xtick.color": INK,
    "ytick.color": INK,
    # Reproducible files: ids from this text and no date, so that equal figures give equal bytes.
    "svg.hashsalt": "rans",
    "savefig.dpi": 160,
}

PLAIN = FuncFormatter(lambda x, _: f"{x:g}")
"""Numbers along an axis: as they are."""


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


def label(axes: Axes, title: str, x: str, y: str) -> None:
    """Title and axes, units included."""
    axes.set(title=title, xlabel=x, ylabel=y)


def _places(flight: Flight) -> tuple[str, str]:
    """Labels of the axes of a path, relative to the goal if the task has a goal position."""
    origin = " from the goal" if "position" in flight.errors() else ""
    return f"x{origin}, m", f"y{origin}, m"


def from_goal(flight: Flight) -> list[np.ndarray]:
    """Position less the goal's, one (T + 1, N) array per axis of W, m."""
    return [np.asarray(x) for x in (flight.states.p - flight.goals.p).columns()]


def path(figure: SubFigure, flight: Flight, episode: int) -> None:
    """The way of one episode with the direction of the body's x axis once a second, and zones to keep out of."""
    path = [x[:, episode] for x in from_goal(flight)]
    every = max(1, round(1.0 / flight.timing.control_period))
    nose = rotations(map_leaves(lambda x: x[:, episode], flight.states))[:, : len(path), 0].T
    arrows = [x[::every] for x in (*path, *nose)]
    axes: Any = figure.add_subplot(projection="3d" if len(path) == 3 else None)
    if len(path) == 3:
        axes.quiver(*arrows, length=0.3, color=GREY, linewidth=1.0)
        # Aside of the way from the start, which is a point to who looks along it.
        axes.view_init(25.0, math.degrees(math.atan2(path[1][0], path[0][0])) + 60.0)
        axes.set_zlabel("z, m")
    else:
        axes.quiver(*arrows, color=GREY, angles="xy", scale=14.0, width=0.005, zorder=3)
    axes.plot([], [], color=GREY, label="body's x axis, once a second")
    _scenery(axes, flight, episode)
    axes.plot(*path, color=BLUE, zorder=2)
    axes.plot(*([x[0]] for x in path), "o", color=INK, label="start")
    if "position" in flight.errors():
        axes.plot(*([0.0] for _ in path), "+", color=RED, markersize=10, label="goal")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(loc="best")
    label(axes, f"(a) path of episode {flight.first + episode}", *_places(flight))


def _scenery(axes: Any, flight: Flight, episode: int) -> None:
    """Zones and cones as seen from the goal: dotted as it begins, full as it ends."""
    last = len(flight.times) - 1
    if flight.lengths is not None:
        last = int(flight.lengths[episode])
    dimension = len(flight.states.p.columns())
    reach = max(float(np.abs(x[:, episode]).max()) for x in from_goal(flight))
    labelled = set()
    for instant, line in ((0, ":"), (last, "-")):

        def now(x: Any, instant: int = instant) -> float:
            return float(x[instant, episode] if np.ndim(x) == 2 else x[episode])

        goal = map_leaves(now, flight.goals)
        origin = columns(goal.p)
        for shape in flight.task.scenery(goal):
            keep_out = isinstance(shape, Ball)
            name = f"{'keep-out zone' if keep_out else 'approach cone'}, dotted at first"
            for outline in outlines(shape, reach):
                axes.plot(
                    *(outline - origin).T[:dimension],
                    line,
                    color=RED if keep_out else SKY,
                    linewidth=0.9,
                    label="" if name in labelled else name,
                )
                labelled.add(name)


def episode_errors(axes: Axes, flight: Flight, episode: int) -> None:
    """The errors of one episode over time (s), as multiples of their tolerances."""
    errors = flight.errors()
    bounds = flight.task.tolerances().items()
    for (quantity, bound), colour in zip(bounds, (BLUE, ORANGE, GREEN, PURPLE), strict=False):
        factor, unit = QUANTITIES[quantity].display
        axes.semilogy(
            flight.times,
            errors[quantity][:, episode] / bound,
            color=colour,
            label=f"{quantity} (tolerance {factor * bound:g} {unit})",
        )
    axes.axhline(1.0, color=RED, linestyle="--", linewidth=1.0)
    # An optimum ends at its goal to the last digit.
    axes.set_ylim(bottom=max(axes.get_ylim()[0], 1e-4))
    axes.yaxis.set_major_formatter(PLAIN)
    axes.legend(loc="best")
    label(axes, "(b) errors", "", "error / tolerance")


def timeline(axes: Axes, flight: Flight, episode: int) -> None:
    """When each thruster of one episode was open; without thrusters, how much of its torque each wheel gave."""
    command = flight.openings[:, episode].T
    what = ("open thrusters", "thruster")
    if not flight.craft.thrusters:
        command = np.abs(flight.commands[:, episode].T)
        what = ("torques of wheels, of the largest", "wheel")
    shades = LinearSegmentedColormap.from_list("open", [f"{BLUE}00", BLUE])
    axes.imshow(
        command,
        aspect="auto",
        interpolation="nearest",
        cmap=shades,
        vmin=0.0,
        vmax=1.0,
        extent=(0.0, flight.times[-1], len(command) - 0.5, -0.5),
    )
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(visible=False)
    label(axes, f"(c) {what[0]}", "time, s", what[1])
