"""The thruster layout of a spacecraft as a figure."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rans.model.spacecraft import Spacecraft
from rans.outline import Outline
from rans.show.figures.figures import styled
from rans.show.figures.plotting import Circle, Figure, MaxNLocator

_BODY = "#DCE6F0"
_EDGE = "#1F2933"
_NOZZLE = "#52606D"
_FLAME = "#E69F00"
_GRID = "#E4E7EB"
_SHADOW = "#B8C0CA"
_TRAIL = "#0072B2"
_ELEVATION, _AZIMUTH = math.radians(25.0), math.radians(-54.0)
"""Whence the reader sees a craft in space."""
_PAPER = np.array(
    [
        [-math.sin(_AZIMUTH), -math.sin(_ELEVATION) * math.cos(_AZIMUTH)],
        [math.cos(_AZIMUTH), -math.sin(_ELEVATION) * math.sin(_AZIMUTH)],
        [0.0, math.cos(_ELEVATION)],
    ]
)
"""Directions of the paper, to the right and up, in the frame of a craft in space."""


@styled
def draw_layout(craft: Spacecraft) -> Figure:
    """Figure of the thruster layout: thrusters with their forces, outline and centre of mass, in G.

    Arrows show forces on the spacecraft; the longest is that of the strongest thruster. Numbers stand at the tips
    of the arrows, or behind the thrusters where other numbers or arrows are at the tips.
    """
    figure = Figure(figsize=(6.0, 6.0), layout="constrained")
    axes: Any = figure.add_subplot(projection="3d" if craft.dimension == 3 else None)
    outline = Outline(craft)
    roots = np.array([nozzle.root for nozzle in outline.nozzles]).reshape(-1, 3) + outline.centre
    positions = roots[:, : craft.dimension]
    forces = [-nozzle.exhaust * nozzle.strength for nozzle in outline.nozzles]
    arrows = 0.5 * craft.radius * np.array(forces).reshape(-1, 3)[:, : craft.dimension]
    axes.plot(*positions.T, "o", color=_NOZZLE, markersize=5, label="thruster")
    axes.plot(
        *([x] for x in outline.centre[: craft.dimension]),
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
        axes.view_init(elev=math.degrees(_ELEVATION), azim=math.degrees(_AZIMUTH))
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            axis.set_major_locator(
                MaxNLocator(5, steps=[1, 2, 5, 10])
            )  # more numbers overlap on slanted axes
    for index, point in enumerate(_numbers(positions, arrows, 0.15 * craft.radius)):
        axes.text(*point, str(index), ha="center", va="center", color=_EDGE)
    axes.set(
        title=f"{craft.name}: force of each thruster", xlabel="x, m", ylabel="y, m", aspect="equal"
    )
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.08), ncols=2, frameon=False)
    return figure


def _numbers(positions: np.ndarray, arrows: np.ndarray, apart: float) -> np.ndarray:
    """Places (K, d) of the numbers of K arrows (K, d), which readers see this far from other numbers and arrows.

    Each is the first of four places that is free: the tip, behind the thruster, and both farther away. Where none
    is, it is the freest.
    """
    paper = _PAPER if positions.shape[1] == 3 else np.eye(2)
    along = np.linspace(0.0, 1.0, 5)[:, None]
    shafts = [
        (start + along * arrow) @ paper for start, arrow in zip(positions, arrows, strict=True)
    ]
    numbers: list[np.ndarray] = []
    for index, (start, arrow) in enumerate(zip(positions, arrows, strict=True)):
        places = start + np.array([[1.25], [-0.25], [1.5], [-0.5]]) * arrow
        others = [
            *shafts[:index],
            *shafts[index + 1 :],
            *(number[None] @ paper for number in numbers),
        ]
        taken = np.concatenate([np.full((1, 2), math.inf), *others])
        free = np.linalg.norm((places @ paper)[:, None] - taken, axis=2).min(axis=1)
        numbers.append(places[np.argmax(np.minimum(free, apart))])
    return np.reshape(numbers, positions.shape)


def _outline(axes: Any, craft: Spacecraft) -> None:
    """Draw the outer radius (m) around the centre of mass, a disc in the plane and a sphere in space."""
    centre = Outline(craft).centre
    if craft.dimension == 2:
        axes.grid(color=_GRID)
        axes.set_axisbelow(True)
        axes.ticklabel_format(useOffset=False)
        axes.add_patch(
            Circle(
                (float(centre[0]), float(centre[1])),
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
