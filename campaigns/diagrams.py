"""Pictures of the pages for users: flights in which the subject of a page is seen.

`python -m campaigns.pictures` writes them. Each function draws one figure; its name is that of the file.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from campaigns.schemes import PALE, arrow
from rans.api.agent import load_agent
from rans.api.limits import optimal_trajectory, state
from rans.api.training import train
from rans.drawing import columns
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.measure.metrics import arrival_times, impulses
from rans.fast.learn.run_folder import RunFolder
from rans.flight import Flight, fly
from rans.model.fields import Vec3
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions, FaultConditions, ThrusterConditions
from rans.randomization.conditions_file import load_conditions
from rans.scenario import EVALUATION_SEED, Endpoints, draws, scenarios
from rans.show.curve import learning_charts
from rans.show.figures.chart_figure import charts_figure
from rans.show.figures.figures import styled
from rans.show.figures.plotting import Axes, Circle, Figure
from rans.show.palette import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, RED, series_style
from rans.tasks import GoToPose

_START = state((3.0, 1.0), attitude=0.7)
"""Start of the figures that show one flight of several contestants."""
_ORIGIN = state((0.0, 0.0))


def _flown(who: str, episodes: int, **options: Any) -> Flight:
    return load_agent(who).fly(episodes, seed=EVALUATION_SEED, **options)


def _path(axes: Axes, flight: Flight, episode: int, colour: str, name: str = "") -> None:
    """The path of an episode in the plane, with a dot at its start."""
    path = columns(flight.states.p)[:, episode, :2]
    axes.plot(*path.T, color=colour, linewidth=1.1, label=name or None)
    axes.plot(*path[:1].T, "o", color=INK, markersize=2.5)


def _plane(axes: Axes, title: str = "") -> None:
    axes.plot(0.0, 0.0, "+", color=GREEN, markersize=10, markeredgewidth=2)
    axes.set(xlabel="x, m", ylabel="y, m", aspect="equal")
    axes.set_title(title, loc="left")


def _text(
    axes: Axes,
    at: Sequence[float] | np.ndarray,
    text: str,
    colour: str,
    side: Literal["left", "center", "right"],
) -> None:
    axes.text(float(at[0]), float(at[1]), text, color=colour, ha=side, va="center")


@styled
def frames() -> Figure:
    """World frame, body frame, and the position and force of a thruster."""
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.add_subplot()
    axes.set(xlim=(-0.5, 4.2), ylim=(-0.5, 2.6), aspect="equal")
    axes.axis("off")
    centre = np.array([2.6, 1.4])
    angle = np.radians(25.0)
    turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    axes.add_patch(Circle((centre[0], centre[1]), 0.7, facecolor=PALE, edgecolor=INK))
    for tip, name in (((0.9, 0.0), "x"), ((0.0, 0.9), "y")):
        arrow(axes, (0.0, 0.0), tip, INK)
        _text(axes, 1.12 * np.array(tip), f"${name}_W$", INK, "center")
        end = centre + turned @ tip
        arrow(axes, centre, end, BLUE)
        _text(axes, centre + 1.14 * (end - centre), f"${name}_B$", BLUE, "center")
    arrow(axes, (0.0, 0.0), centre, GREY)
    axes.text(1.1, 0.83, "position ${}^Wp^B$", color=INK, rotation=28, ha="center", va="center")
    # A thruster: where it pushes, and the force on the craft, opposite to its plume.
    place = centre + turned @ np.array([-0.35, -0.6])
    force = turned @ np.array([0.75, 0.0])
    arrow(axes, place, place + force, RED)
    _text(axes, place + 0.5 * force + [0.12, -0.17], "force of a thruster", RED, "left")
    axes.plot(*place, "o", color=RED, markersize=5)
    plume = np.array([place, place - 0.5 * force])
    axes.plot(*plume.T, color=ORANGE, linewidth=7, alpha=0.5, solid_capstyle="butt")
    _text(axes, place - 0.6 * force, "plume", ORANGE, "right")
    axes.plot(*centre, "o", color=INK, markersize=4)
    axes.text(
        centre[0] - 0.2,
        centre[1] + 0.15,
        "centre\nof mass",
        color=INK,
        ha="right",
        va="center",
        fontsize=8,
    )
    axes.plot([centre[0], centre[0] + 0.9], [centre[1]] * 2, ":", color=GREY)
    axes.text(centre[0] + 0.92, centre[1] + 0.16, "heading", color=INK, va="center")
    return figure


@styled
def valves() -> Figure:
    """A command, and the thrust that follows it, as the engine computes it every 5 ms."""
    craft = load_spacecraft("floating-platform")
    period = 0.005
    delay, latency, rise = 0.07, 0.06, 0.06
    steps = 100
    own = Conditions(thrusters=ThrusterConditions(command_delay=delay, latency=latency, rise=rise))
    timing = Timing(control_period=period, episode_steps=steps)
    starts = scenarios(GoToPose(), craft, EVALUATION_SEED, 1)
    drawn = draws(EVALUATION_SEED, 1)
    flight = fly(craft, GoToPose(), _Pulse(0.05, 0.3), starts, timing, conditions=own, draws=drawn)
    speed = np.linalg.norm(columns(flight.states.v)[:, 0], axis=1)
    # Two thrusters that push together: the acceleration is that of their force.
    thrust = np.diff(speed) / period
    thrust /= thrust.max()
    times = 1e3 * (np.arange(steps) + 0.5) * period
    figure = Figure(figsize=(7.4, 3.4), layout="constrained")
    axes = figure.add_subplot()
    axes.step(
        times,
        flight.commands[:, 0].max(axis=1),
        where="mid",
        color=INK,
        label="command of the policy",
    )
    axes.plot(times, thrust, color=BLUE, label="thrust, share of the full force")
    edges = 50.0 + 1e3 * np.cumsum([0.0, delay, latency, rise])
    names = ("command_delay", "latency", "rise")
    for name, begin, end, colour in zip(
        names, edges, edges[1:], (PURPLE, ORANGE, GREEN), strict=False
    ):
        axes.axvspan(begin, end, ymax=0.9, color=colour, alpha=0.25, linewidth=0)
        axes.text(0.5 * (begin + end), 1.12, name, color=INK, ha="center", fontsize=7.5)
    axes.set(xlabel="time, ms", ylabel="", ylim=(-0.05, 1.25))
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncol=2)
    return figure


class _Pulse:
    """A controller that opens the thrusters that push along x, from one time to another."""

    name = "pulse"

    def __init__(self, begin: float, end: float) -> None:
        self._begin = begin
        self._end = end
        self._time = 0.0
        craft = load_spacecraft("floating-platform")
        pushes = [thruster.direction[0] > 0.5 for thruster in craft.thrusters]
        self._command = np.array(pushes, dtype=float)

    def reset(self, count: int) -> None:
        """Begin anew."""
        self._time = 0.0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands (N, thrusters)."""
        is_open = self._begin - 1e-9 <= self._time < self._end - 1e-9
        self._time += 0.005
        return np.tile(self._command * is_open, (len(observation), 1))


