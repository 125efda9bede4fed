"""A whole comparison: everyone flies, failures are sentences, nobody beats a certified bound."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rans_bounds.problem import SearchEffort
from rans_optimal import relaxed

from rans import LQR, ConfigError, Timing
from rans.base.progress import unseen_stages
from rans.episode.flight import fly
from rans.evaluation.compare.bounds import Bound, Event, Kind
from rans.evaluation.compare.contest import Contestant, Entry
from rans.evaluation.compare.entrants import enlisted
from rans.evaluation.compare.run import TYPICAL, Comparison
from rans.show.pages.comparison_page import page
from rans.show.tables.comparison_tables import (
    best_returns,
    gaps,
)
from rans.tasks.goal_set import arrived
from tests.support.contests import CONTEST, IDLE
from tests.support.evaluation_flights import flight_of
from tests.support.played import Played

SPECS = ["lqr:go-to-pose-2d", IDLE, "python:tests.support.policies:broken"]


@pytest.fixture(scope="module", autouse=True)
def _little_effort() -> Iterator[None]:
    """Bounds with wide gaps are bounds too."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rans_bounds.first_starts._EFFORT", SearchEffort(0.5, 0.2, 1))
        yield


@pytest.fixture(scope="module")
def cache(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("comparison") / "bounds.json"


@pytest.fixture(scope="module")
def comparison(cache) -> Comparison:
    found = Comparison(CONTEST)
    found.fly(enlisted(SPECS, CONTEST), ("lqr", "optimal"), certified=2, cache=cache, workers=1)
    return found


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_failures_are_sentences_and_the_rest_goes_on(comparison):
    [told] = comparison.failures
    assert "broken failed: KeyError: 'no such layer'" in told
    report = page(comparison)
    assert not report.passed
    assert [text for _, text in report.checks[:1]] == comparison.failures


def test_relaxed_optima_are_by_bounded_times_that_leave_time_to_settle(monkeypatch):
    """At 4 times the least time of 2.4 s an optimum would arrive in the last fifth of 10 s."""
    asked = []
    monkeypatch.setattr(relaxed, "solve", lambda _, one, *__: asked.append(one.name) or [])
    contest = replace(CONTEST, timing=Timing(episode_steps=50))
    for multiples in (TYPICAL, (2.0, 4.0)):
        found = Comparison(contest, multiples=multiples)
        found.__dict__["least_time"] = 2.4
        relaxed.add_relaxed(found, stages=unseen_stages, workers=1, returns=False)
    once = ["minimum time", "minimum fuel in 4.8 s"]
    assert asked == [*once, *once, "minimum fuel in 8 s"]


def test_all_who_cannot_take_part_are_told_before_anybody_flies():
    with pytest.raises(ConfigError) as told:
        enlisted(
            [
                *SPECS,
                "runs/nobody",
                "lqr:go-to-pose-3d",
                "mpc:track-velocity-2d",
                "lqr:go-to-pose-2d@floating-platform-shared",
            ],
            CONTEST,
        )
    for sentence in (
        "runs/nobody is not a run folder",
        "is for the spacecraft free-flyer, but the first contestant for floating-platform",
        "is for the task TrackVelocity, but the first contestant for GoToPose",
        "is for the spacecraft floating-platform-shared",
    ):
        assert sentence in str(told.value)


@pytest.mark.slow
def test_nobody_beats_a_certified_bound(comparison):
    assert comparison.certified_starts() == [0, 1]
    assert comparison.impossible() == []
    ratios = gaps(comparison)
    assert list(ratios) == [
        "first time in the goal set",
        "settling time",
        *(f"impulse by {t:g} s" for t in comparison.horizons()),
    ]
    every = np.concatenate([r for question in ratios.values() for r in question.values()])
    assert (every >= 1.0 - 1e-9).all()
    for what in ("first time in the goal set", "settling time"):
        assert np.isfinite(ratios[what]["LQR"]).all()
        assert np.isinf(ratios[what][IDLE]).all()


@pytest.mark.slow
def test_controls_found_fly_into_the_goal_set(comparison):
    """Flown by the engine, not by the search; the same definition judges the contestants."""

    found = [c for c in comparison.certified if c.commands is not None]
    assert found
    for answer in found:
        commands = np.array(answer.commands, dtype=float)
        flight = fly(
            CONTEST.craft,
            CONTEST.task,
            Played(commands[:, None]),
            CONTEST.start(answer.start),
            Timing(episode_steps=len(commands)),
        )
        assert arrived(flight.task, flight.states, flight.goals)[-1, 0]
        spent = 0.2 * commands.sum() if answer.horizon else 0.2 * len(commands)
        assert spent == pytest.approx(answer.upper)


@pytest.mark.slow
def test_relaxed_optima(comparison):
    """Replayed in Drake to the millimetre; what may throttle earns more than what may not."""
    solved = [all(row.solved for row in rows) for rows in comparison.relaxed.values()]
    assert (
        solved == [True] * 3
    )  # least time, least fuel by 3 s, greatest reward: later leaves no time to settle
    errors = [
        row.replay_error for rows in comparison.relaxed.values() for row in rows if row.solved
    ]
    assert max(errors) < 1e-3
    best = best_returns(comparison)
    for entry in comparison.entries:
        assert (entry.returns < best).all()


@pytest.mark.usefixtures("undrawn")
def test_interrupt_keeps_what_is_finished(monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("rans_bounds.transfers.certified_bounds", interrupted)
    monkeypatch.setattr("rans_optimal.relaxed.objectives", lambda *_: [])
    found = Comparison(CONTEST)
    with pytest.raises(KeyboardInterrupt):
        found.fly(enlisted(["lqr:go-to-pose-2d"], CONTEST), ["optimal"])
    assert [entry.name for entry in found.entries] == ["LQR"]
    assert "solves its task from 3 of 3 starts" in page(found).html()


def test_nobody_flies_twice_and_names_differ(monkeypatch):
    found = Comparison(replace(CONTEST, episodes=1, timing=Timing(episode_steps=3)))
    thrice = ["lqr:go-to-pose-2d", "lqr:go-to-pose-2d", "lqr:go-to-pose-2d@floating-platform"]
    found.fly(enlisted(thrice, found.contest), ["lqr"])
    assert [entry.name for entry in found.entries] == ["LQR", "lqr:go-to-pose-2d@floating-platform"]
    assert found.failures == []


def test_a_flight_below_a_bound_is_named_however_little():
    """Bounds of settling count up to the instant after which no flight is seen to leave the tolerances."""
    task = CONTEST.task
    entry = Entry(
        Contestant("x", LQR(CONTEST.craft, task), "", ""),
        flight_of(np.array([[1.0, 0.5, 0.04, *[0.01] * 27]]).T, 0.0, task=task),
    )
    times: dict[Kind, float] = {"arrival": 1.0, "settling": 1.0}
    for kind, time in times.items():
        for more, named in ((-1e-6, 0), (1e-6, 1)):
            found = Comparison(CONTEST, [entry], certified=[Bound(0, None, time + more, kind=kind)])
            found.__dict__["least_time"] = CONTEST.duration
            assert len(found.impossible()) == named
    late = [Bound(0, None, 100.0, kind=kind) for kind in times]
    found = Comparison(CONTEST, [entry], certified=late)
    assert found.bounds(Event())[0] == [100.0]
    (settling,) = found.bounds(Event("settling"))[0]
    # The platform brakes and comes back within 10 cm in about 1 s.
    assert CONTEST.duration - 2.0 < settling < CONTEST.duration
