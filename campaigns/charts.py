"""Pictures of the pages that are charts: of records in docs/validation, of closed forms, and of a few flights.

`python -m campaigns.pictures` writes them. Each function draws one figure; its name is that of the file.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rans_assurance.assure.bounds import lower, upper
from rans_missions.orbits.elliptic import EllipticOrbit
from rans_missions.orbits.perturbed import PerturbedOrbit
from scipy.spatial import ConvexHull

from campaigns.standings import MISSIONS, rows
from rans.api.agent import load_agent
from rans.evaluation.measure.metrics import arrival_times, impulses, settling_times
from rans.files import read_json, read_text
from rans.model.drift import ClohessyWiltshire, Drift
from rans.model.fields import Vec3
from rans.model.spacecraft import wrenches_either_way
from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import EVALUATION_SEED
from rans.show.figures.figures import styled
from rans.show.figures.plotting import Figure
from rans.show.palette import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, RED, series_style

_DOCS = Path(__file__).parents[1] / "docs"


def _record(name: str) -> Any:
    return read_json(_DOCS / "validation" / f"{name}.json")


@styled
def original() -> Figure:
    """Share of the time within a distance of the goal: the original system, and the worst of our seeds."""
    lines = {
        line["row"].partition(",")[0]: line
        for line in _record("agents")["lines"]
        if line["row"].endswith(", original") and line["what"] == "PT5 / 2 / 1"
    }
    figure = Figure(figsize=(7.6, 3.2), layout="constrained")
    grid = figure.subplots(1, len(lines), sharey=True, squeeze=False)[0]
    for axes, (name, line) in zip(grid, lines.items(), strict=True):
        theirs = [float(text) for text in re.findall(r"[\d.]+", line["original"])]
        ours = np.min([*line["runs"].values()], axis=0)
        at = np.arange(3)
        axes.bar(at - 0.2, theirs, 0.36, color=GREY, label="original system")
        axes.bar(at + 0.2, ours, 0.36, color=BLUE, label="RANS, worst of the seeds")
        axes.set_xticks(at, ["5 cm", "2 cm", "1 cm"])
        axes.set(xlabel="within", ylim=(0.0, 100.0))
        axes.set_title(name, loc="left")
    grid[0].set_ylabel("share of the time, %")
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside lower center", ncol=2)
    return figure


@styled
def failure_bounds() -> Figure:
    """The bounds on the failure probability that a campaign gives, by flights and failures."""
    flights = np.unique(np.logspace(2.0, 7.0, 40).astype(int))
    figure = Figure(figsize=(7.2, 3.6), layout="constrained")
    axes = figure.add_subplot()
    for failures, colour in ((0, BLUE), (10, ORANGE)):
        at_most = [upper(failures, count, 0.01) for count in flights]
        axes.loglog(flights, at_most, color=colour, label=f"at most, {failures} failures")
        if failures:
            at_least = [lower(failures, count, 0.01) for count in flights]
            axes.loglog(
                flights, at_least, "--", color=colour, label=f"at least, {failures} failures"
            )
    axes.loglog(flights, 10 / flights, ":", color=ORANGE, label="10 failures / flights")
    axes.set(xlabel="flights", ylabel="failure probability, 99 %")
    axes.legend(loc="best")
    return figure


@styled
def failure_probabilities() -> Figure:
    """Interval of 99 % of the failure probability of every agent that was assured."""
    found = {}
    for file in sorted((_DOCS / "validation" / "assurance").glob("*.json")):
        bound = read_json(file)["bounds"]["any"]
        if "multi-task" not in file.stem and "trade-off" not in file.stem:
            found[file.stem] = (bound["at least"], bound["at most"])
    order = sorted(found, key=lambda name: found[name][1])
    figure = Figure(figsize=(7.6, 0.2 * len(order) + 0.9), layout="constrained")
    axes = figure.add_subplot()
    for k, name in enumerate(order):
        low, high = found[name]
        colour = BLUE if high < 1e-4 else ORANGE if high < 1e-2 else RED
        axes.plot([max(low, 1e-9), high], [k, k], color=colour, linewidth=2.5)
    axes.set_xscale("log")
    axes.set_yticks(range(len(order)), order, fontsize=7.5)
    axes.set(xlim=(1e-8, 1.0), ylim=(len(order) - 0.4, -0.6), xlabel="failure probability, 99 %")
    return figure


@styled
def missions() -> Figure:
    """What the least known flight, guidance and agent of each mission spend over the proven bound."""
    kinds = (("least known", GREEN), ("guidance", ORANGE), ("agent", BLUE))
    figure = Figure(figsize=(7.6, 3.0), layout="constrained")
    axes = figure.add_subplot()
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
    axes.text(1.0, -0.75, " proven bound", color=INK, fontsize=8, va="center")
    axes.set_xscale("log")
    axes.set_xticks([1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0], ["1", "1.5", "2", "3", "5", "10", "20"])
    axes.minorticks_off()
    axes.set_yticks(range(len(names)), names)
    axes.set(ylim=(len(names) - 0.4, -1.1), xlabel="spent / proven bound of the same start")
    axes.legend(loc="best")
    return figure


@styled
def hull() -> Figure:
    """Force and torque of all ways to open the thrusters of a platform, and their convex hull."""
    craft = load_spacecraft("floating-platform")
    single = wrenches_either_way(craft)
    ways = (np.arange(2**8)[:, None] >> np.arange(8)) & 1
    sums = ways @ single.T[:8]
    figure = Figure(figsize=(8.4, 3.6), layout="constrained")
    for k, (pair, names) in enumerate(
        (
            ((0, 1), ("force along x, N", "force along y, N")),
            ((0, 2), ("force along x, N", "torque, N m")),
        )
    ):
        axes = figure.add_subplot(1, 2, k + 1)
        points = np.unique(sums[:, pair].round(9), axis=0)
        edge = points[ConvexHull(points).vertices]
        axes.fill(*edge.T, color=BLUE, alpha=0.15, linewidth=0)
        axes.plot(*np.vstack([edge, edge[:1]]).T, color=BLUE)
        axes.plot(*points.T, "o", color=INK, markersize=3)
        axes.set(xlabel=names[0], ylabel=names[1])
    return figure


@styled
def elliptic() -> Figure:
    """Coasts from rest on the track: the craft stays near a target on a circle, and leaves one on an ellipse."""
    figure = Figure(figsize=(7.0, 3.8), layout="constrained")
    axes = figure.add_subplot()
    n = 6.6e-4
    times = np.linspace(0.0, 2.0 * np.pi / n, 240)
    p, v = Vec3(0.0, 150.0, 0.0), Vec3(0.0, 0.0, 0.0)
    drifts: dict[str, Drift] = {"circle": ClohessyWiltshire(n)}
    for eccentricity in (0.1, 0.3):
        drifts[f"eccentricity {eccentricity}"] = EllipticOrbit(n, eccentricity, 0.6)
    for k, (name, drift) in enumerate(drifts.items()):
        path = np.array([np.ravel(drift.carry(p, v, t)[0].columns())[:2] for t in times])
        style = "o" if name == "circle" else "-"
        axes.plot(path[:, 1], path[:, 0], style, color=series_style(k)[0], label=name)
    axes.plot(0.0, 0.0, "+", color=GREEN, markersize=10, markeredgewidth=2)
    axes.set(xlabel="along the track, m", ylabel="outwards, m")
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
    grid[1].set(xlabel="swings, % of the mass", ylabel="settled or docked, %")
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside lower center", ncol=3)
    return figure


@styled
def perturbed() -> Figure:
    """How far a coast ends from that of Clohessy and Wiltshire: with oblateness, with drag and with both."""
    figure = Figure(figsize=(7.0, 3.4), layout="constrained")
    axes = figure.add_subplot()
    n = 0.0011068  # of an orbit at 500 km
    tilt, drag = np.radians(51.6), 3.7e-7
    times = np.linspace(0.0, 2000.0, 121)
    p, v = Vec3(0.0, -300.0, 0.0), Vec3(0.0, 0.0, 0.0)
    circle = ClohessyWiltshire(n)
    drifts: dict[str, Drift] = {
        "oblate Earth": PerturbedOrbit.around_earth(n, tilt),
        "drag": PerturbedOrbit(n, 0.0, tilt, drag, 0.0),
        "both": PerturbedOrbit.around_earth(n, tilt, drag),
    }
    for k, (name, drift) in enumerate(drifts.items()):
        apart = [(drift.carry(p, v, t)[0] - circle.carry(p, v, t)[0]).norm() for t in times]
        axes.plot(times, apart, color=series_style(k)[0], label=name)
    axes.set(xlabel="time, s", ylabel="from the coast on a circle, m", xlim=(0.0, 2000.0))
    axes.legend(loc="best")
    return figure


@styled
def any_craft_adaptive() -> Figure:
    """Flights that settle with a dead thruster and with twice the mass: the tables of the page."""
    page = read_text(_DOCS / "any_craft/any_craft_adaptive.md")
    rows = re.findall(
        r"^\| ([a-z0-9-]+) \| (?:adaptive:)?any-craft-.d \|(.*)\|$", page, re.MULTILINE
    )
    cells = [(name, rest.split("|")) for name, rest in rows]
    figure = Figure(figsize=(7.6, 3.6), layout="constrained")
    grid = figure.subplots(1, 2, sharey=True)
    names = [*dict.fromkeys(name for name, _ in cells)]
    for axes, column, title in ((grid[0], 1, "one dead thruster"), (grid[1], 6, "twice the mass")):
        # The row without estimates comes before the row with them.
        for shift, colour, marker, label in (
            (0, GREY, "o", "any-craft"),
            (1, BLUE, "D", "adaptive:any-craft"),
        ):
            texts = [(name, row[column].strip(" %")) for name, row in cells[shift::2]]
            points = [(float(text), names.index(name)) for name, text in texts if text != "-"]
            axes.plot(*np.transpose(points), marker, color=colour, markersize=5, label=label)
        axes.set_title(title, loc="left")
        axes.set(xlabel="settled, %", xlim=(0.0, 102.0), ylim=(len(names) - 0.4, -0.6))
    grid[0].set_yticks(range(len(names)), names, fontsize=7.5)
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside lower center", ncol=2)
    return figure


@styled
def identified_agents() -> Figure:
    """Flights that agents solve on hidden craft, by what they were trained on."""
    solved = _record("identified-agents")["solved"]
    rows = {
        "identified": "identified spacecraft",
        "ranges": "data sheet, broad ranges",
        "sheet": "data sheet as it is",
    }
    figure = Figure(figsize=(7.0, 2.2), layout="constrained")
    axes = figure.add_subplot()
    for k, name in enumerate(rows):
        axes.plot(
            solved[name],
            np.full(len(solved[name]), k),
            series_style(k)[1],
            color=series_style(k)[0],
            markersize=7,
            alpha=0.5,
        )
    axes.axvline(97.0, color=INK, linewidth=1.0, linestyle=":")
    axes.set_yticks(range(len(rows)), [*rows.values()])
    axes.set(xlabel="solved, % of the flights on a hidden craft", xlim=(-2.0, 102.0))
    axes.set_ylim(len(rows) - 0.5, -0.5)
    return figure


@styled
def perturbations() -> Figure:
    """Share of flights that robust agents hold, by perturbation."""
    plane, space = (
        next(iter(_record(name)["agents"].values())) for name in ("robustness", "robustness-space")
    )
    names = [name for name in plane if name in space]
    names.sort(key=lambda name: -plane[name]["held"]["value"])
    figure = Figure(figsize=(7.6, 0.21 * len(names) + 0.9), layout="constrained")
    axes = figure.add_subplot()
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
    axes.set_yticks(range(len(names)), names, fontsize=7.5)
    axes.set(xlim=(least, 101.0), ylim=(len(names) - 0.4, -0.6), xlabel="solved, % of the flights")
    axes.legend(loc="upper left")
    return figure


@styled
def settled_gate() -> Figure:
    """Share of single axes that settle, by gain and bias."""
    cells = np.array(_record("settled-gate")["alone"]["runs/settled-gate"])
    gains, biases = ("0.3", "0.4", "0.5", "1", "1.5", "2"), ("0", "0.1", "0.2", "0.25", "0.3")
    figure = Figure(figsize=(5.4, 3.4), layout="constrained")
    axes = figure.add_subplot()
    for i in range(cells.shape[0]):
        for j in range(cells.shape[1]):
            share = cells[i, j] / 100.0
            colour = BLUE if share > 0.5 else RED
            alpha = 0.15 + 0.6 * abs(2.0 * share - 1.0)
            axes.fill_between(
                [j - 0.48, j + 0.48], i - 0.47, i + 0.47, color=colour, alpha=alpha, linewidth=0
            )
            axes.text(j, i, f"{cells[i, j]:.3g}", ha="center", va="center", color=INK)
    axes.set_xticks(range(len(biases)), biases)
    axes.set_yticks(range(len(gains)), gains)
    axes.set(xlabel="bias", ylabel="gain", ylim=(len(gains) - 0.5, -0.5))
    axes.grid(visible=False)
    return figure


@styled
def failed_thrusters() -> Figure:
    """Success of RAFT's protocol by the number of thrusters that fail during the flight."""
    rows = [
        row for row in _record("raft")["rows"] if row["spacecraft"] == "floating-platform-shared"
    ]
    figure = Figure(figsize=(7.2, 3.6), layout="constrained")
    axes = figure.add_subplot()
    for k, row in enumerate(rows):
        shares = []
        for count in range(5):
            cells = row["cells"]["0 start" if count == 0 else f"{count} flight"]
            wins = sum(cell[0] for cell in cells.values())
            shares.append(100.0 * wins / sum(cell[2] for cell in cells.values()))
        colour, marker = series_style(k)
        axes.plot(range(5), shares, marker=marker, color=colour, label=row["who"])
    axes.set_xticks(range(5))
    axes.set(xlabel="thrusters that fail in flight", ylabel="success, %", ylim=(0.0, 102.0))
    axes.legend(loc="lower left")
    return figure