@styled
def controllers() -> Figure:
    """Four contestants from one start: their paths, and when each thruster is open."""
    names = ("lqr:go-to-pose-2d", "switching:go-to-pose-2d", "mpc:go-to-pose-2d", "go-to-pose-2d")
    figure = Figure(figsize=(10.0, 4.6), layout="constrained")
    grid = figure.add_gridspec(4, 2, width_ratios=(1.0, 1.4))
    left = figure.add_subplot(grid[:, 0])
    for k, who in enumerate(names):
        flight = _flown(who, 1, start=_START, goal=_ORIGIN)
        colour, _ = series_style(k)
        _path(left, flight, 0, colour, flight.controller)
        axes = figure.add_subplot(grid[k, 1])
        openings = np.asarray(flight.commands)[:60, 0].T
        for thruster, row in enumerate(openings):
            spans = [(0.2 * step, 0.2 * level) for step, level in enumerate(row) if level > 0.0]
            axes.broken_barh(spans, (thruster - 0.4, 0.8), facecolors=colour)
        axes.set(ylim=(7.6, -0.6), xlim=(0.0, 12.0), yticks=(0, 7), ylabel="valves")
        axes.tick_params(labelbottom=k == 3)
        axes.set_xlabel("time, s" if k == 3 else "")
    _plane(left)
    left.legend(loc="best")
    return figure


