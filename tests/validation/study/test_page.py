"""The page of a study: what it says, by value."""

from __future__ import annotations

import math

import numpy as np
import pytest

from validation.study.checks import Check, Curve, Skipped, Study
from validation.study.page import _figure, page

SETTINGS = {"seed": 3, "quick": True, "states": 64, "flights": 16, "seconds": 2.4}


def study_of(*checks: Check) -> Study:
    return Study("Dynamics of x (3DoF)", checks, SETTINGS, (Skipped("kernel", "No compiler."),))


def check(name: str, value: float, tolerance: float, layer: str = "mass") -> Check:
    return Check(name, value, tolerance, "m", "Because.", f"state {name[-1]}", layer)


def test_the_page_of_a_study() -> None:
    shown = page(
        study_of(
            check("way 1", 2e-4, 1e-3),
            check("way 2", -5e-4, 1e-3),
            check("way 3", 3e-7, 1e-6, "period"),
        ),
        "x.toml",
    )
    assert (shown.title, shown.passed) == ("Validation: Dynamics of x (3DoF)", True)
    assert [(f.text, f.passed) for f in shown.findings] == [
        ("Dynamics of x (3DoF): 3 of 3 checks within tolerance.", True),
        ("Not run: kernel. No compiler.", None),
    ]
    again = "rans.validate('x.toml', quick=True, layer='{}', seed=3)"
    assert shown.sections[0].tables[0].rows == [
        ("way 2", "5.0e-01", "state 2", again.format("mass")),
        ("way 3", "3.0e-01", "state 3", again.format("period")),
    ]
    assert shown.header["command"] == "rans.validate('x.toml', quick=True, seed=3)"
    assert (shown.header["sample"], shown.header["time"]) == (
        "64 states, 16 flights of 25 s",
        "2 s",
    )


@pytest.mark.parametrize("value", [2e-3, -2e-3, math.nan, math.inf])
def test_a_failed_check_is_on_top_and_the_closest(value: float) -> None:
    shown = page(study_of(check("way 1", 9e-4, 1e-3), check("way 2", value, 1e-3)), "x")
    assert shown.passed is False
    assert (
        shown.findings[0].text
        == f"way 2: {f'{value:.4g}'.replace('inf', 'never')} m, tolerance 0.001."
    )
    assert shown.sections[0].tables[0].rows[0][0] == "way 2"
    assert "1 of 2 checks within tolerance." in shown.findings[1].text


def test_of_what_must_be_exact_any_fault_is_the_closest() -> None:
    shown = page(study_of(check("way 1", 9e-4, 1e-3), check("way 2", 0.0, 0.0)), "x")
    assert shown.sections[0].tables[0].rows[0][:2] == ("way 1", "9.0e-01")
    shown = page(study_of(check("way 1", 9e-4, 1e-3), check("way 2", 1e-9, 0.0)), "x")
    assert shown.sections[0].tables[0].rows[0][:2] == ("way 2", "inf")


def test_figures_show_their_points() -> None:
    curve = Curve("error of one control period", "ours", (0.2, 0.1), (1e-6, 1e-8))
    shown = page(Study("x", (check("way 1", 0.0, 1.0),), SETTINGS, (), (curve,)), "x")
    table = shown.sections[1].tables[0]
    assert list(table.columns) == ["method", "step, s", "position error, m (RMS)"]
    assert table.rows == [("ours", "0.2", "1.0e-06"), ("ours", "0.1", "1.0e-08")]


def test_errors_over_time_grow_along_a_plain_axis_and_those_by_step_along_powers_of_ten() -> None:
    """What is exactly right is drawn at 1e-17: a logarithm has no zero."""
    curves = [
        Curve("", "ours", (0.0, 1.0), (0.0, 1e-9)),
        Curve("", "theirs", (0.0, 2.0), (1e-3, 1e-2)),
    ]
    figure = _figure({"position error over time": curves, "error of one control period": curves})
    time, step = figure.axes
    assert [axes.get_xscale() for axes in (time, step)] == ["linear", "log"]
    assert [axes.get_yscale() for axes in (time, step)] == ["log", "log"]
    assert (time.get_xlabel(), time.get_ylabel()) == ("time, s", "largest difference, m")
    assert (step.get_xlabel(), step.get_ylabel()) == ("step, s", "position error, m (RMS)")
    assert [np.asarray(line.get_ydata()).tolist() for line in time.lines] == [
        [1e-17, 1e-9],
        [1e-3, 1e-2],
    ]


@pytest.mark.slow
def test_two_figures_of_the_same_points_share_a_table() -> None:
    x = (50.0, 100.0)
    curves = (
        Curve("position error after 25 s", "Euler", x, (1e-3, 5e-4)),
        Curve("attitude error after 25 s", "Euler", x, (2e-3, 1e-3)),
    )
    shown = page(Study("x", (check("way 1", 0.0, 1.0),), SETTINGS, (), curves), "x")
    (table,) = shown.sections[1].tables
    assert table.rows == [
        ("Euler", "50", "1.0e-03", "2.0e-03"),
        ("Euler", "100", "5.0e-04", "1.0e-03"),
    ]


def test_a_whole_study_is_repeated_by_a_whole_study() -> None:
    study = Study("x", (check("way 1", 0.0, 1.0),), SETTINGS | {"quick": False})
    assert page(study, "my craft.toml").header["command"] == (
        "rans.validate('my craft.toml', seed=3)"
    )