@styled
def margins() -> Figure:
    """Every check of a spacecraft's validation, as a share of its tolerance."""
    checks = _record("floating-platform")["checks"]
    layers = [*dict.fromkeys(check["layer"] for check in checks)]
    figure = Figure(figsize=(7.4, 0.24 * len(layers) + 1.0), layout="constrained")
    axes = figure.add_subplot()
    least = 1e-8
    for check in checks:
        tolerance = check["tolerance"]
        share = abs(check["value"]) / tolerance if tolerance else 0.0
        row = layers.index(check["layer"])
        colour, marker = (BLUE, "o") if share > least else (GREY, "<")
        axes.plot(max(share, least), row, marker, color=colour, markersize=5, alpha=0.7)
    axes.axvline(1.0, color=RED, linewidth=1.6)
    axes.text(1.1, -0.9, "tolerance", color=RED, fontsize=8, va="center")
    axes.set_xscale("log")
    axes.set_yticks(range(len(layers)), layers)
    axes.set(xlim=(0.5 * least, 30.0), ylim=(len(layers) - 0.4, -1.4), xlabel="value / tolerance")
    return figure


@styled
def vbar_scores() -> Figure:
    """V-BAR's composite score of guidance of RANS and of V-BAR's own controller, by scenario."""
    scenarios = {row["scenario"]: row for row in _record("vbar")["rows"]}
    names = [name for name, row in scenarios.items() if row["pd"]]
    figure = Figure(figsize=(7.4, 0.26 * len(names) + 1.1), layout="constrained")
    axes = figure.add_subplot()
    for who, colour, shift, label in (
        ("rans", BLUE, -0.2, "RANS"),
        ("pd", GREY, 0.2, "V-BAR's PD"),
    ):
        shares = [100.0 * scenarios[n][who]["succeeded"] / scenarios[n]["episodes"] for n in names]
        axes.barh(np.arange(len(names)) + shift, shares, 0.36, color=colour, label=label)
    axes.set_yticks(range(len(names)), names)
    axes.set(xlim=(0.0, 101.0), ylim=(len(names) - 0.4, -0.6), xlabel="episodes that succeeded, %")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncol=2)
    return figure


