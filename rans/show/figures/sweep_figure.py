"""The figure of a sweep: how every member learned, and which hyper-parameters solve the task soonest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rans.errors import counted
from rans.fast.learn.sweep import Member, Sweep, short
from rans.show.figures.figures import styled
from rans.show.figures.panels import MILLIONS, label, only
from rans.show.figures.plotting import Axes, Figure
from rans.show.palette import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY

_COLOURS = (BLUE, GREEN, PURPLE, SKY, RED, GREY)


@styled
def sweep_figure(sweep: Sweep) -> Figure:
    """Success of every member while it trained, and its steps until solved, by config; the best in orange."""
    configs = sweep.configs()
    best = sweep.best()
    figure = Figure(figsize=(9.4, max(3.6, 1.2 + 0.3 * len(configs))), layout="constrained")
    curves, ends = figure.subplots(1, 2)
    for row, members in enumerate(configs):
        colour = _COLOURS[row % len(_COLOURS)]
        for member in members:
            _curve(curves, member, colour, alpha=min(1.0, 0.25 + 2.0 / len(sweep.members)))
        _ends(ends, row, members, best, colour)
    _curve(curves, best, ORANGE, linewidth=2.5, zorder=3, label=f"best: seed {best.config.seed}")
    curves.set(xlim=(0.0, None), ylim=(-2.0, 102.0))
    curves.legend(loc="best")
    label(
        curves,
        f"episodes solved by {counted(len(sweep.members), 'member')} while training",
        "environment steps a member",
        "episodes, %",
    )
    ends.margins(x=0.08)
    ends.set(xlim=(0.0, None), ylim=(len(configs) - 0.5, -0.5), yticks=range(len(configs)))
    ends.set_yticklabels([_name(sweep, members) for members in configs])
    label(ends, "until solved (x: never)", "environment steps a member", "")
    for axes in (curves, ends):
        axes.xaxis.set_major_formatter(MILLIONS)
    return figure


def _curve(axes: Axes, member: Member, colour: str, **style: Any) -> None:
    points = [(row["steps"], 100.0 * row["success"]) for row in member.rows or [member.last]]
    axes.plot(*zip(*points, strict=True), color=colour, marker=only(points), **style)


def _ends(axes: Axes, row: int, members: Sequence[Member], best: Member, colour: str) -> None:
    """One mark a member at its last step, apart enough that equal ones are seen; crosses have not solved it."""
    for column, member in enumerate(members):
        height = row + 0.6 * ((column + 0.5) / len(members) - 0.5)
        axes.scatter(
            member.last["steps"],
            height,
            c=ORANGE if member is best else colour,
            marker="o" if member.solved else "x",
            s=24,
            zorder=3,
        )


def _name(sweep: Sweep, members: Sequence[Member]) -> str:
    choice = sweep.choice(members[0])
    seeds = counted(len(members), "seed")
    return "\n".join(f"{short(name)} {value}" for name, value in choice.items()) or seeds
