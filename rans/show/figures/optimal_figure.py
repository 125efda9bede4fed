"""The figure of optimal trajectories: where they go, how fast, and how many thrusters they open."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rans.errors import counted
from rans.evaluation.compare.optima import Optimum
from rans.show.figures.figures import styled
from rans.show.figures.panels import keep_out, label, timeline
from rans.show.figures.plotting import Figure, MaxNLocator
from rans.show.palette import BLUE, GREEN, INK


@styled
def optimal_figure(answers: Sequence[Optimum], zones: Sequence[Sequence[float]] = ()) -> Figure:
    """Paths, speeds and sums of commands of all trajectories that were solved and are flown by Drake.

    Of a single one also the command of each thruster.

    Args:
        answers: optima.
        zones: keep-out balls: coordinates of the centre, then the radius, of each, m.
    """
    solved = [answer for answer in answers if answer.good]
    paths = [answer.trajectory for answer in solved]
    spatial = bool(paths) and len(paths[0].states.p.columns()) == 3
    alone = solved[0].flight if len(solved) == 1 else None
    count = 3 if alone is None else 4
    figure = Figure(figsize=(4.0 * count, 3.6), layout="constrained")
    axes: Any = figure.add_subplot(1, count, 1, projection="3d" if spatial else None)
    speeds = figure.add_subplot(1, count, 2)
    sums = figure.add_subplot(1, count, 3)
    alpha = 1.0 if len(paths) == 1 else 0.5
    # Paths, speeds and sums of all; then goals, and the commands of one alone.
    for path in paths:
        positions = np.array(path.states.p.columns())
        times = np.arange(positions.shape[1]) * path.control_period
        axes.plot(*positions, color=BLUE, linewidth=1.0, alpha=alpha)
        axes.plot(*positions[:, :1], "o", color=INK, markersize=3)
        speeds.plot(times, path.states.v.norm(), color=BLUE, linewidth=1.0, alpha=alpha)
        opened = path.commands.sum(axis=1)
        sums.stairs(opened, times, color=BLUE, linewidth=1.0, alpha=alpha, baseline=None)
    for number, answer in enumerate(solved):
        if answer.flight is not None:
            goal = [np.ravel(x)[-1] for x in answer.flight.goals.p.columns()]
            axes.plot(
                *([x] for x in goal), "+", color=GREEN, markersize=9, label="" if number else "goal"
            )
    keep_out(axes, zones, [0.0] * (3 if spatial else 2))
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="best")
    axes.set_aspect("equal", adjustable="box" if spatial else "datalim")
    label(
        axes,
        f"(a) {'path' if len(paths) == 1 else 'paths'} from {counted(len(paths), 'start')}",
        "x, m",
        "y, m",
    )
    if spatial:
        axes.set_zlabel("z, m")
    label(speeds, "(b) speed", "time, s", "speed, m/s")
    # From none open to the most, at least two: solvers leave 1e-8 of a thruster open or shut.
    most = max((float(path.commands.sum(axis=1).max(initial=0.0)) for path in paths), default=0.0)
    sums.set_ylim(-0.05, max(2.0, math.ceil(most - 1e-3)) + 0.25)
    sums.yaxis.set_major_locator(MaxNLocator(integer=True))
    label(sums, "(c) sum of commands, each 0 to 1", "time, s", "open thrusters")
    if alone is not None:
        timeline(figure.add_subplot(1, count, 4), alone, 0, letter="d")
    return figure