@styled
def multiples() -> Figure:
    """Time and impulse until the first rest over the certified bounds: the table of the page."""
    page = read_text(_DOCS / "measured.md")
    rows = re.findall(r"^\| `([a-z0-9-]+)` \|(.*)\|$", page, re.MULTILINE)
    figure = Figure(figsize=(4.8, 3.6), layout="constrained")
    axes = figure.add_subplot()
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
def events() -> Figure:
    """The events of a flight that tables count: arrival, settling and the dwell time."""
    flights = load_agent("lqr:go-to-pose-2d").fly(32, seed=EVALUATION_SEED)
    apart = settling_times(flights) - arrival_times(flights)
    k = int(np.argmax(np.where(np.isfinite(apart), np.abs(apart), 0.0)))
    error = 100.0 * flights.errors()["position"][:, k]
    period = flights.timing.control_period
    end = (len(error) - 1) * period
    figure = Figure(figsize=(7.6, 3.4), layout="constrained")
    axes = figure.add_subplot()
    axes.semilogy(np.arange(len(error)) * period, error, color=BLUE)
    axes.axhspan(0.1, 5.0, color=GREEN, alpha=0.15, linewidth=0)
    axes.text(0.3, 0.14, "within the tolerance of 5 cm", color=INK, fontsize=8)
    # The name of the arrival stands above the line of the settling time.
    marks = (
        (arrival_times(flights)[k], "first in the goal set", PURPLE, 1.0, 300.0),
        (settling_times(flights)[k], "settling time", ORANGE, 0.8, 80.0),
    )
    for time, name, colour, top, height in marks:
        axes.axvline(time, ymax=top, color=colour, linewidth=1.4)
        axes.text(time + 0.2, height, name, color=colour, fontsize=8.5, va="center")
    axes.axvspan(0.8 * end, end, color=GREY, alpha=0.25, linewidth=0)
    axes.text(
        0.9 * end,
        130.0,
        "last fifth:\nthe dwell time",
        color=INK,
        fontsize=8.5,
        ha="center",
        va="center",
    )
    axes.set(xlabel="time, s", ylabel="position error, cm", xlim=(0.0, end), ylim=(0.1, 600.0))
    return figure


