"""Pictures of the pages that are charts of what changes: records in docs/validation, and tables of pages.

`python -m campaigns.pictures` writes them. Each function draws one figure; its name is that of the file.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from campaigns.figures import checks_of
from campaigns.standings import MISSIONS, rows
from rans.base.files import read_json, read_text
from rans.show.figures.panels import styled
from rans.show.figures.plotting import Axes, Figure
from rans.show.palette import BLUE, GREEN, GREY, INK, ORANGE, RED, series_style

_DOCS = Path(__file__).parents[1] / "docs"


def _record(name: str) -> Any:
    return read_json(_DOCS / "validation" / f"{name}.json")


def _alone(width: float, height: float) -> tuple[Figure, Axes]:
    """A figure of so many inches, and its only axes."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.add_subplot()


def _name_rows(axes: Axes, names: Sequence[str], top: float = -0.6, **font: Any) -> None:
    """Names of rows, the first one at the top, above which there is room."""
    axes.set_yticks(range(len(names)), names, **font)
    axes.set_ylim(len(names) - 0.4, top)


@styled
def failure_probabilities() -> Figure:
    """Interval of 99 % of the failure probability of every agent that was assured."""
    found = {}
    for file in sorted((_DOCS / "validation" / "assurance").glob("*.json")):
        bound = read_json(file)["bounds"]["any"]
        if "multi-task" not in file.stem and "trade-off" not in file.stem:
            found[file.stem] = (bound["at least"], bound["at most"])
    order = sorted(found, key=lambda name: found[name][1])
    figure, axes = _alone(7.6, 0.2 * len(order) + 0.9)
    for k, name in enumerate(order):
        low, high = found[name]
        colour = BLUE if high < 1e-4 else ORANGE if high < 1e-2 else RED
        axes.plot([max(low, 1e-9), high], [k, k], color=colour, linewidth=2.5)
    axes.set_xscale("log")
    _name_rows(axes, order, fontsize=7.5)
    axes.set(xlim=(1e-8, 1.0), xlabel="failure probability, 99 %")
    return figure


@styled
def missions() -> Figure:
    """What the least known flight, guidance and agent of each mission spend over the proven bound."""
    kinds = (("least known", GREEN), ("guidance", ORANGE), ("agent", BLUE))
    figure, axes = _alone(7.6, 3.0)
    names = []
    for mission in MISSIONS:
        # The best of each kind.
        known = [(row[0], row[4]) for row in rows(_DOCS, mission)[1] if row[4] != "-"]
        ratios = {
            kind: min(float(ratio.split()[0]) for one, ratio in known if one == kind)
            for kind, _ in kinds
            if kind in dict(known)
        }
        if not ratios:
            continue
        for kind, colour in kinds:
            if kind in ratios:
                label = kind if kind not in axes.get_legend_handles_labels()[1] else None
                axes.plot(ratios[kind], len(names), "o", color=colour, markersize=7, label=label)
        names.append(mission)
    axes.axvline(1.0, color=INK, linewidth=1.2)
    axes.text(1.03, -0.75, "proven bound", color=INK, fontsize=8, va="center")
    axes.set_xscale("log")
    axes.set_xticks([1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0], ["1", "1.5", "2", "3", "5", "10", "20"])
    axes.minorticks_off()
    _name_rows(axes, names, -1.1)
    axes.set(xlabel="spent / proven bound of the same start")
    axes.legend(loc="best")
    return figure


@styled
def slosh() -> Figure:
    """Impulse and share of flights that win, by the share of the mass that swings."""
    rows = _record("slosh")["rows"]
    figure = Figure(figsize=(7.4, 3.4), layout="constrained")
    grid = figure.subplots(1, 2, sharex=True)
    for k, who in enumerate(dict.fromkeys(row["who"] for row in rows)):
        own = [row for row in rows if row["who"] == who]
        swings = [100.0 * row["share"] for row in own]
        colour, marker = series_style(k)
        style: Any = {"color": colour, "marker": marker, "label": who}
        first = own[0]["impulse"]
        grid[0].plot(swings, [100.0 * (row["impulse"] / first - 1.0) for row in own], **style)
        grid[1].plot(swings, [100.0 * row["won"] for row in own], **style)
    grid[0].set(xlabel="swings, % of the mass", ylabel="more impulse than without, %")
    grid[1].set(xlabel="swings, % of the mass", ylabel="won, %")
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside lower center", ncol=3)
    return figure


@styled
def perturbations() -> Figure:
    """Share of flights that robust agents hold, by perturbation."""
    plane, space = (
        next(iter(_record(name)["agents"].values())) for name in ("robustness", "robustness-space")
    )
    names = [name for name in plane if name in space]
    names.sort(key=lambda name: -plane[name]["held"]["value"])
    figure, axes = _alone(7.6, 0.21 * len(names) + 0.9)
    least = 45.0  # of the axis: one row is below, at 1 to 2 %
    for who, colour, shift, label in (
        (plane, BLUE, -0.15, "go-to-pose-2d-robust"),
        (space, ORANGE, 0.15, "go-to-pose-3d-robust"),
    ):
        at = np.arange(len(names)) + shift
        held = [who[name]["held"] for name in names]
        low, high = ([max(one[end], least) for one in held] for end in ("low", "high"))
        axes.hlines(at, low, high, color=colour, linewidth=1.2)
        values = np.array([one["value"] for one in held])
        within = values >= least
        axes.plot(values[within], at[within], "o", color=colour, markersize=4, label=label)
        axes.plot(
            np.full(sum(~within), least),
            at[~within],
            "<",
            color=colour,
            markersize=5,
            clip_on=False,  # arrows stand on the axis
        )
    _name_rows(axes, names, fontsize=7.5)
    axes.set(xlim=(least, 101.0), xlabel="solved, % of the flights")
    axes.legend(loc="upper left")
    return figure


