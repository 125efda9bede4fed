"""Figures of landings: paths above the ground, and thrust and tilt."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rans.evaluation.compare.contest import Entry
from rans.evaluation.compare.mission_bounds import MissionBounds
from rans.evaluation.measure.metrics import forces
from rans.extend import (
    GREY,
    INK,
    RED,
    Axes,
    Figure,
    Flight,
    Vec3,
    label,
    map_leaves,
    series_style,
    styled,
)
from rans.show.figures.mission_figures import length
from rans.show.figures.plotting import MaxNLocator

_NEAR = 0.1
"""Share of the highest altitude that the second panel of paths shows."""


@styled
def descent(
    entries: Sequence[Entry], bounds: MissionBounds | None = None, start: int = 0
) -> Figure:
    """Altitude over the downrange distance of all contestants from one start; the site is in the origin.

    Downrange is horizontal, in the direction of the start as seen from the site. The second panel shows the end.
    The bounds add the path of least propellant if they have that of this start, the first.
    """
    figure = Figure(figsize=(9.4, 4.2), layout="constrained")
    panels = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
    paths = [_path(entry.flight, start) for entry in entries]
    # Downrange is the horizontal direction from the site to the start.
    along = paths[0][0, :2] / max(float(np.linalg.norm(paths[0][0, :2])), 1e-9)
    curves: list[tuple[str, Any, str, np.ndarray]] = [
        (entry.name, series_style(k)[0], "-", path)
        for k, (entry, path) in enumerate(zip(entries, paths, strict=True))
    ]
    if bounds is not None and bounds.path is not None and start == 0:
        curves.append(("least propellant", INK, "--", bounds.path))
    points = np.concatenate([_seen(path, along) for *_, path in curves])
    task: Any = entries[0].flight.task
    # The whole descent, and its end near the site.
    for axes, zoom in zip(panels, (1.0, _NEAR), strict=True):
        top = zoom * float(points[:, 1].max())
        visible = points[points[:, 1] <= top]
        left, right = float(visible[:, 0].min()), float(visible[:, 0].max())
        room = 0.06 * max(right - left, 1.0)
        _ground(axes, task, left - room, right + room, 1.08 * top)
        for name, colour, line, path in curves:
            shown_part = _seen(path, along)
            axes.plot(
                *shown_part.T,
                line,
                color=colour,
                label=name,
                linewidth=1.0 if line == "--" else 1.4,
            )
            axes.plot(*shown_part[-1:].T, "o", color=colour, markersize=4)
        axes.plot(*_seen(paths[0][:1], along).T, "o", color=INK, markersize=4, label="start")
        axes.plot([0.0], [0.0], "+", color=RED, markersize=10, label="site")
        axes.set(xlim=(left - room, right + room), ylim=(-0.04 * top, 1.08 * top))
        axes.xaxis.set_major_locator(MaxNLocator(5))
    panels[0].legend(loc="best")
    label(panels[0], f"descent from start {start}", "downrange from the site, m", "altitude, m")
    label(panels[1], "its end", "downrange from the site, m", "altitude, m")
    return figure


def _ground(axes: Axes, task: Any, left: float, right: float, top: float) -> None:
    """Below the glide slope and the ground, where a landing has failed."""
    x = np.unique(
        np.clip([left, -task.position_tolerance, task.position_tolerance, right], left, right)
    )
    rise = math.tan(task.glide_slope) * np.maximum(np.abs(x) - task.position_tolerance, 0.0)
    axes.fill_between(
        x,
        -top,
        rise,
        color=GREY,
        alpha=0.2,
        linewidth=0.0,
        label=f"below the glide slope of {math.degrees(task.glide_slope):.3g} degrees",
    )


@styled
def thrust_and_tilt(entries: Sequence[Entry], start: int = 0) -> Figure:
    """Throttle of all engines together, and tilt of the craft, of all contestants from one start."""
    figure = Figure(figsize=(9.4, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    craft = entries[0].flight.craft
    task: Any = entries[0].flight.task
    full = sum(thruster.force for thruster in craft.thrusters)
    for k, entry in enumerate(entries):
        flight = entry.flight
        last = length(flight, start)
        throttle = 100.0 * forces(flight)[:last, start] / full
        colour = series_style(k)[0]
        left.stairs(
            throttle, flight.times[: last + 1], color=colour, baseline=None, label=entry.name
        )
        right.plot(
            flight.times[: last + 1],
            _tilt(flight, start)[: last + 1],
            color=colour,
            label=entry.name,
        )
    for level in (craft.actuators.low, craft.actuators.high):
        left.axhline(100.0 * level, color=RED, linestyle="--", linewidth=1.0)
    right.axhline(
        math.degrees(task.tilt_limit), color=RED, linestyle="--", linewidth=1.0, label="limit"
    )
    left.set_ylim(0.0, 105.0)
    right.set_ylim(0.0, None)
    left.legend(loc="lower left")
    right.legend(loc="best")
    label(left, f"throttle, start {start}", "time, s", "thrust of the engines, % of full")
    label(right, f"tilt, start {start}", "time, s", "tilt of the craft, degrees")
    return figure


def _path(flight: Flight, start: int) -> np.ndarray:
    """(T + 1, 3) positions from the site until the flight has ended, m."""
    last = length(flight, start)
    away = map_leaves(lambda x: np.asarray(x)[: last + 1, start], flight.states.p - flight.goals.p)
    return np.stack(away.columns(), axis=1)


def _seen(path: np.ndarray, along: np.ndarray) -> np.ndarray:
    """(T, 2) downrange and altitude of positions (T, 3), m, with a horizontal direction (2,)."""
    return np.stack([path[:, :2] @ along, path[:, 2]], axis=1)


def _tilt(flight: Flight, start: int) -> np.ndarray:
    """(T + 1,) angle between the craft's z axis and the vertical, degrees."""
    attitude = map_leaves(lambda x: np.asarray(x)[:, start], flight.states.attitude)
    return np.degrees(np.arccos(np.clip(attitude.rotate(Vec3(0.0, 0.0, 1.0)).z, -1.0, 1.0)))
