"""The figure of optimal trajectories: where they go, how fast, and how many thrusters they open."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from rans.evaluation.compare.optima import Optimum
from rans.show.figures.figures import styled
from rans.show.figures.panels import BLUE, INK, label


@styled
def optimal_figure(answers: Sequence[Optimum]) -> Figure:
    """Paths, speeds and sums of commands of all trajectories that were solved and are flown by Drake."""
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
    axes.set_aspect("equal", adjustable="box" if spatial else "datalim")
    label(axes, f"(a) paths of {len(paths)} starts", "x, m", "y, m")
    if spatial:
        axes.set_zlabel("z, m")
    label(speeds, "(b) speed", "time, s", "speed, m/s")
    label(sums, "(c) sum of commands, thrust between 0 and 1", "time, s", "open thrusters")
    return figure