@styled
def margins() -> Figure:
    """Every check of a spacecraft's validation, as a share of its tolerance."""
    checks = checks_of(_record("floating-platform"))
    layers = [*dict.fromkeys(check.layer for check in checks)]
    figure, axes = _alone(7.4, 0.24 * len(layers) + 1.0)
    least = 1e-8
    for check in checks:
        row = layers.index(check.layer)
        colour, marker = (BLUE, "o") if check.share > least else (GREY, "<")
        axes.plot(max(check.share, least), row, marker, color=colour, markersize=5, alpha=0.7)
    axes.axvline(1.0, color=RED, linewidth=1.6)
    axes.text(1.1, -0.9, "tolerance", color=RED, fontsize=8, va="center")
    axes.set_xscale("log")
    _name_rows(axes, layers, -1.4)
    axes.set(xlim=(0.5 * least, 30.0), xlabel="value / tolerance")
    return figure


@styled
def multiples() -> Figure:
    """Time and impulse until the first rest over the certified bounds: the table of the page."""
    page = read_text(_DOCS / "measured.md")
    rows = re.findall(r"^\| `([a-z0-9-]+)` \|(.*)\|$", page, re.MULTILINE)
    figure, axes = _alone(4.8, 3.6)
    for k, (name, rest) in enumerate(rows):
        cells = [cell.strip() for cell in rest.split("|")]
        colour, marker = series_style(k)
        axes.plot(float(cells[5]), float(cells[6]), marker, color=colour, markersize=9, label=name)
    axes.plot(1.0, 1.0, "+", color=INK, markersize=12, markeredgewidth=2, label="certified bound")
    axes.set_yscale("log")
    axes.set_yticks([1, 2, 5, 10, 20], ["1", "2", "5", "10", "20"])
    axes.set(xlabel="first in the goal set / bound", ylabel="impulse / bound")
    axes.legend(loc="upper right")
    return figure


@styled
def value() -> Figure:
    """Time and impulse until arrival of value functions and of others: both tables of the page."""
    page = read_text(_DOCS / "value" / "value.md")
    cells = r"^\| (time|impulse until then), .* ?s \|(.*)\|$"
    own = [row.split("|") for _, row in re.findall(cells, page, re.MULTILINE)]
    ways = {"value function, 0 to 1": [*zip(*own, strict=True)]}
    for name, flights in re.findall(r"^\| ([^|]+) \| (\d[\d.]+; [^|]+) \|$", page, re.MULTILINE):
        ways[name] = [flight.split("; ") for flight in flights.split(", ")]
    figure, axes = _alone(6.4, 3.8)
    for k, (name, flights) in enumerate(ways.items()):
        colour, marker = series_style(k)
        times, impulses = np.array(flights, dtype=float).T
        axes.plot(times, impulses, marker=marker, color=colour, markersize=5, label=name)
    (least,) = re.findall(r"certified least time is ([\d.]+) s", page)
    axes.axvspan(4.5, float(least), color=GREY, alpha=0.25, label="certified: impossible")
    axes.set(xlim=(4.5, 15.0), xlabel="mean time until first in the goal set, s")
    axes.set(ylabel="mean impulse until then, N s")
    axes.legend(loc="upper right")
    return figure


@styled
def error_sources() -> Figure:
    """Impulse that each error adds, in the mean and of 99.7 % of the flights."""
    rows = _record("error-sources")["rows"]
    missions = [*dict.fromkeys(row["mission"] for row in rows)]
    figure = Figure(figsize=(9.0, 3.2), layout="constrained")
    panels = figure.subplots(1, len(missions), squeeze=False)[0]
    for axes, mission in zip(panels, missions, strict=True):
        base, *own = (row for row in rows if row["mission"] == mission)
        mean = [100.0 * (row["mean impulse"] / base["mean impulse"] - 1.0) for row in own]
        largest = [100.0 * (row["impulse"][-1] / base["impulse"][-1] - 1.0) for row in own]
        where = np.arange(len(own))
        axes.barh(where - 0.2, mean, 0.4, label="mean", color=BLUE)
        axes.barh(where + 0.2, largest, 0.4, label="99.7 % of the flights", color=ORANGE)
        axes.set_yticks(where, [row["error"] for row in own])
        axes.invert_yaxis()
        axes.set_xlabel("impulse added, %")
        axes.set_title(mission)
        axes.axvline(0.0, color=INK, linewidth=0.8)
    figure.axes[0].legend(loc="best")
    return figure


CHARTS: dict[str, Callable[[], Figure]] = {
    figure.__name__.replace("_", "-"): figure
    for figure in (
        error_sources,
        failure_probabilities,
        margins,
        missions,
        multiples,
        perturbations,
        slosh,
        value,
    )
}
"""Functions of figures by the names of their files."""
