"""Pictures of the pages that are made of boxes and arrows: who gives what to whom.

`python -m campaigns.pictures` writes them. Each function draws one figure; its name is that of the file.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from rans.show.figures.figures import styled
from rans.show.figures.panels import BLUE, GREY, INK, ORANGE

PALE = "#DCE6F0"
"""Fill of a craft and of boxes, which dark pages change (`rans.show.figures.svg`)."""
_HALF = (1.1, 0.4)
"""Half the width and the height of a box."""


class Box(NamedTuple):
    """A box of a diagram, with the coordinates of its centre."""

    text: str
    x: float
    y: float
    half: float = _HALF[0]
    """Half of its width."""


class Way(NamedTuple):
    """An arrow between two boxes."""

    first: int
    """Number of the box at its beginning."""
    second: int
    """Number of the box at its end."""
    text: str = ""


def arrow(
    axes: Axes,
    begin: Sequence[float] | np.ndarray,
    end: Sequence[float] | np.ndarray,
    colour: str = INK,
) -> None:
    """Draw an arrow."""
    axes.annotate(
        "",
        xy=(end[0], end[1]),
        xytext=(begin[0], begin[1]),
        arrowprops={
            "arrowstyle": "-|>",
            "color": colour,
            "linewidth": 1.6,
            "shrinkA": 0,
            "shrinkB": 0,
        },
    )


def boxes(
    width: float, height: float, drawn: Sequence[Box], ways: Sequence[tuple[int, int] | Way]
) -> Figure:
    """A diagram of boxes, 0.8 high, and of arrows from edge to edge.

    Args:
        width: width of the diagram, in the unit of the boxes' coordinates.
        height: its height.
        drawn: boxes.
        ways: arrows.
    """
    figure = Figure(figsize=(0.78 * width, 0.78 * height), layout="constrained")
    axes = figure.add_subplot()
    axes.set(xlim=(0.0, width), ylim=(0.0, height), aspect="equal")
    axes.axis("off")
    for box in drawn:
        patch = FancyBboxPatch(
            (box.x - box.half, box.y - _HALF[1]),
            2.0 * box.half,
            2.0 * _HALF[1],
            boxstyle="round,pad=0,rounding_size=0.12",
            facecolor=PALE,
            edgecolor=GREY,
        )
        axes.add_patch(patch)
        axes.text(box.x, box.y, box.text, ha="center", va="center", color=INK, fontsize=10)
    for one in ways:
        way = one if isinstance(one, Way) else Way(*one)
        a, b = drawn[way.first], drawn[way.second]
        along = np.array([b.x - a.x, b.y - a.y])
        begin = np.array([a.x, a.y]) + along * _reach(along, a.half)
        end = np.array([b.x, b.y]) - along * _reach(along, b.half)
        arrow(axes, begin, end)
        middle = 0.5 * (begin + end)
        level = abs(along[1]) < 1e-9
        axes.text(
            middle[0] + (0.0 if level else 0.08),
            middle[1] + (0.1 if level else 0.0),
            way.text,
            ha="center" if level else "left",
            va="bottom" if level else "center",
            color=INK,
            fontsize=8,
        )
    return figure


def _reach(along: np.ndarray, half: float) -> float:
    """The share of a way between centres that lies within a box."""
    sides = zip((half, _HALF[1]), along, strict=True)
    return min(h / abs(w) if abs(w) > 1e-9 else np.inf for h, w in sides)


def _note(figure: Figure, x: float, y: float, text: str, colour: str = INK) -> None:
    figure.axes[0].text(x, y, text, ha="center", va="center", color=colour, fontsize=8)


@styled
def pipeline() -> Figure:
    """What a user gives, what RANS does with it, and what comes out."""
    drawn = (
        Box("spacecraft\n(TOML file)", 1.2, 3.4),
        Box("task", 1.2, 2.2),
        Box("conditions\n(TOML file)", 1.2, 1.0),
        Box("rans train", 4.6, 2.2),
        Box("run folder\nwith the agent", 8.0, 2.2),
        Box("evaluate, compare,\nstress, assure, prove", 11.4, 3.4),
        Box("view, report", 11.4, 2.2),
        Box("export, fly", 11.4, 1.0),
    )
    return boxes(12.7, 4.4, drawn, [(0, 3), (1, 3), (2, 3), (3, 4), (4, 5), (4, 6), (4, 7)])


@styled
def commands() -> Figure:
    """The loop of commands, from a data sheet to a robot, and back from its log to a better data sheet."""
    drawn = (
        Box("rans init", 1.3, 3.3),
        Box("spacecraft\n(TOML file)", 4.4, 3.3),
        Box("rans train, sweep", 7.5, 3.3),
        Box("run folder", 10.6, 3.3),
        Box("evaluate, compare,\nstress, assure, prove", 14.0, 4.4, 1.3),
        Box("report, view", 14.0, 3.3, 1.3),
        Box("rans export", 10.6, 2.0),
        Box("exported agent", 10.6, 0.7),
        Box("rans fly", 7.5, 0.7),
        Box("bag of a flight", 4.4, 0.7),
        Box("rans replay", 1.3, 0.7),
        Box("rans identify", 4.4, 2.0),
    )
    ways = [(0, 1), (1, 2), (2, 3), (3, 4), (3, 5), (3, 6), (6, 7), (7, 8), (8, 9), (9, 10)]
    return boxes(15.5, 5.0, drawn, [*ways, (9, 11), (11, 1)])


@styled
def export() -> Figure:
    """The forms of an exported agent, and what opens them."""
    drawn = (
        Box("agent of a\nrun folder", 1.2, 2.6),
        Box("agent.c, agent.h", 5.2, 4.4),
        Box("agent.onnx", 5.2, 3.2),
        Box("agent.py, agent.npz", 5.2, 2.0, 1.25),
        Box("policy.zip", 5.2, 0.8),
        Box("any C99 compiler,\nfirmware", 9.2, 4.4),
        Box("any ONNX runtime", 9.2, 3.2),
        Box("NumPy, rans fly", 9.2, 2.0),
        Box("Stable-Baselines3", 9.2, 0.8),
    )
    ways = [(0, k) for k in range(1, 5)] + [(k, k + 4) for k in range(1, 5)]
    return boxes(10.5, 5.2, drawn, ways)


@styled
def robot() -> Figure:
    """Who sends what to whom when an agent flies a robot."""
    drawn = (
        Box("robot, or\nrans twin", 1.3, 1.6),
        Box("rans fly:\nwatchdogs, filter", 6.3, 1.6),
        Box("agent", 11.0, 1.6),
        Box("bag (MCAP)", 6.3, 0.5),
    )
    ways = [Way(1, 2, "observation, command"), Way(1, 3, "all messages")]
    figure = boxes(12.3, 2.3, drawn, ways)
    (axes,) = figure.axes
    arrow(axes, (2.5, 1.75), (5.1, 1.75))
    arrow(axes, (5.1, 1.4), (2.5, 1.4))
    axes.text(3.8, 1.85, "pose, velocity", ha="center", va="bottom", color=INK, fontsize=8)
    axes.text(3.8, 1.3, "valves", ha="center", va="top", color=INK, fontsize=8)
    return figure


@styled
def architecture() -> Figure:
    """The three engines with what they share below them, and what uses them above."""
    drawn = (
        Box("spacecraft, tasks, conditions", 6.0, 0.7, 2.9),
        Box("one step of an episode", 6.0, 2.0, 2.9),
        Box("rans.fast\n(torch, CUDA, CPU)", 2.0, 3.4, 1.5),
        Box("rans.reference\n(Drake)", 6.0, 3.4, 1.5),
        Box("rans.optimal\n(CasADi, convex)", 10.0, 3.4, 1.5),
        Box("evaluation: fly, compare, stress, assure", 6.0, 4.8, 2.9),
        Box("pages, exports, robot, commands", 6.0, 6.1, 2.9),
    )
    return boxes(
        12.0,
        6.8,
        drawn,
        [
            (0, 1),
            Way(1, 2, "trains"),
            Way(1, 3, "judges"),
            Way(1, 4, "bounds"),
            (2, 5),
            (3, 5),
            (4, 5),
            (5, 6),
        ],
    )


@styled
def cluster() -> Figure:
    """One command, an executor, and workers whose answers come back in the order of the starts."""
    drawn = (
        Box("rans compare ...\n--executor TEXT", 1.4, 2.2, 1.3),
        Box("executor:\nDask, SLURM, MPI", 5.2, 2.2, 1.3),
        Box("worker: starts 0 to 7", 9.4, 3.6, 1.4),
        Box("worker: starts 8 to 15", 9.4, 2.2, 1.4),
        Box("worker: one bound", 9.4, 0.8, 1.4),
        Box("compare.json, the same\nas on one machine", 13.4, 2.2, 1.5),
    )
    ways = [Way(0, 1, "jobs"), (1, 2), (1, 3), (1, 4), (2, 5), (3, 5), (4, 5)]
    return boxes(15.1, 4.4, drawn, ways)


@styled
def environments() -> Figure:
    """The loop of an environment: what the policy receives, what it gives, and where an episode ends."""
    drawn = (
        Box("policy", 2.0, 1.5, 1.2),
        Box("spacecraft,\nN at a time", 7.0, 1.5, 1.4),
        Box("next start\nand goal", 12.4, 1.5, 1.3),
    )
    figure = boxes(14.0, 3.2, drawn, [Way(1, 2, "terminated,\ntruncated")])
    (axes,) = figure.axes
    arrow(axes, (3.3, 1.65), (5.5, 1.65))
    arrow(axes, (5.5, 1.3), (3.3, 1.3))
    axes.text(4.4, 1.75, "action (N, 8)", ha="center", va="bottom", color=INK, fontsize=8)
    axes.text(
        4.4,
        1.2,
        "observation (N, width),\nreward (N)",
        ha="center",
        va="top",
        color=INK,
        fontsize=8,
    )
    axes.plot([12.4, 12.4, 7.0], [1.05, 0.3, 0.3], color=INK, linewidth=1.6)
    arrow(axes, (7.0, 0.3), (7.0, 1.05))
    axes.text(9.7, 0.35, "autoreset", ha="center", va="bottom", color=INK, fontsize=8)
    return figure


@styled
def identification() -> Figure:
    """From a data sheet and the log of a flight to the files that a training takes."""
    drawn = (
        Box("data sheet\n(TOML file)", 1.3, 2.9),
        Box("logs: bag,\nULog, CSV", 1.3, 1.1),
        Box("rans identify:\nfit of motion", 4.9, 2.0, 1.2),
        Box("spacecraft.toml:\nbest values", 8.6, 2.9, 1.2),
        Box("conditions.toml:\nwhat stayed uncertain", 8.6, 1.1, 1.4),
        Box("rans train", 12.2, 2.0),
        Box("fly excitation", 4.9, 0.5, 1.2),
    )
    ways = [(0, 2), (1, 2), (2, 3), (2, 4), (3, 5), (4, 5), (6, 1)]
    return boxes(13.5, 3.6, drawn, ways)


@styled
def learners() -> Figure:
    """What each learner fits the network to."""
    drawn = (
        Box("network", 1.3, 4.0),
        Box("flights with\nsampled commands", 5.0, 4.0, 1.3),
        Box("rewards", 8.7, 4.0),
        Box("network", 1.3, 2.5),
        Box("flights, differentiated", 5.0, 2.5, 1.4),
        Box("return", 8.7, 2.5),
        Box("network", 1.3, 1.0),
        Box("flights of the agent", 5.0, 1.0, 1.3),
        Box("commands of\nthe expert", 8.7, 1.0),
    )
    figure = boxes(13.4, 4.9, drawn, [(0, 1), (1, 2), (3, 4), (4, 5), (6, 7), (7, 8)])
    (axes,) = figure.axes
    for level, text, colour in (
        (4.0, "PPO: what paid more\nbecomes more likely", BLUE),
        (2.5, "gradient: of the return by\nthe weights, backwards", ORANGE),
        (1.0, "imitation: the same states,\nthe expert's commands", BLUE),
    ):
        axes.plot([8.7, 8.7], [level - 0.42, level - 0.7], color=colour, linewidth=1.2)
        axes.plot([8.7, 1.3], [level - 0.7] * 2, color=colour, linewidth=1.2)
        arrow(axes, (1.3, level - 0.7), (1.3, level - 0.42), colour)
        axes.text(10.1, level, text, ha="left", va="center", color=INK, fontsize=8.5)
    return figure


@styled
def memory() -> Figure:
    """What a network may observe beside the newest reading."""
    drawn = (
        Box("reading of\nthis period", 1.4, 2.6),
        Box("Kalman filters:\nestimates", 5.4, 4.4, 1.5),
        Box("last n readings\nand commands", 5.4, 3.2, 1.5),
        Box("moving averages", 5.4, 2.0, 1.5),
        Box("recurrent state (GRU)", 5.4, 0.8, 1.5),
        Box("network", 9.4, 2.6),
        Box("command", 12.8, 2.6),
    )
    ways = [(0, k) for k in range(1, 5)] + [(k, 5) for k in range(1, 5)]
    figure = boxes(14.0, 5.2, drawn, [*ways, (5, 6)])
    figure.axes[0].plot(
        [12.8, 12.8, 1.4], [2.2, 0.15, 0.15], color=GREY, linewidth=1.2, linestyle="--"
    )
    arrow(figure.axes[0], (1.4, 0.15), (1.4, 2.2), GREY)
    _note(figure, 9.4, 0.32, "remembered for the next period")
    return figure


@styled
def task_functions() -> Figure:
    """Which function of a task is called when, in an episode."""
    drawn = (
        Box("sample", 1.3, 2.6),
        Box("observation_terms", 4.6, 2.6, 1.3),
        Box("policy", 8.0, 2.6),
        Box("motion of a\ncontrol period", 11.3, 2.6, 1.2),
        Box("later: the goal moves", 11.3, 1.0, 1.4),
        Box("constraints, done,\nfailed", 7.6, 1.0, 1.2),
        Box("reward", 4.2, 1.0),
    )
    figure = boxes(
        13.0, 3.4, drawn, [Way(0, 1, ""), (1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (6, 1)]
    )
    _note(figure, 1.3, 1.95, "start and goal")
    figure.axes[0].plot([3.05, 1.3], [1.0, 1.0], color=GREY, linewidth=1.2, linestyle="--")
    arrow(figure.axes[0], (1.3, 1.0), (1.3, 1.75), GREY)
    _note(figure, 2.1, 0.75, "episode ended")
    return figure


@styled
def plain_mode() -> Figure:
    """The two ways in which a task's code becomes a step."""
    drawn = (
        Box("your task:\nPython", 1.3, 1.9),
        Box("run once with symbols", 5.2, 2.9, 1.5),
        Box("generated program\nor kernel", 9.2, 2.9, 1.3),
        Box("millions of steps a second", 13.5, 2.9, 1.7),
        Box("run at every step\nwith tensors", 5.2, 0.9, 1.5),
        Box("torch operations,\nautograd", 9.2, 0.9, 1.3),
        Box("print and breakpoint work", 13.5, 0.9, 1.7),
    )
    ways = [(0, 1), (1, 2), (2, 3), Way(0, 4, " plain=True"), (4, 5), (5, 6)]
    return boxes(15.4, 3.8, drawn, ways)


