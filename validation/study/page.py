"""A study as one self-contained HTML page: verdict, figures, every check, worst cases, how to repeat it."""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from itertools import groupby

import numpy as np

from rans.files import environment
from rans.show.figures.figures import styled
from rans.show.figures.panels import label
from rans.show.figures.plotting import Axes, Figure
from rans.show.pages.page import Page, Picture, Section, header
from rans.show.pages.report import validation_section
from rans.show.palette import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, RED, SKY
from rans.table import Table
from validation.study.checks import Curve, Study

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
    (
        "Errors over time",
        ("position error over time", "attitude error over time"),
        "The largest difference over all flights at every instant. Drake's own error, from halving its step, "
        "is the floor below which no comparison with it means anything.",
    ),
    (
        "Order of convergence",
        ("error of one control period",),
        "Random states under random thrust, against 256 steps. The slope of a line is the order: 1 for "
        "semi-implicit Euler, 6 for ours in space; in the plane one step is exact to rounding.",
    ),
    (
        "What the time step costs",
        ("position error after 25 s", "attitude error after 25 s"),
        "25 s of closed-loop on/off thrust at 5 and 10 Hz, against Drake. The original system takes "
        "semi-implicit Euler steps at 50 or 100 Hz, one force evaluation each (its two leftmost points). "
        "Ours is a quadrature of 1 to 6 nodes a control period in the plane and 1 to 16 steps of three nodes "
        "in space; the default is six nodes or one step.",
    ),
)


def page(study: Study, spacecraft: str, conditions: str | None = None) -> Page:
    """The page of a study.

    Args:
        study: what was found.
        spacecraft: its name or file, as the command line takes it.
        conditions: likewise.
    """
    sections = [
        Section(
            "Closest to the bound",
            "For each group the check with the least margin, and the command "
            "that repeats it with the same random numbers.",
            [_worst_table(study, spacecraft, conditions)],
        ),
        *filter(None, (_figures(study, *section) for section in _SECTIONS)),
        validation_section(study.to_json()),
    ]
    settings = study.settings
    return Page(
        f"Validation: {study.title}",
        sections,
        header(
            {
                "command": _command(study, spacecraft, conditions),
                "spacecraft": spacecraft,
                "conditions": conditions or "a perfect world",
                "seed": settings["seed"],
                "sample": f"{settings['states']} states, {settings['flights']} flights of 25 s",
                "time": f"{settings['seconds']:.0f} s",
                "environment": environment(),
            }
        ),
    )


def _command(study: Study, spacecraft: str, conditions: str | None, layer: str = "") -> str:
    named = conditions if layer in ("", "conditions") else None
    if study.settings["seed"]:  # which only the function has
        values = {
            "quick": study.settings["quick"] or None,
            "layer": layer or None,
            "conditions": named,
            "seed": study.settings["seed"],
        }
        given = [f"{name}={value!r}" for name, value in values.items() if value is not None]
        return f"rans.validate({', '.join([repr(spacecraft), *given])})"
    words = ["rans", "validate", spacecraft]
    words += ["--quick"] if study.settings["quick"] else []
    words += ["--layer", layer] if layer else []
    words += ["--conditions", named] if named else []
    return shlex.join(words)


def _worst_table(study: Study, spacecraft: str, conditions: str | None) -> Table:
    rows = []
    for layer, checks in groupby(study.checks, key=lambda check: check.layer):
        worst = max(checks, key=lambda check: check.share)
        rows.append(
            (
                worst.name,
                f"{worst.share:.1e}",
                worst.worst,
                _command(study, spacecraft, conditions, layer),
            )
        )
    return Table(("check", "share of tolerance", "found at", "repeat with"), rows)


def _figures(study: Study, title: str, names: Iterable[str], text: str) -> Section | None:
    found = {name: [curve for curve in study.curves if curve.figure == name] for name in names}
    if not any(found.values()):
        return None
    picture = Picture.of(_figure(found), f"{title}: {study.title}.")
    return Section(title, text, _points(found), [picture])


def _points(found: dict[str, list[Curve]]) -> list[Table]:
    """The points of figures that share their curves, as numbers; instants are too many."""
    if any("over time" in name for name in found):
        return []
    columns = (next(_AXES[name][0] for name in found), *(_AXES[name][1] for name in found))
    rows = [
        (curves[0].name, f"{point[0]:g}", *(f"{y:.1e}" for y in point[1:]))
        for curves in zip(*found.values(), strict=True)
        for point in zip(curves[0].x, *(curve.y for curve in curves), strict=True)
    ]
    return [Table(("method", *columns), rows)]


@styled
def _figure(found: dict[str, list[Curve]]) -> Figure:
    figure = Figure(figsize=(4.7 * len(found), 3.6), layout="constrained")
    for axes, (name, curves) in zip(
        np.ravel(figure.subplots(1, len(found))), found.items(), strict=True
    ):
        _draw(axes, name, curves)
    return figure


def _draw(axes: Axes, name: str, curves: list[Curve]) -> None:
    over_time = "over time" in name
    for curve, colour in zip(curves, _COLOURS, strict=False):
        y = np.maximum(curve.y, _SMALLEST)
        axes.plot(
            curve.x,
            y,
            color=colour,
            label=curve.name,
            marker="" if over_time else "o",
            markersize=4,
        )
    axes.set_yscale("log")
    if not over_time:
        axes.set_xscale("log")
    label(axes, name, *_AXES[name])
    axes.legend()
