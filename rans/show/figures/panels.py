"""The panels that figures of flights are made of: each draws one quantity into given axes.

Panels get flights as `rans.flight.Flight` has them: (T + 1, N) states in SI units, shown in display units.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from rans.drawing import columns, outlines, rotations
from rans.flight import Flight
from rans.model.fields import Vec2, Vec3, map_leaves
from rans.show.figures.plotting import (
    Axes,
    FuncFormatter,
    LinearSegmentedColormap,
    LineCollection,
    LogLocator,
    MaxNLocator,
    NullLocator,
    SubFigure,
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

Zones = Sequence[Sequence[float]]
"""Balls that stand still: coordinates of the centre in W, then the radius, of each, m."""
Pick = Callable[[np.ndarray], np.intp]
"""Chooses an episode by its mean over time: ``np.argmin`` or ``np.argmax``."""


def label(axes: Axes, title: str, x: str, y: str) -> None:
    """Title and axes, units included."""
    axes.set(title=title, xlabel=x, ylabel=y)


def activation_spread(axes: Axes, flight: Flight) -> None:
    """Per thruster, the spread over episodes of how long it was open; without thrusters the use of each wheel."""
    what = ("thruster activations", "thruster", "open time an episode, s")
    used = flight.openings
    if not flight.craft.thrusters:
        what = ("wheel use", "wheel", "share of the largest torque times time, s")
        used = np.abs(flight.commands)
    seconds = used.sum(axis=0) * flight.timing.control_period
    parts = axes.boxplot(
        seconds,
        positions=range(seconds.shape[1]),
        widths=0.6,
        whis=(5, 95),
        showfliers=False,
        showmeans=True,
        patch_artist=True,
        medianprops={"color": INK},
        whiskerprops={"color": BLUE},
        capprops={"color": BLUE},
        boxprops={"facecolor": SKY, "edgecolor": BLUE},
        meanprops={
            "marker": "o",
            "markersize": 3.5,
            "markerfacecolor": RED,
            "markeredgecolor": RED,
        },
    )
    axes.legend(
        [parts["boxes"][0], parts["medians"][0], parts["means"][0]],
        ["middle half (whiskers 5 to 95 %)", "median", "mean"],
    )
    axes.set_ylim(0.0, 1.35 * max(0.1, axes.get_ylim()[1]))
    label(axes, f"(a) {what[0]}", *what[1:])


def _lines(axes: Axes, x: np.ndarray, y: np.ndarray) -> None:
    """Every column of x and y, both (T, N), as a thin line; a bitmap, or files would be huge."""
    opacity = min(0.6, 2.0 / np.sqrt(x.shape[1]))
    axes.add_collection(
        LineCollection(
            list(np.stack((x, y), axis=-1).transpose(1, 0, 2)),
            colors=BLUE,
            linewidths=0.5,
            alpha=opacity,
            rasterized=True,
        )
    )


def errors(every: Axes, summarised: Axes, flight: Flight, rank: int, letters: str) -> None:
    """The task's error number ``rank``: of every episode, and its summary; blank if there is none."""
    if rank >= len(flight.errors()):
        every.set_axis_off()
        summarised.set_axis_off()
        return
    quantity, error = list(flight.errors().items())[rank]
    factor, unit = QUANTITIES[quantity].display
    error = factor * error
    bound = flight.task.tolerances().get(quantity)
    # A logarithmic axis has no place for 0; the tolerance is always within it.
    floor = max(0.01, 0.5 * min(error.min(), math.inf if bound is None else factor * bound))
    top = 1.6 * max(0.1, error.max(), 0.0 if bound is None else factor * bound)
    _lines(every, np.broadcast_to(flight.times[:, None], error.shape), np.maximum(error, floor))
    every.set(xlim=(0.0, flight.times[-1]), ylim=(floor, top), yscale="log")
    numbers = (1.0,) if top > 200.0 * floor else (1.0, 2.0, 5.0)
    every.yaxis.set_major_locator(LogLocator(subs=numbers, numticks=20))
    every.yaxis.set_minor_locator(NullLocator())
    every.yaxis.set_major_formatter(PLAIN)
    summary(summarised, flight.times, error, best=np.argmin, worst=np.argmax)
    for axes, letter, what in zip(
        (every, summarised), letters, ("every episode", "summary"), strict=True
    ):
        if bound is not None:
            axes.axhline(
                factor * bound, color=RED, linestyle="--", linewidth=1.0, label="tolerance"
            )
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc="upper right")
        label(axes, f"({letter}) {quantity} error, {what}", "time, s", f"{quantity} error, {unit}")


