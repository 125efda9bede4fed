"""Paths in the orbital plane, with the zones and cones of a mission."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rans.evaluation.compare.contest import Entry
from rans.extend import (
    GREY,
    INK,
    RED,
    Axes,
    Ball,
    Cone,
    Figure,
    Flight,
    label,
    map_leaves,
    series_style,
    styled,
)
from rans.show.figures.mission_figures import length


@styled
def orbital_plane(entries: Sequence[Entry], start: int = 0) -> Figure:
    """Paths of all contestants from one start in the Hill frame of the target, which is in the origin.

    Along the track (V-bar) is to the right, radially outwards (R-bar reversed) is up.
    """
    figure = Figure(figsize=(7.4, 4.6), layout="constrained")
    axes = figure.subplots()
    corners = [np.zeros((2, 1))]
    for k, entry in enumerate(entries):
        flight = entry.flight
        last = length(flight, start)
        radial, along = (
            np.asarray(x)[: last + 1, start] for x in (flight.states.p.x, flight.states.p.y)
        )
        colour, marker = series_style(k)
        corners.append(np.array([along, radial]))
        axes.plot(along, radial, color=colour, label=entry.name)
        axes.plot(along[-1:], radial[-1:], marker, color=colour, markersize=5)
        if k == 0:
            axes.plot(along[:1], radial[:1], "o", color=INK, markersize=4, label="start")
    axes.plot([0.0], [0.0], "+", color=INK, markersize=10, label="target")
    _scenery(axes, entries[0].flight, start)

    # What is shown are the paths: some cones and balls are far larger.
    vertices = np.concatenate(corners, axis=1)
    low = vertices.min(axis=1)
    high = vertices.max(axis=1)
    middle = 0.5 * (low + high)
    half = 0.55 * max((high - low)[0], 1.6 * (high - low)[1], 1.0)
    axes.set(
        xlim=(middle[0] - half, middle[0] + half),
        ylim=(middle[1] - half / 1.6, middle[1] + half / 1.6),
        aspect="equal",
    )
    axes.legend(loc="best")
    label(axes, f"start {start} in the orbital plane", "along the track, m", "radially outwards, m")
    return figure


def _scenery(axes: Axes, flight: Flight, start: int) -> None:
    """Keep-out balls as circles, and cones by their two edges in the orbital plane."""
    goal = map_leaves(lambda x: x[0, start] if np.ndim(x) == 2 else x[start], flight.goals)
    for shape in flight.task.scenery(goal):
        if isinstance(shape, Ball):
            circle = np.linspace(0.0, 2.0 * np.pi, 90)
            x, y = (
                float(getattr(shape.centre, axis)) + float(shape.radius) * coordinate
                for axis, coordinate in (("x", np.sin(circle)), ("y", np.cos(circle)))
            )
            axes.fill(y, x, color=RED, alpha=0.15, linewidth=0.0, label="keep-out")
        elif isinstance(shape, Cone):
            axis = np.arctan2(float(shape.axis.x), float(shape.axis.y))
            for side in (-1.0, 1.0):
                angle = axis + side * float(shape.half_angle)
                reach = float(shape.length) * np.array([0.0, 1.0])
                axes.plot(
                    float(shape.apex.y) + reach * np.cos(angle),
                    float(shape.apex.x) + reach * np.sin(angle),
                    color=GREY,
                    linestyle="--",
                    linewidth=1.0,
                    label="cone" if side > 0.0 else None,
                )