@styled
def pareto_front() -> Figure:
    """Mean time and impulse of an agent with a trade-off input, and of controllers, from the same 64 starts."""
    figure = Figure(figsize=(7.2, 3.8), layout="constrained")
    axes = figure.add_subplot()
    points = []
    for position in (0.0, 0.25, 0.5, 0.75, 1.0):
        flight = load_agent(f"pretrained:go-to-pose-2d-trade-off#{position}").fly(
            64, seed=EVALUATION_SEED
        )
        points.append((np.minimum(arrival_times(flight), 25.0).mean(), impulses(flight).mean()))
        if position != 0.25:  # whose number would stand on that of 0
            axes.annotate(f"  {position:g}", points[-1], color=INK, fontsize=8, va="bottom")
    axes.plot(*np.transpose(points), "-o", color=BLUE, label="agent, by its trade-off input")
    rivals = ("lqr", ORANGE, "s"), ("switching", PURPLE, "^"), ("mpc", GREEN, "v")
    for who, colour, marker in rivals:
        flight = load_agent(f"{who}:go-to-pose-2d").fly(64, seed=EVALUATION_SEED)
        mean = np.minimum(arrival_times(flight), 25.0).mean(), impulses(flight).mean()
        axes.plot(*mean, marker, color=colour, markersize=8, label=flight.controller)
    axes.set(xlabel="first in the goal set, s", ylabel="impulse of 25 s, N s", ylim=(0.0, None))
    axes.legend(loc="best")
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
    figure.axes[0].legend()
    return figure


CHARTS: dict[str, Callable[[], Figure]] = {
    figure.__name__.replace("_", "-"): figure
    for figure in (
        any_craft_adaptive,
        elliptic,
        error_sources,
        events,
        failed_thrusters,
        failure_bounds,
        failure_probabilities,
        hull,
        identified_agents,
        margins,
        missions,
        multiples,
        original,
        pareto_front,
        perturbations,
        perturbed,
        settled_gate,
        slosh,
        vbar_scores,
    )
}
"""Functions of figures by the names of their files."""