def summary(axes: Axes, times: np.ndarray, values: np.ndarray, best: Pick, worst: Pick) -> None:
    """Mean and spread of values (T, N), with the episodes whose means over time are best and worst."""
    mean = values.mean(axis=1)
    spread = values.std(axis=1)
    ranking = values.mean(axis=0)
    low = np.maximum(mean - spread, min(0.0, values.min()))
    axes.fill_between(
        times,
        low,
        mean + spread,
        color=SKY,
        alpha=0.35,
        linewidth=0,
        label="mean ± standard deviation",
    )
    axes.plot(times, values[:, worst(ranking)], color=ORANGE, linewidth=1.0, label="worst episode")
    axes.plot(times, values[:, best(ranking)], color=GREEN, linewidth=1.0, label="best episode")
    axes.plot(times, mean, color=BLUE, linewidth=1.8, label="mean")
    axes.set_xlim(0.0, times[-1])
    axes.legend(loc="best")


def trajectories(axes: Axes, flight: Flight) -> None:
    """Every path around its goal (m), seen along z, with starts and goal."""
    x, y = from_goal(flight)[:2]
    _lines(axes, x, y)
    axes.scatter(x[0], y[0], s=2, linewidths=0, color=GREY, rasterized=True, label="starts")
    if "position" in flight.errors():
        axes.scatter([0.0], [0.0], s=60, marker="+", color=RED, zorder=5, label="goal")
    reach = 1.08 * max(0.1, np.abs([x, y]).max())
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    axes.legend(loc="upper right")
    label(axes, "(e) trajectories, seen along z", *_places(flight))


def _places(flight: Flight) -> tuple[str, str]:
    """Labels of the axes of a path, relative to the goal if the task has a goal position."""
    origin = " from the goal" if "position" in flight.errors() else ""
    return f"x{origin}, m", f"y{origin}, m"


def from_goal(flight: Flight) -> list[np.ndarray]:
    """Position less the goal's, one (T + 1, N) array per axis of W, m."""
    return [np.asarray(x) for x in (flight.states.p - flight.goals.p).columns()]


def path(figure: SubFigure, flight: Flight, episode: int, zones: Zones) -> None:
    """The way of one episode with the direction of the body's x axis once a second, and zones to keep out of."""
    path = [x[:, episode] for x in from_goal(flight)]
    every = max(1, round(1.0 / flight.timing.control_period))
    nose = rotations(map_leaves(lambda x: x[:, episode], flight.states))[:, : len(path), 0].T
    arrows = [x[::every] for x in (*path, *nose)]
    axes: Any = figure.add_subplot(projection="3d" if len(path) == 3 else None)
    if len(path) == 3:
        axes.quiver(*arrows, length=0.3, color=GREY, linewidth=1.0)
        axes.set_zlabel("z, m")
    else:
        axes.quiver(*arrows, color=GREY, angles="xy", scale=14.0, width=0.005, zorder=3)
    axes.plot([], [], color=GREY, label="body's x axis, once a second")
    _scenery(axes, flight, episode, zones)
    axes.plot(*path, color=BLUE, zorder=2)
    axes.plot(*([x[0]] for x in path), "o", color=INK, label="start")
    if "position" in flight.errors():
        axes.plot(*([0.0] for _ in path), "+", color=RED, markersize=10, label="goal")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(loc="best")
    label(axes, f"(a) path of episode {episode}", *_places(flight))


def _scenery(axes: Any, flight: Flight, episode: int, zones: Zones) -> None:
    """Zones and cones, also such that stand still, as seen from the goal: dotted as it begins, full as it ends."""
    last = len(flight.times) - 1
    if flight.lengths is not None:
        last = int(flight.lengths[episode])
    dimension = len(flight.states.p.columns())
    reach = max(float(np.abs(x[:, episode]).max()) for x in from_goal(flight))
    labelled = set()
    vector = Vec2 if dimension == 2 else Vec3
    still = [Ball(vector(*p), vector(*p).scale(0.0), radius) for *p, radius in zones]
    for instant, line in ((0, ":"), (last, "-")):

        def now(x: Any, instant: int = instant) -> float:
            return float(x[instant, episode] if np.ndim(x) == 2 else x[episode])

        goal = map_leaves(now, flight.goals)
        origin = columns(goal.p)
        for shape in (*flight.task.scenery(goal), *still):
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


def timeline(
    axes: Axes, flight: Flight, episode: int, colour: str = BLUE, letter: str = "c"
) -> None:
    """When each thruster of one episode was open; without thrusters, how much of its torque each wheel gave."""
    command = flight.openings[:, episode].T
    what = ("open thrusters", "thruster")
    if not flight.craft.thrusters:
        command = np.abs(flight.commands[:, episode].T)
        what = ("torques of wheels, of the largest", "wheel")
    shades = LinearSegmentedColormap.from_list("open", [f"{colour}00", colour])
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
    label(axes, f"({letter}) {what[0]}", "time, s", what[1])
