"""A study as one self-contained HTML page: verdict, figures, every check, worst cases, how to repeat it."""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from itertools import groupby

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rans.files import environment
from rans.show import report as pages
from rans.show.figures import data_uri, styled, svg
from rans.show.panels import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, RED, SKY, label
from rans.show.report import Finding, Picture, Section, Table
from validation.checks import Check, Curve, Report

_COLOURS = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, GREY, INK)
_SMALLEST = 1e-17
"""Errors are drawn no smaller than this: a logarithm has no zero."""
_AXES = {
    "position error over time": ("time, s", "largest difference, m"),
    "attitude error over time": ("time, s", "largest difference, rad"),
    "error of one control period": ("step, s", "position error, m (RMS)"),
    "position error after 25 s": ("force evaluations per second", "median position error, m"),
    "attitude error after 25 s": ("force evaluations per second", "median attitude error, rad"),
}
_SECTIONS = (
    ("Errors over time", ("position error over time", "attitude error over time"),
     "The largest difference over all flights at every instant. Drake's own error, from halving its step, "
     "is the floor below which no comparison with it means anything."),
    ("Order of convergence", ("error of one control period",),
     "Random states under random thrust, against 256 steps. The slope of a line is the order: 1 for "
     "semi-implicit Euler, 6 for ours in space; in the plane one step is exact to rounding."),
    ("What the time step costs", ("position error after 25 s", "attitude error after 25 s"),
     "25 s of closed-loop on/off thrust at 5 and 10 Hz, against Drake. The original system takes "
     "semi-implicit Euler steps at 50 or 100 Hz, one force evaluation each (its two leftmost points). "
     "Ours is a quadrature of 1 to 6 nodes a control period in the plane and 1 to 16 steps of three nodes "
     "in space; the default is six nodes or one step."),
)


def page(report: Report, spacecraft: str) -> pages.Report:
    """The page of a study.

    Args:
        report: what was found.
        spacecraft: its name or file, as the command line takes it.
    """
    command = _command(report, spacecraft)
    sections = [
        Section("Checks", "Every value must stay within its tolerance.", [_checks_table(report)],
                findings=_findings(report)),
        Section("Closest to the bound", "For each group the check with the least margin, and the command "
                "that repeats it with the same random numbers.", [_worst_table(report, spacecraft)]),
        *(section for section in map(lambda s: _figures(report, *s), _SECTIONS) if section),
    ]
    machine = ("system", "processor", "cores")
    about = environment()
    header = {
        "command": command,
        "spacecraft": spacecraft,
        "seed": report.settings["seed"],
        "sample": f"{report.settings['states']} states, {report.settings['flights']} flights of 25 s",
        "time": f"{report.settings['seconds']:.0f} s",
        "hardware": ", ".join(about[key] for key in machine) + " cores",
        "versions": ", ".join(f"{key} {value}" for key, value in about.items() if key not in machine),
    }
    return pages.Report(f"Validation: {report.title}", sections, header)


def _command(report: Report, spacecraft: str, layer: str = "") -> str:
    words = ["rans", "validate", "--spacecraft", spacecraft, "--seed", str(report.settings["seed"])]
    words += ["--quick"] if report.settings["quick"] else []
    words += ["--layer", layer] if layer else []
    return shlex.join(words)


def _findings(report: Report) -> list[Finding]:
    failed = [Finding(f"{check.name}: {check.value:.1e} {check.unit}, tolerance {check.tolerance:.1e}.",
                      False) for check in report.checks if not check.passed]
    good = len(report.checks) - len(failed)
    share = f"{good} of {len(report.checks)} checks within tolerance."
    skipped = [Finding(f"Not run: {skipped.name}. {skipped.reason}") for skipped in report.skipped]
    return [*failed, Finding(share, None if failed else True), *skipped]


def _checks_table(report: Report) -> Table:
    rows = [(c.name, f"{c.value:.1e}", f"{c.tolerance:.1e}", c.unit, c.passed, c.reason)
            for c in report.checks]
    rows += [(s.name, None, None, None, "not run", s.reason) for s in report.skipped]
    return Table(("check", "value", "tolerance", "unit", "verdict", "why this tolerance"), rows)


def _worst_table(report: Report, spacecraft: str) -> Table:
    rows = []
    for layer, checks in groupby(report.checks, key=lambda check: check.layer):
        worst = max(checks, key=_margin)
        rows.append((worst.name, f"{_margin(worst):.1e}", worst.worst,
                     _command(report, spacecraft, layer)))
    return Table(("check", "share of tolerance", "found at", "repeat with"), rows)


def _margin(check: Check) -> float:
    """Share of the tolerance that is used up; a NaN uses all of it."""
    share = abs(check.value) / check.tolerance
    return share if share == share else np.inf


def _figures(report: Report, title: str, names: Iterable[str], text: str) -> Section | None:
    found = {name: [curve for curve in report.curves if curve.figure == name] for name in names}
    if not any(found.values()):
        return None
    picture = Picture(data_uri(svg(_figure(found))), f"{title}: {report.title}.")
    return Section(title, text, _points(found), [picture])


def _points(found: dict[str, list[Curve]]) -> list[Table]:
    """The points of figures that share their curves, as numbers; instants are too many."""
    if any("over time" in name for name in found):
        return []
    columns = (next(_AXES[name][0] for name in found), *(_AXES[name][1] for name in found))
    rows = [(curves[0].name, f"{point[0]:g}", *(f"{y:.1e}" for y in point[1:]))
            for curves in zip(*found.values(), strict=True)
            for point in zip(curves[0].x, *(curve.y for curve in curves), strict=True)]
    return [Table(("method", *columns), rows)]


@styled
def _figure(found: dict[str, list[Curve]]) -> Figure:
    figure = Figure(figsize=(6.2 * len(found), 4.0), layout="constrained")
    for axes, (name, curves) in zip(np.ravel(figure.subplots(1, len(found))), found.items(), strict=True):
        _draw(axes, name, curves)
    return figure


def _draw(axes: Axes, name: str, curves: list[Curve]) -> None:
    over_time = "over time" in name
    for curve, colour in zip(curves, _COLOURS, strict=False):
        y = np.maximum(curve.y, _SMALLEST)
        axes.plot(curve.x, y, color=colour, label=curve.name, marker="" if over_time else "o", markersize=4)
    axes.set_yscale("log")
    if not over_time:
        axes.set_xscale("log")
    label(axes, name, *_AXES[name])
    axes.legend()
