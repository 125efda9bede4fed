"""The page of a study, the table of certificates and the ratios of a benchmark: what they say, by value."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rans.model.spacecraft_file import load_spacecraft
from validation import discretisation
from validation.agent_rows import Goal
from validation.agents import means
from validation.checks import Check, Curve, Skipped, Study
from validation.discretisation import discretisation_checks
from validation.optimality import _line, report
from validation.page import page
from validation.peers.runner import PeerResult
from validation.speed.measurement import Clock, Measurement
from validation.speed.ratios import bounds, over_trainer, until_solved
from validation.speed.tradeoff import _said
from validation.speed.training import Success

SETTINGS = {"seed": 3, "quick": True, "states": 64, "flights": 16, "seconds": 2.4}


def study_of(*checks: Check) -> Study:
    return Study("Dynamics of x (3DoF)", checks, SETTINGS, (Skipped("kernel", "No compiler."),))


def check(name: str, value: float, tolerance: float, layer: str = "mass") -> Check:
    return Check(name, value, tolerance, "m", "Because.", f"state {name[-1]}", layer)


def test_the_page_of_a_study() -> None:
    shown = page(study_of(check("way 1", 2e-4, 1e-3), check("way 2", -5e-4, 1e-3),
                          check("way 3", 3e-7, 1e-6, "period")), "x.toml")
    assert (shown.title, shown.passed) == ("Validation: Dynamics of x (3DoF)", True)
    assert [(f.text, f.passed) for f in shown.findings] == [
        ("Dynamics of x (3DoF): 3 of 3 checks within tolerance.", True),
        ("Not run: kernel. No compiler.", None)]
    command = "rans validate --spacecraft x.toml --seed 3 --quick"
    assert shown.sections[1].tables[0].rows == [
        ("way 2", "5.0e-01", "state 2", f"{command} --layer mass"),
        ("way 3", "3.0e-01", "state 3", f"{command} --layer period")]
    assert shown.header["command"] == command
    assert (shown.header["sample"], shown.header["time"]) == ("64 states, 16 flights of 25 s", "2 s")


@pytest.mark.parametrize("value", [2e-3, -2e-3, math.nan, math.inf])
def test_a_failed_check_is_on_top_and_the_closest(value: float) -> None:
    shown = page(study_of(check("way 1", 9e-4, 1e-3), check("way 2", value, 1e-3)), "x")
    assert shown.passed is False
    assert shown.findings[0].text == f"way 2: {f'{value:.4g}'.replace('inf', 'never')} m, tolerance 0.001."
    assert shown.sections[1].tables[0].rows[0][0] == "way 2"
    assert "1 of 2 checks within tolerance." in shown.findings[1].text


def test_figures_show_their_points() -> None:
    curve = Curve("error of one control period", "ours", (0.2, 0.1), (1e-6, 1e-8))
    shown = page(Study("x", (check("way 1", 0.0, 1.0),), SETTINGS, (), (curve,)), "x")
    table = shown.sections[2].tables[0]
    assert list(table.columns) == ["method", "step, s", "position error, m (RMS)"]
    assert table.rows == [("ours", "0.2", "1.0e-06"), ("ours", "0.1", "1.0e-08")]


def answer(gap: float, seconds: float = 2.0) -> Any:
    return SimpleNamespace(gap=gap, seconds=seconds, dual=1.25, lower=1.5, upper=2.0, nodes=7)


@pytest.mark.parametrize(("quantity", "horizon", "target"), [
    ("time", 10.0, 0.02), ("fuel", 10.0, 0.04), ("fuel", 20.0, 0.1)])
def test_gaps_against_what_is_promised(quantity: Any, horizon: float, target: float) -> None:
    """Gaps of 0, 3 % and 0: 1 % in the mean, one of three open."""
    found = report(quantity, horizon, [answer(0.0), answer(0.03), answer(0.0, 5.0)])
    mean, unproven = found.checks
    assert (mean.value, mean.tolerance) == (pytest.approx(0.01), target)
    assert (unproven.value, unproven.tolerance, unproven.passed) == (pytest.approx(1 / 3), 0.5, True)
    assert found.settings == {"seconds per start": 3.0}
    assert report(quantity, horizon, [answer(math.inf)]).passed is False


def test_a_line_of_the_certificates() -> None:
    assert _line(3, answer(0.25)).split() == ["3", "1.250", "1.500", "2.000", "25.0%", "7", "2.0"]


def test_ratios_by_hand() -> None:
    measured = [Measurement("engine", "x", 50.0, "M steps/s", bound=200.0, bound_name="y"),
                Measurement("engine", "z", None, "M", bound=1.0), Measurement("engine", "w", 1.0, "M")]
    share, = bounds(measured)
    assert (share.name, share.value, share.note) == ("x: share of y", 0.25, "50 of 200 M steps/s")
    peer = PeerResult("other", "command", figures={
        "trained_steps_per_s": 2e4, "seconds_to_success": 90.0, "solved": False, "steps_to_success": 10**6})
    faster = over_trainer(peer, 1e6, "cpu")
    assert (faster.value, "5 or more" in faster.note) == (50.0, True)
    sooner = until_solved(peer, Success(True, 3.0, 1.0, 2000))
    assert sooner.value == 30.0
    assert "the ratio is a lower bound" in sooner.note


def test_a_clock_tells_the_median(monkeypatch: pytest.MonkeyPatch) -> None:
    """Repeats of 1, 5 and 3 s a call: 3 s; warm-up and the choice of calls come before."""
    took = iter([0.5, 1.0, 1.0, 5.0, 3.0])
    monkeypatch.setattr(Clock, "_took", lambda *_: next(took))
    assert Clock("cpu", repeats=3, seconds=1.0).time(lambda: None) == (3.0, 2.0)


@pytest.mark.parametrize(("solved", "said"), [(True, "solved"), (False, "not solved")])
def test_what_a_training_of_the_tradeoff_says(solved: bool, said: str) -> None:
    assert _said(Success(solved, 1.234, 9.0, 2_500_000)) == (
        f"{said} after 1.23 s of training, 2.50 M steps")


def test_settling_times_are_medians_and_all_else_means() -> None:
    values = {"settling time": np.array([1.0, 2.0, np.inf]), "duty": np.array([1.0, 2.0, 6.0])}
    assert means(values, Goal(("settling time", "duty"), "")) == (2.0, 3.0)
    assert means(values, Goal(("duty",), ""), 2) == (1.5,)


def test_the_default_step_must_gain_a_decade(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the error of 50 Hz Euler; a method as bad as Euler fails."""
    craft = load_spacecraft("floating-platform")
    monkeypatch.setattr(discretisation, "_CONTROL_RATES", (5,))
    monkeypatch.setattr(discretisation, "_EULER_RATES", (50,))
    monkeypatch.setattr(discretisation, "_OUR_NODES", (6,))
    good, = (c for c in discretisation_checks(craft, 1, 1) if isinstance(c, Check))
    assert good.passed
    assert good.tolerance == 0.1
    assert 0.0 < good.value < 1e-6  # exact beside a first-order step
