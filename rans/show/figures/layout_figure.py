"""The thruster layout of a spacecraft as a figure."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rans.episode.outline import nozzles
from rans.model.spacecraft import Spacecraft
from rans.show.figures.panels import styled
from rans.show.figures.plotting import Circle, Figure, MaxNLocator

_BODY = "#DCE6F0"
_EDGE = "#1F2933"
_NOZZLE = "#52606D"
_FLAME = "#E69F00"
_GRID = "#E4E7EB"
_SHADOW = "#B8C0CA"
_TRAIL = "#0072B2"


@styled
def draw_layout(craft: Spacecraft) -> Figure:
    """Figure of the thruster layout: thrusters with their forces, outline and centre of mass, in G.

    Arrows show forces on the spacecraft; the longest is that of the strongest thruster. Numbers stand at the tips
    of the arrows.
    """
    figure = Figure(figsize=(6.0, 6.0), layout="constrained")
    axes: Any = figure.add_subplot(projection="3d" if craft.dimension == 3 else None)
    positions = np.array([t.position for t in craft.thrusters]).reshape(-1, 3)[:, : craft.dimension]
    forces = [-nozzle.exhaust * nozzle.strength for nozzle in nozzles(craft)]
    arrows = 0.5 * craft.radius * np.array(forces).reshape(-1, 3)[:, : craft.dimension]
    axes.plot(*positions.T, "o", color=_NOZZLE, markersize=5, label="thruster")
    axes.plot(
        *([x] for x in craft.centre_of_mass[: craft.dimension]),
        "P",
        color=_FLAME,
        markersize=9,
        label="centre of mass",
    )
    _outline(axes, craft)
    if craft.dimension == 2:
        axes.quiver(*positions.T, *arrows.T, color=_TRAIL, angles="xy", scale_units="xy", scale=1.0)
        axes.update_datalim(positions + 1.4 * arrows)
    else:
        axes.quiver(*positions.T, *arrows.T, color=_TRAIL)
        axes.set_zlabel("z, m")
        axes.view_init(elev=25.0, azim=-54.0)
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            axis.set_major_locator(
                MaxNLocator(5, steps=[1, 2, 5, 10])
            )  # more numbers overlap on slanted axes
    for index, point in enumerate(positions + 1.25 * arrows):
        axes.text(*point, str(index), ha="center", va="center", color=_EDGE)
    axes.set(
        title=f"{craft.name}: force of each thruster", xlabel="x, m", ylabel="y, m", aspect="equal"
    )
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.08), ncols=2, frameon=False)
    return figure


def _outline(axes: Any, craft: Spacecraft) -> None:
    """Draw the outer radius (m) around the centre of mass, a disc in the plane and a sphere in space."""
    centre = craft.centre_of_mass
    if craft.dimension == 2:
        axes.grid(color=_GRID)
        axes.set_axisbelow(True)
        axes.ticklabel_format(useOffset=False)
        axes.add_patch(
            Circle(
                centre[:2],
                craft.radius,
                facecolor=_BODY,
                edgecolor=_EDGE,
                zorder=0.6,
            )
        )
        return
    around, down = np.meshgrid(np.linspace(0.0, math.tau, 25), np.linspace(0.0, math.pi, 13))
    unit = (np.sin(down) * np.cos(around), np.sin(down) * np.sin(around), np.cos(down))
    sphere = [c + craft.radius * u for c, u in zip(centre, unit, strict=True)]
    axes.plot_wireframe(*sphere, color=_SHADOW, linewidth=0.4)
