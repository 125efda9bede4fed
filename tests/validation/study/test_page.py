"""The page of a study: what it says, by value."""

from __future__ import annotations

import math

import pytest

from validation.study.checks import Check, Skipped, Study
from validation.study.page import page

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