@styled
def protocol() -> Figure:
    """What all contestants of a comparison have in common."""
    drawn = (
        Box("one seed:\n128 starts", 1.3, 2.2),
        Box("agents", 4.8, 3.6),
        Box("LQR, MPC, switching", 4.8, 2.2, 1.3),
        Box("bounds of the\nsame starts", 4.8, 0.8, 1.3),
        Box("one plant, 5 Hz,\nepisodes to the end", 8.8, 2.9, 1.4),
        Box("scores, paired\nby start", 12.4, 2.9, 1.2),
        Box("divided by the bound\nof the same event", 12.4, 0.8, 1.5),
    )
    ways = [(0, 1), (0, 2), (0, 3), (1, 4), (2, 4), (4, 5), (5, 6), (3, 6)]
    return boxes(14.2, 4.4, drawn, ways)


@styled
def provenance() -> Figure:
    """From the command that measures to the table of a page, and the two checks in between."""
    drawn = (
        Box("command:\nflies and measures", 1.5, 1.7, 1.3),
        Box("JSON file in\ndocs/validation", 5.2, 1.7, 1.3),
        Box("python -m\ncampaigns.figures", 8.9, 1.7, 1.3),
        Box("table of a page", 12.6, 1.7, 1.3),
        Box("rans reproduce:\nflown again", 5.2, 0.5, 1.3),
        Box("make test: the table\nis what the file says", 12.6, 0.5, 1.4),
    )
    return boxes(14.2, 2.4, drawn, [(0, 1), (1, 2), (2, 3), (4, 1), (5, 3)])


