"""Bounds of missions on an orbit beside the flights of a comparison, and their figures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rans_missions.bounds import first_starts
from rans_missions.bounds.first_starts import bounded, mission_bounds
from rans_missions.bounds.mission_bounds import MissionBounds
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.tasks import Dock, FinalApproach, Inspect

from rans import Conditions, GoToPose
from rans.evaluation.compare.contest import Contest, Contestant, Entry
from rans.evaluation.compare.run import Comparison
from rans.evaluation.measure.metrics import impulses
from rans.model.spacecraft_file import load_spacecraft
from rans.show.pages.report import comparison_section
from rans.show.tables.comparison_tables import differences, outcome, scoreboard, to_json

CRAFT = load_spacecraft("afrl-deputy")
TASK = Dock(deadline=(600.0, 700.0)).for_evaluation()
CONTEST = Contest(CRAFT, TASK, TASK.timing, seed=5, episodes=2)


@pytest.fixture(scope="module")
def entry() -> Entry:
    guidance = MissionGuidance(CRAFT, TASK)
    flight = CONTEST.fly(guidance, workers=1)
    return Entry(Contestant("mission", guidance, "state", "none"), flight)


@pytest.mark.slow
def test_no_flight_is_below_the_bound(entry):
    reported = 0

    def count(units):
        nonlocal reported
        reported += units

    *_, found = mission_bounds(CONTEST, 2, count)
    assert reported == 2
    ratios = found.ratios(entry)
    assert ratios.shape == (2,)
    assert np.all((ratios > 1.0) & (ratios < 1.3))


def test_an_interrupted_comparison_has_the_bounds_that_were_known(monkeypatch):
    task = Inspect()
    contest = Contest(CRAFT, task, replace(task.timing, episode_steps=100), seed=5, episodes=3)
    lower = first_starts._lower

    def interrupted(contest: Contest, k: int) -> float:
        if k == 1:
            raise KeyboardInterrupt
        return lower(contest, k)

    monkeypatch.setattr(first_starts, "_lower", interrupted)
    comparison = Comparison(contest)
    with pytest.raises(KeyboardInterrupt):
        comparison.fly({}, ["optimal"], certified=2, workers=1)
    assert comparison.mission is not None
    assert comparison.mission.lower.shape == (1,)
    assert comparison.notes


def test_other_contests_have_none():
    assert bounded(CONTEST)
    assert not bounded(Contest(CRAFT, TASK, TASK.timing, 5, 2, conditions=Conditions()))
    platform = load_spacecraft("floating-platform")
    pose = GoToPose()
    assert not bounded(Contest(platform, pose, pose.timing, 5, 2))


def test_a_final_approach_has_a_bound_of_each_start():
    """From 15 m it is more than nothing, and less than two burns on the way to the port spend."""
    chaser = load_spacecraft("vbar-chaser")
    task = FinalApproach(spawn_distance=(14.0, 16.0)).for_evaluation()
    contest = Contest(chaser, task, replace(task.timing, episode_steps=65), seed=5, episodes=1)
    reported = []
    (found,) = mission_bounds(contest, 1, reported.append)
    assert bounded(contest)
    assert sum(reported) == 1
    # 13 m in 325 s are 0.04 m/s of 500 kg, and as much along the second axis at most.
    assert 0.04 * 500.0 < found.lower[0] < 4.0 * 0.04 * 500.0
    # Conditions are not in the bound.
    assert not bounded(replace(contest, conditions=Conditions()))


@pytest.mark.slow
def test_a_mission_that_ends_is_scored_by_its_success(entry):
    """Both flights dock; in a copy the first breaks the speed limit on the way, and has not won."""
    flight = entry.flight
    broken = {name: margin.copy() for name, margin in flight.margins.items()}
    broken["speed"][3, 0] = -0.01
    wild = Entry(
        Contestant("wild", entry.contestant.controller, "state", "none"),
        replace(flight, margins=broken),
    )
    bounds = MissionBounds(0.5 * impulses(flight))
    comparison = Comparison(CONTEST, [entry, wild], mission=bounds)
    board = scoreboard(comparison)
    times = flight.lengths * 10.0
    row = board["mission"]
    assert row["mission won, %"].value == 100.0
    assert row["limit broken, %"].value == 0.0
    assert times.min() <= row["time of success, s"].value <= times.max()
    assert row["impulse of successes, N s"].value == pytest.approx(impulses(flight).mean())
    assert row["impulse over the bound"].value == pytest.approx(2.0)
    assert row["impulse over the bound, worst"].value == pytest.approx(2.0)
    (*_, gap) = comparison_section(to_json(comparison, "")).facts
    assert (gap.what, gap.value[:3]) == ("gap of mission: impulse", "2.0")
    row = board["wild"]
    assert row["mission won, %"].value == 50.0
    assert row["limit broken, %"].value == 50.0
    assert row["impulse of successes, N s"].value == pytest.approx(impulses(flight)[1])
    # Errors of the last fifth of an episode say nothing of flights that ended before.
    assert not any("error" in name or "settl" in name for name in row)
    assert differences(comparison)["wild"]["time of success, s"].high == np.inf
    settled = [one["solved"] for one in outcome(comparison, board)["summary"]]
    assert settled == [2, 1]
    assert "did not succeed" in bounds.table([wild])[1][0]
    first = np.asarray(CONTEST.starts.goal.notes.deadline)
    assert f"deadlines of {first.min():,.0f} to {first.max():,.0f} s" in CONTEST.title()