@styled
def conditions() -> Figure:
    """Flights of one agent as designed, in a laboratory, and with a dead thruster at random."""
    named = ("perfect", "lab", "harsh")
    figure = Figure(figsize=(10.0, 3.6), layout="constrained")
    grid = figure.subplots(1, len(named), sharex=True, sharey=True)
    for axes, name in zip(grid, named, strict=True):
        run = contestant("pretrained:go-to-pose-2d").under(load_conditions(name))
        flight = fly_episodes(run.controller, run.judged, EVALUATION_SEED, 16, workers=1).flight
        good = np.isfinite(arrival_times(flight))
        for k in range(16):
            _path(axes, flight, k, BLUE if good[k] else RED)
        _plane(axes, name)
        axes.set(xlim=(-4.5, 4.5), ylim=(-4.5, 4.5))
    return figure


@styled
def faults() -> Figure:
    """An agent without and one with thruster faults in its training, whose first thruster is stuck open."""
    stuck = Conditions(faults=FaultConditions(kinds=("stuck-open",), thrusters=(0,)))
    figure = Figure(figsize=(8.6, 4.0), layout="constrained")
    grid = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, who in zip(grid, ("go-to-pose-2d", "go-to-pose-2d-faults"), strict=True):
        run = contestant(f"pretrained:{who}").under(stuck)
        flight = fly_episodes(run.controller, run.judged, EVALUATION_SEED, 12, workers=1).flight
        for k in range(12):
            _path(axes, flight, k, BLUE)
        _plane(axes, who)
        axes.set(xlim=(-4.5, 4.5), ylim=(-4.5, 4.5))
    return figure


@styled
def comparison() -> Figure:
    """Time and impulse until the arrival, 64 starts of each contestant, and their medians."""
    names = ("go-to-pose-2d", "go-to-pose-2d-fast", "lqr:go-to-pose-2d", "switching:go-to-pose-2d")
    figure = Figure(figsize=(7.2, 4.2), layout="constrained")
    axes = figure.add_subplot()
    for k, who in enumerate(names):
        flight = _flown(who, 64)
        times = arrival_times(flight)
        spent = impulses(flight)
        colour, marker = series_style(k)
        axes.plot(times, spent, marker, color=colour, alpha=0.35, markersize=4, markeredgewidth=0)
        middle = (np.median(times), np.median(spent))
        axes.plot(*middle, marker, color=colour, markersize=10, label=flight.controller)
    axes.set(xlabel="time until the arrival, s", ylabel="impulse of the flight, N s")
    axes.legend(loc="best")
    return figure


@styled
def tasks() -> Figure:
    """Three tasks in the plane, four flights of an agent each."""
    subjects = (
        ("multi-task-2d#go-to-position", "go-to-position"),
        ("go-to-pose-2d", "go-to-pose: the heading too"),
        ("track-velocity-2d", "track-velocity"),
    )
    figure = Figure(figsize=(10.0, 3.6), layout="constrained")
    grid = figure.subplots(1, len(subjects))
    for axes, (who, title) in zip(grid, subjects, strict=True):
        flight = _flown(who, 4)
        for k in range(4):
            _path(axes, flight, k, series_style(k)[0])
            path = columns(flight.states.p)[::10, k, :2]
            ahead = np.stack(
                [np.cos(flight.states.attitude.angle), np.sin(flight.states.attitude.angle)]
            )
            axes.quiver(*path.T, *ahead[:, ::10, k], color=GREY, width=0.005, scale=18)
        if who.startswith("go-to"):
            axes.plot(0.0, 0.0, "+", color=GREEN, markersize=10, markeredgewidth=2)
        axes.set(xlabel="x, m", ylabel="y, m")
        axes.set_aspect("equal", "datalim")
        axes.set_title(title, loc="left")
    return figure


def training() -> Figure:
    """The learning curve of go-to-pose, as `rans train` writes it."""
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        train("go-to-pose", output=run)
        return charts_figure([*learning_charts(RunFolder(run).metrics())])