@styled
def python_objects() -> Figure:
    """Which call returns what, and what that can do."""
    drawn = (
        Box("rans.train", 1.3, 3.2),
        Box("rans.load_agent", 1.3, 1.8),
        Box("Agent", 4.6, 2.5),
        Box(".fly(16): Flight", 8.2, 4.2, 1.4),
        Box(".evaluate(): metrics", 8.2, 3.1, 1.4),
        Box('.compare("lqr")', 8.2, 2.0, 1.4),
        Box(".act(observation)", 8.2, 0.9, 1.4),
        Box(".plot(), .to_csv(file)", 12.4, 4.2, 1.5),
        Box('["solved"].value', 12.4, 3.1, 1.5),
        Box("scores and bounds", 12.4, 2.0, 1.5),
        Box("command of a loop\nof your own", 12.4, 0.9, 1.5),
    )
    ways = [(0, 2), (1, 2)] + [(2, k) for k in range(3, 7)] + [(k, k + 4) for k in range(3, 7)]
    return boxes(14.1, 4.9, drawn, ways)


@styled
def sweep() -> Figure:
    """Seeds times values are members, which train as one program; the best is an agent."""
    drawn = (
        Box("--seeds 4", 1.4, 3.0),
        Box("learning rate:\n1e-3, 3e-4", 1.4, 1.9),
        Box("thrust weight:\n0.01, 0.02, 0.05", 1.4, 0.8, 1.2),
        Box("4 x 2 x 3 =\n24 members", 5.0, 1.9),
        Box("one program, one GPU", 8.5, 1.9, 1.4),
        Box("sweep.json, sweep.svg", 12.4, 2.7, 1.4),
        Box("best/: a run folder", 12.4, 1.1, 1.4),
    )
    return boxes(14.0, 3.8, drawn, [(0, 3), (1, 3), (2, 3), (3, 4), (4, 5), (4, 6)])


