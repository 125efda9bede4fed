"""The figure of optimal trajectories: where they go, how fast, and how many thrusters they open."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from rans.evaluation.compare.optima import Optimum
from rans.show.figures.figures import styled
from rans.show.figures.panels import BLUE, GREEN, INK, keep_out, label


@styled
def optimal_figure(answers: Sequence[Optimum], zones: Sequence[Sequence[float]] = ()) -> Figure:
    """Paths, speeds and sums of commands of all trajectories that were solved and are flown by Drake.

    Args:
        answers: optima.
        zones: keep-out balls: coordinates of the centre, then the radius, of each, m.
    """
    paths = [answer.trajectory for answer in answers if answer.good]
    spatial = bool(paths) and len(paths[0].states.p.columns()) == 3
    figure = Figure(figsize=(12.0, 3.6), layout="constrained")
    axes: Any = figure.add_subplot(1, 3, 1, projection="3d" if spatial else None)
    speeds = figure.add_subplot(1, 3, 2)
    sums = figure.add_subplot(1, 3, 3)
    alpha = 1.0 if len(paths) == 1 else 0.5
    for path in paths:
        positions = np.array(path.states.p.columns())
        times = np.arange(positions.shape[1]) * path.control_period
        axes.plot(*positions, color=BLUE, linewidth=1.0, alpha=alpha)
        axes.plot(*positions[:, :1], "o", color=INK, markersize=3)
        speeds.plot(times, path.states.v.norm(), color=BLUE, linewidth=1.0, alpha=alpha)
        opened = path.commands.sum(axis=1)
        sums.stairs(opened, times, color=BLUE, linewidth=1.0, alpha=alpha, baseline=None)
    for number, answer in enumerate(answer for answer in answers if answer.good):
        if answer.flight is not None:
            goal = [np.ravel(x)[-1] for x in answer.flight.goals.p.columns()]
            axes.plot(
                *([x] for x in goal), "+", color=GREEN, markersize=9, label="" if number else "goal"
            )
    keep_out(axes, zones, [0.0] * (3 if spatial else 2))
    if paths:
        axes.legend(loc="best")
    axes.set_aspect("equal", adjustable="box" if spatial else "datalim")
    label(axes, f"(a) paths of {len(paths)} starts", "x, m", "y, m")
    if spatial:
        axes.set_zlabel("z, m")
    label(speeds, "(b) speed", "time, s", "speed, m/s")
    label(sums, "(c) sum of commands, each 0 to 1", "time, s", "open thrusters")
    return figure