@styled
def optimum() -> Figure:
    """The quickest way around a keep-out zone, and the commands on it."""
    found = optimal_trajectory(
        "go-to-pose",
        "floating-platform",
        start=_START,
        goal=_ORIGIN,
        objective="time",
        zones=[(1.5, 0.4, 0.5)],
    )
    return found.plot()


@styled
def passive_safety() -> Figure:
    """Distance from the target of guidance to a hold point, and of the coasts where all thrusters shut.

    Of four starts that is drawn from which coasts of mission guidance enter the zone most often.
    """
    figure = Figure(figsize=(9.4, 3.8), layout="constrained")
    grid = figure.subplots(1, 2, sharex=True, sharey=True)
    chosen = None
    for axes, who in zip(grid, ("mission:hold-3d", "passive:hold-3d"), strict=True):
        flight = _flown(who, 4)
        task: Any = flight.task
        p, v = (columns(x) for x in (flight.states.p, flight.states.v))
        begun = range(3, 180, 8)
        times = np.linspace(0.0, 2.0 * np.pi / task.mean_motion, 200)[:, None]
        # (instants of an orbit, starts) of each coast.
        coasts = [task.drift.carry(Vec3(*p[k].T), Vec3(*v[k].T), times)[0].norm() for k in begun]
        enters = [coast.min(axis=0) < task.keep_out for coast in coasts]
        if chosen is None:
            chosen = int(np.sum(enters, axis=0).argmax())
        for k, coast, unsafe in zip(begun, coasts, enters, strict=True):
            colour = RED if unsafe[chosen] else GREY
            minutes = (flight.times[k] + times[:, 0]) / 60.0
            axes.plot(minutes, coast[:, chosen], color=colour, linewidth=0.7)
        distance = np.linalg.norm(p[:, chosen], axis=-1)
        axes.plot(flight.times / 60.0, distance, color=BLUE, linewidth=2.2)
        axes.axhspan(0.0, task.keep_out, color=RED, alpha=0.2, linewidth=0)
        axes.set(xlabel="time, min", xlim=(0.0, 100.0), ylim=(0.0, 400.0))
        axes.set_title(flight.controller, loc="left")
    grid[0].set_ylabel("distance from the target, m")
    return figure


@styled
def guard() -> Figure:
    """LQR, which knows no zones, without and with the safety filter."""
    figure = Figure(figsize=(8.6, 2.4), layout="constrained")
    grid = figure.subplots(1, 2, sharex=True, sharey=True)
    zone = (1.5, 0.4, 0.5)
    start = state((3.0, 1.0), attitude=0.7)
    for axes, guarded in zip(grid, (False, True), strict=True):
        run = contestant("lqr:avoid-2d").guarded(guarded)
        endpoints = Endpoints(start, _ORIGIN, [zone])
        flight = fly_episodes(
            run.controller, run.judged, EVALUATION_SEED, 1, workers=1, endpoints=endpoints
        ).flight
        axes.add_patch(Circle(zone[:2], zone[2], facecolor=RED, alpha=0.25))
        _path(axes, flight, 0, BLUE)
        _plane(axes, "with the safety filter" if guarded else "LQR alone")
    return figure


@styled
def any_craft_in_space() -> Figure:
    """Six flights of an agent for any craft with a spacecraft that its training has not had."""
    flight = load_agent("any-craft-3d", spacecraft="cubesat-6u").fly(6, seed=EVALUATION_SEED)
    positions = columns(flight.states.p)
    figure = Figure(figsize=(8.6, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    for k in range(6):
        colour = series_style(k)[0]
        left.plot(*positions[:, k, :2].T, color=colour, linewidth=1.1)
        right.plot(*positions[:, k, ::2].T, color=colour, linewidth=1.1)
    for axes, other in ((left, "y"), (right, "z")):
        axes.plot(0.0, 0.0, "+", color=GREEN, markersize=10, markeredgewidth=2)
        axes.set(xlabel="x, m", ylabel=f"{other}, m", aspect="equal")
    return figure


DIAGRAMS: dict[str, Callable[[], Figure]] = {
    figure.__name__.replace("_", "-"): figure
    for figure in (
        any_craft_in_space,
        comparison,
        conditions,
        controllers,
        faults,
        frames,
        guard,
        optimum,
        passive_safety,
        tasks,
        training,
        valves,
    )
}
"""Functions of figures by the names of their files."""