@styled
def contestant_name() -> Figure:
    """The parts of a contestant's name."""
    figure = Figure(figsize=(8.6, 2.0), layout="constrained")
    axes = figure.add_subplot()
    axes.set(xlim=(0.0, 11.0), ylim=(0.0, 2.5))
    axes.axis("off")
    parts = (
        (1.0, "lqr", "who: a run folder,\npretrained, a controller,\nsb3, onnx, python", 1.1),
        (3.6, ":go-to-pose-2d", "task", 2.2),
        (6.6, "@mine.toml", "spacecraft", 1.8),
        (9.5, "#0.3", "trade-off input,\nor a task", 0.8),
    )
    for x, text, meaning, width in parts:
        axes.text(
            x, 1.9, text, ha="center", va="center", color=BLUE, fontsize=14, family="monospace"
        )
        axes.plot([x - 0.5 * width, x + 0.5 * width], [1.5, 1.5], color=GREY, linewidth=1.2)
        axes.text(x, 1.3, meaning, ha="center", va="top", color=INK, fontsize=9)
    return figure


@styled
def verification() -> Figure:
    """Who checks what: nothing is judged by its own code."""
    drawn = (
        Box("spacecraft file", 1.4, 2.4),
        Box("engine: our\nequations of motion", 5.2, 3.8, 1.4),
        Box("Drake: masses and\nthruster geometry", 5.2, 2.4, 1.4),
        Box("closed forms, SciPy,\nhand-worked numbers", 5.2, 1.0, 1.5),
        Box("rans validate:\ntolerances", 9.4, 2.4, 1.2),
        Box("validation.json,\nvalidation.html", 13.0, 2.4, 1.3),
    )
    return boxes(14.6, 4.6, drawn, [(0, 1), (0, 2), (0, 3), (1, 4), (2, 4), (3, 4), (4, 5)])


