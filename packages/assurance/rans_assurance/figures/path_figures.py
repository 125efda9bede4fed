"""The figure of flights along a path, after figure "velocity_tracking" of the paper."""

from __future__ import annotations

from typing import Any

import numpy as np

from rans.extend import Figure, label, styled
from rans.show.figures.plotting import Axes, SubFigure
from rans.show.palette import BLUE, GREEN, GREY, INK, ORANGE, RED
from rans_assurance.follow.follow import Following


@styled
def following_figure(following: Following, number: int = 0) -> Figure:
    """Path and trajectories; the velocities of flight ``number`` with their commands; all distances."""
    dimension = following.planner.path.dimension
    figure = Figure(figsize=(9.4, 2.0 + 1.4 * dimension), layout="constrained")
    cells = figure.add_gridspec(1, 2, width_ratios=(1.0, 1.35))
    _ways(figure.add_subfigure(cells[0]), following, number)
    stack = figure.add_subfigure(cells[1]).subplots(dimension + 1, 1, sharex=True)
    for axis, axes in enumerate(stack[:-1]):
        _velocity(axes, following, number, axis)
    stack[0].set_title(f"(b) velocity of flight {number} and its commands")
    _distances(stack[-1], following, number)
    return figure


def _ways(figure: SubFigure, following: Following, number: int) -> None:
    """Draw the path and the ways of all flights along it (m), of which the one with this number is marked."""
    path = following.planner.path
    axes: Any = figure.add_subplot(projection="3d" if path.dimension == 3 else None)
    axes.plot(
        *path.at(np.arange(path.last + 1)).T, color=ORANGE, linewidth=3.0, alpha=0.6, label="path"
    )
    for flight, steps in enumerate(_steps(following)):
        axes.plot(
            *following.positions[:steps, flight].T,
            **_line_style(flight == number),
            label=f"flight {number}" if flight == number else "",
        )
    start = following.positions[:1, number].T
    axes.plot(*start, "o", color=INK, markersize=4, label="its start")
    axes.set_aspect("equal", adjustable="datalim" if path.dimension == 2 else "box")
    axes.legend(loc="best")
    label(axes, f"(a) {path.name}, {following.positions.shape[1]} flights", "x, m", "y, m")
    if path.dimension == 3:
        axes.set_zlabel("z, m")


def _line_style(chosen: bool) -> dict[str, Any]:
    """Style of a flight's line; that of the flight with all its panels stands out."""
    return (
        {"color": BLUE, "linewidth": 1.3, "zorder": 3}
        if chosen
        else {"color": GREY, "linewidth": 0.55, "zorder": 2, "alpha": 0.5}
    )


def _steps(following: Following) -> np.ndarray:
    """Instants of each flight until it arrived."""
    return (following.progress < following.planner.end).sum(axis=0) + 1


def _velocity(axes: Axes, following: Following, number: int, axis: int) -> None:
    """Draw the velocity of one flight beside that which it is to track."""
    times = following.flight.times
    steps = _steps(following)[number]
    axes.plot(
        times[:steps],
        following.velocities[:steps, number, axis],
        color=BLUE,
        linewidth=1.0,
        label="flown",
    )
    axes.step(
        times[: steps - 1],
        following.commands[: steps - 1, number, axis],
        where="post",
        color=ORANGE,
        linewidth=1.0,
        label="command",
    )
    axes.set_ylabel(f"v_{'xyz'[axis]}, m/s")
    if axis == 0:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2)  # above the curves


def _distances(axes: Axes, following: Following, number: int) -> None:
    """Draw the distance of every flight from the path (cm) over time (s); the shaded approach does not count."""
    times = following.flight.times
    distance = 100.0 * following.cross_track
    counts = following.measured
    for flight, steps in enumerate(_steps(following) - 1):
        axes.plot(times[:steps], distance[:steps, flight], **_line_style(flight == number))
    axes.axvspan(
        0.0,
        times[counts[:, number].argmax()],
        color=GREEN,
        alpha=0.12,
        linewidth=0,
        label=f"approach of flight {number}, not measured",
    )
    rms = following.quantities()[0].values.mean()
    axes.axhline(rms, color=RED, linestyle="--", linewidth=1.0, label=f"mean RMS, {rms:.2g} cm")
    axes.set_ylim(bottom=0.0)
    axes.set_xlim(0.0, float(times[_steps(following).max() - 1]))
    axes.legend(loc="upper right")
    label(axes, "(c) distance from the path", "time, s", "cm")
