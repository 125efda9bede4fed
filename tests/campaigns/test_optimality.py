"""Certificates of many starts: what is asked of them, and what a reader is told."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from campaigns import optimality
from campaigns.command import ended
from campaigns.optimality import Optimality, _line, certificate, report
from rans import processes
from rans.model.spacecraft_file import load_spacecraft
from rans.optimal.certificate.certificate import Certificate
from rans.optimal.certificate.goal_set import GoalSet
from rans.scenario import EVALUATION_SEED, Scenario, scenarios
from rans.tasks import GoToPose
from tests.support.tiny_lattice import PERIOD, fly_everything, instance, lopsided

FOUND = Certificate(lower=1.5, upper=1.875, commands=None, dual=1.25, nodes=7, seconds=2.0)
"""A quarter above its bound."""


def answer(lower: float, upper: float, seconds: float = 2.0) -> Certificate:
    return Certificate(lower, upper, None, lower, 7, seconds)


@pytest.mark.parametrize(
    ("quantity", "horizon", "target"),
    [("time", 10.0, 0.02), ("settling", 10.0, 0.02), ("fuel", 10.0, 0.04), ("fuel", 20.0, 0.1)],
)
def test_gaps_against_what_is_promised(quantity: Any, horizon: float, target: float) -> None:
    """Gaps of 0, 3 % and 0: 1 % in the mean, one of three open."""
    found = report(quantity, horizon, [answer(2.0, 2.0), answer(1.0, 1.03), answer(3.0, 3.0, 5.0)])
    mean, unproven = found.checks
    assert (mean.value, mean.tolerance) == (pytest.approx(0.01), target)
    assert (unproven.value, unproven.tolerance, unproven.passed) == (
        pytest.approx(1 / 3),
        0.5,
        True,
    )
    assert found.settings == {
        "seconds per start": 3.0,
        "mean certified bound": pytest.approx(2.0),
        "mean of the best found": pytest.approx(2.01),
    }
    assert report(quantity, horizon, [answer(1.0, math.inf)]).passed is False
    # A tenth of a per mille is a gap, rounding is none.
    assert (
        report(quantity, horizon, [answer(1.0, 1.0001), answer(1.0, 1.0 + 1e-12)]).checks[1].value
        == 0.5
    )
    assert report(quantity, horizon, [answer(1.0, 1.01)] * 2 + [answer(1.0, 1.0)]).passed is False


def test_the_mean_gap_is_the_mean_of_every_starts_own() -> None:
    """1.5 over 1 and 9 over 9: gaps of 50 % and 0, so 25 %; 10.5 over 10 would be 5 %."""
    mean, _ = report("time", 10.0, [answer(1.0, 1.5), answer(9.0, 9.0)]).checks
    assert mean.value == pytest.approx(0.25)
    assert "every start's own gap" in mean.reason


def test_a_line_of_the_certificates() -> None:
    assert _line(3, FOUND).split() == ["3", "1.250", "1.500", "1.875", "25.0%", "7", "2.0"]


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_one_start_is_as_good_as_every_firing_sequence(seed: int) -> None:
    """All 2^10 of a craft of five thrusters in two periods: some arrive, none after one."""
    craft = lopsided()
    loose = GoalSet()
    names = ("position", "velocity", "heading", "spin")
    start, goal, flown = instance(craft, 2, seed)
    assert not fly_everything(craft, start, 1).arrived(goal, loose, names).any()
    arrived = flown.arrived(goal, loose, names)
    least = {"time": 2 * PERIOD, "fuel": float(flown.fuel[arrived].min())}
    for quantity, value in least.items():
        found = certificate(craft, PERIOD, quantity, 2, 0.3, Scenario(start, goal))  # type: ignore[arg-type]
        assert found.lower <= value + 1e-9  # rounding of sums of pulses
        assert found.upper == pytest.approx(value, abs=1e-9)


class Jobs:
    """In the place of worker processes: remembers what they would be asked, and answers."""

    def __init__(self) -> None:
        self.asked: list[tuple[Any, ...]] = []

    @contextlib.contextmanager
    def submitted(self, function: Any, jobs: Any, workers: Any, *_: Any) -> Iterator[list[Any]]:
        assert {job[0] for job in jobs} == {optimality._certificate}
        self.asked = [job[1:] for job in jobs]
        self.workers = workers
        yield [self for _ in self.asked]

    def result(self) -> Certificate:
        return FOUND


@pytest.fixture
def jobs(monkeypatch: pytest.MonkeyPatch) -> Jobs:
    made = Jobs()
    monkeypatch.setattr(processes, "submitted", made.submitted)
    return made


def test_every_start_of_the_evaluation_is_asked_once(
    jobs: Jobs, capsys: pytest.CaptureFixture[str]
) -> None:
    """8.6 s are 43 periods of 0.2 s, although 8.6 / 0.2 is a little less in floating point."""
    study = Optimality("time", starts=3, horizon=8.6, seconds=7.0, workers=5).run()
    craft = load_spacecraft("floating-platform")
    every = scenarios(GoToPose().for_evaluation(), craft, EVALUATION_SEED, 3)
    assert [job[:5] for job in jobs.asked] == [(craft, 0.2, "time", 43, 7.0)] * 3
    assert [job[5].start.p.x for job in jobs.asked] == every.start.p.x.tolist()
    headings: Any = every.goal.attitude
    assert [job[5].goal.attitude.angle for job in jobs.asked] == pytest.approx(
        np.broadcast_to(headings.angle, 3).tolist(), abs=0.0
    )
    assert jobs.workers == 3  # no more than there are starts
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "least time"
    assert [line.split()[0] for line in said[1:]] == ["start", "0", "1", "2"]
    assert said[2] == _line(0, FOUND)
    assert study.title == "least time of 3 starts"
    assert study.checks[0].value == pytest.approx(0.25)


def test_a_horizon_is_at_least_a_period(jobs: Jobs) -> None:
    Optimality(starts=1, horizon=0.01, workers=2).run()
    assert jobs.asked[0][2:4] == ("fuel", 1)


def test_the_command_says_whether_promises_are_kept(
    jobs: Jobs, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["optimality", "--starts", "1"])
    assert ended("optimality", optimality.main) == 1  # a quarter is more than the 4 % promised
    shown = capsys.readouterr().out
    assert "least fuel: mean gap" in shown
    assert "FAIL" in shown
    monkeypatch.setattr(Jobs, "result", lambda _: answer(1.0, 1.0))
    assert ended("optimality", optimality.main) == 0


def test_no_start_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["optimality", "--starts", "0"])
    assert ended("optimality", optimality.main) == 2
    assert capsys.readouterr().err == "optimality: starts must be >= 1, got 0.\n"