@styled
def ccsds() -> Figure:
    """Messages that come in, the frame in which missions fly, and the messages that go out."""
    drawn = (
        Box("target.opm, craft.opm\n(inertial frame)", 1.7, 2.6, 1.5),
        Box("rans.read_opm,\nrelative_state", 5.6, 2.6, 1.3),
        Box("flight in the\nHill frame", 9.4, 2.6, 1.2),
        Box("rans.write_ccsds", 9.4, 1.4, 1.3),
        Box("episode-0.oem:\ncraft", 5.6, 1.4, 1.3),
        Box("episode-0-target.oem", 9.4, 0.45, 1.5),
        Box("episode-0.aem:\nattitude", 5.6, 0.45, 1.3),
    )
    return boxes(10.9, 3.1, drawn, [(0, 1), (1, 2), (2, 3), (3, 4), (3, 5), (3, 6)])


@styled
def flight_files() -> Figure:
    """What happens to a flight of somebody else."""
    drawn = (
        Box("flights.csv:\nstart, time, dv", 1.4, 1.5, 1.2),
        Box("engine, or Drake", 4.9, 1.5, 1.2),
        Box("limits of the mission\nat every check", 8.6, 2.3, 1.5),
        Box("impulse / proven bound\nof the same start", 8.6, 0.7, 1.5),
        Box("one table, beside\nguidance", 12.6, 1.5, 1.3),
    )
    return boxes(14.1, 3.0, drawn, [(0, 1), (1, 2), (1, 3), (2, 4), (3, 4)])


