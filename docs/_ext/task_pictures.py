"""Pictures of tasks for the reference: starts, goals, scenery, and flights of an agent or controller."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.patches import Wedge

import rans
from rans.base.errors import RansError
from rans.base.pretrained import pretrained_card, pretrained_names
from rans.episode.flight import Flight
from rans.episode.scenario import EVALUATION_SEED, scenarios
from rans.model.fields import map_leaves
from rans.show.figures.plotting import Axes, Circle, Figure
from rans.tasks import load_task
from rans.tasks.derived import dimensions
from rans.tasks.shapes import Ball, Cone

FLIGHTS = 4
"""Flights in a picture."""
CONTROLLERS = {
    "dock": "mission",
    "hold": "mission",
    "rendezvous": "mission",
    "inspect": "circumnavigation",
    "final-approach": "corridor",
}
"""Who flies a task that no agent of RANS is for."""
PATHS = "#0b61a4"
SIDES = {"land": 2}
"""Number of the vertical axis of a picture where that is not y."""
GOAL = "#00875a"
ZONE = "#b3261e"


def contestant(task: str) -> str:
    """Who flies in the picture of a task: an agent, of the plane if there is one, or a controller; "": nobody."""
    names = [name for name in pretrained_names() if pretrained_card(name)["task"] == task]
    if names:
        return min(names, key=lambda name: ("-3d" in name, len(name)))
    return f"{CONTROLLERS[task]}:{task}-3d" if task in CONTROLLERS else ""


def save_task_picture(task: str, file: Path) -> str:
    """Draw a task in W into an SVG; what the picture shows, for its caption, "" where it would show nothing.

    That is a task of several tasks, and one without places that nobody flies.
    """
    if len(load_task(task).parts()) > 1:
        return ""
    to_place = "position" in load_task(task).tolerances()
    side = SIDES.get(task, 1)
    who = contestant(task)
    figure = Figure(figsize=(5.0, 4.2), layout="constrained")
    axes = figure.add_subplot()
    shown = "Starts (dots) and goals" if to_place else "Starts (dots)"
    caption = f"{shown} of {task} from {'above' if side == 1 else 'the side'}"
    flight = _flown(who) if who else None
    if flight is None and not to_place:
        return ""
    if flight is None:
        _draw_scenarios(axes, task)
    else:
        _draw_flight(axes, flight, side)
        caption += f", with {FLIGHTS} flights of {flight.controller}"
        if axes.patches:
            caption += "; zones and cones are those of the first flight as it ends"
    axes.set_aspect("equal", "datalim")
    axes.set_xlabel("x, m")
    axes.set_ylabel(f"{'xyz'[side]}, m")
    axes.grid(alpha=0.3)
    picture = io.StringIO()
    figure.savefig(picture, format="svg", metadata={"Date": None})
    file.write_text(picture.getvalue(), "utf-8")
    return f"{caption}."


def _flown(who: str) -> Flight | None:
    """Its flights; None where it cannot fly without more settings."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of controllers that do not know constraints
            return rans.load_agent(who).fly(FLIGHTS, seed=EVALUATION_SEED)
    except RansError:
        return None


def _draw_flight(axes: Axes, flight: Flight, side: int) -> None:
    """Ways, starts, goals at the end, and scenery at the end of the first flight."""
    task: Any = flight.task
    x, y = (np.asarray(flight.states.p.columns()[k]) for k in (0, side))
    for k in range(x.shape[1]):
        axes.plot(x[:, k], y[:, k], color=PATHS, linewidth=1.2, alpha=0.8)
    axes.plot(x[0], y[0], "o", color=PATHS, markersize=4)
    if "position" in task.tolerances():
        places = flight.goals.p.columns()
        goals = [np.broadcast_to(np.asarray(places[k]), x.shape) for k in (0, side)]
        axes.plot(goals[0][-1], goals[1][-1], "x", color=GOAL, markersize=7, markeredgewidth=2)
    if side == 1:
        last = map_leaves(lambda one: _first(one, x.shape), flight.goals)
        _draw_scenery(axes, task, last)


def _first(field: Any, shape: tuple[int, ...]) -> float:
    """The first flight's number at its end."""
    return float(np.broadcast_to(np.asarray(field, dtype=float), shape)[-1, 0])


def _draw_scenarios(axes: Axes, name: str) -> None:
    task = load_task(name)
    dimension = dimensions(task)[0]
    craft = rans.load_spacecraft("floating-platform" if dimension == 2 else "free-flyer")
    drawn = scenarios(task, craft, EVALUATION_SEED, 40)
    starts = [np.broadcast_to(one, 40) for one in drawn.start.p.columns()[:2]]
    goals = [np.broadcast_to(one, 40) for one in drawn.goal.p.columns()[:2]]
    axes.plot(*starts, "o", color=PATHS, markersize=4)
    axes.plot(*goals, "x", color=GOAL, markersize=7, markeredgewidth=2)
    _draw_scenery(axes, task, map_leaves(lambda one: float(np.ravel(one)[0]), drawn.goal))


def _draw_scenery(axes: Axes, task: Any, goal: Any) -> None:
    """Zones as discs and approach cones as wedges, as seen along z."""
    for shape in task.scenery(goal):
        if isinstance(shape, Ball):
            centre = shape.centre.columns()[:2]
            axes.add_patch(Circle(centre, shape.radius, color=ZONE, alpha=0.25))
        elif isinstance(shape, Cone):
            heading = np.degrees(np.arctan2(*shape.axis.columns()[1::-1]))
            half = np.degrees(shape.half_angle)
            wedge = Wedge(
                shape.apex.columns()[:2],
                shape.length,
                heading - half,
                heading + half,
                color=GOAL,
                alpha=0.2,
            )
            axes.add_patch(wedge)