@styled
def bounds_in_order() -> Figure:
    """Numbers of one start in their order: bounds that are proved, and flights that were flown."""
    figure = Figure(figsize=(8.6, 1.9), layout="constrained")
    axes = figure.add_subplot()
    axes.set(xlim=(0.0, 10.0), ylim=(0.0, 2.6))
    axes.axis("off")
    axes.axvspan(0.0, 4.0, ymin=0.42, ymax=0.62, color=GREY, alpha=0.35, linewidth=0)
    arrow(axes, (0.0, 1.35), (10.0, 1.35), GREY)
    axes.text(2.0, 2.3, "impossible, by proof", ha="center", va="center", color=INK, fontsize=9)
    axes.text(7.0, 2.3, "flown", ha="center", va="center", color=INK, fontsize=9)
    for x, text, colour in (
        (2.0, "bound of the largest\nforce and torque", GREY),
        (4.0, "certified bound\nof on/off control", BLUE),
        (5.6, "best control\nthat was found", BLUE),
        (7.6, "agent", ORANGE),
        (9.0, "LQR", ORANGE),
    ):
        axes.plot(x, 1.35, "o", color=colour, markersize=8)
        axes.text(x, 0.95, text, ha="center", va="top", color=INK, fontsize=9)
    return figure


SCHEMES: dict[str, Callable[[], Figure]] = {
    figure.__name__.replace("_", "-"): figure
    for figure in (
        architecture,
        bounds_in_order,
        ccsds,
        cluster,
        commands,
        contestant_name,
        environments,
        export,
        flight_files,
        identification,
        learners,
        memory,
        pipeline,
        plain_mode,
        protocol,
        provenance,
        python_objects,
        robot,
        sweep,
        task_functions,
        verification,
    )
}
"""Functions of figures by the names of their files."""
