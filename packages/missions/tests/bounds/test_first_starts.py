"""Bounds of missions on an orbit beside the flights of a comparison, and their figures."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from rans_missions.bounds import first_starts, zones
from rans_missions.bounds.first_starts import bounded, mission_bounds
from rans_missions.bounds.mission_bounds import MissionBounds
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.tasks import Avoid, Dock, FinalApproach, Inspect

from rans import Conditions
from rans.evaluation.compare.contest import Contest, Contestant, Entry
from rans.evaluation.compare.run import Comparison
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.measure.metrics import impulses
from rans.model.drift import UniformGravity
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


def test_an_interrupted_comparison_has_the_bounds_that_were_known(monkeypatch):
    task = Inspect()
    contest = Contest(CRAFT, task, replace(task.timing, episode_steps=100), seed=5, episodes=3)
    lower = iter([2.0])

    def interrupted(*_: object) -> float:
        for known in lower:
            return known
        raise KeyboardInterrupt

    monkeypatch.setattr(first_starts, "inspection_bound", interrupted)
    comparison = Comparison(contest)
    with pytest.raises(KeyboardInterrupt):
        comparison.fly({}, ["optimal"], certified=2, workers=1)
    assert comparison.mission is not None
    assert comparison.mission.lower.shape == (1,)
    assert comparison.notes


def test_other_contests_have_none_and_say_why():
    assert bounded(CONTEST)
    assert not bounded(Contest(CRAFT, TASK, TASK.timing, 5, 2, conditions=Conditions()))
    burning = Contest(load_spacecraft("mars-lander-steered"), Avoid(), Avoid.timing, 5, 2)
    moving = Contest(load_spacecraft("free-flyer"), Avoid(), Avoid.timing, 5, 2)
    assert bounded(moving)
    start = moving.starts.start
    vars(moving)["starts"] = replace(moving.starts, start=replace(start, v=start.p))
    task = type("Falling", (Avoid,), {"drift": UniformGravity((0.1, 0.0))})()
    falling = Contest(load_spacecraft("floating-platform"), task, Avoid.timing, 5, 2)
    for contest, why in ((burning, "has propellant"), (moving, "rest"), (falling, "of Avoid")):
        comparison = Comparison(contest)
        comparison.fly({}, ["optimal"], certified=1, workers=1)
        (note,) = comparison.notes
        assert re.match(f"No bound is certified: .*{why}", note)
        assert not comparison.failures


@pytest.mark.parametrize("name", ["avoid-2d", "dock-port-2d"])
def test_flights_among_zones_and_to_ports_stand_beside_their_bounds(name, monkeypatch):
    """Also where a flight lasts to the end of its episode."""
    monkeypatch.setattr(zones, "_PROGRAMS", 10)
    run = contestant(f"pretrained:{name}")
    comparison = Comparison(Contest(run.craft, run.task.for_evaluation(), run.timing, 5, 1))
    agent = Contestant("agent", run.controller, "observation", "none")
    comparison.fly({"agent": agent}, ["optimal"], certified=1, workers=1)
    assert not comparison.failures
    (score,) = scoreboard(comparison).values()
    assert 1.0 < score["impulse over the bound"].value < 100.0


def test_a_final_approach_has_a_bound_of_each_start():
    """From 15 m it is more than nothing, and less than two burns on the way to the port spend."""
    chaser = load_spacecraft("vbar-chaser")
    task = FinalApproach(spawn_distance=(14.0, 16.0)).for_evaluation()
    contest = Contest(chaser, task, replace(task.timing, episode_steps=65), seed=5, episodes=1)
    reported = []
    (found,) = mission_bounds(contest, 1, reported.append)
    assert sum(reported) == 1
    # 13 m in 325 s are 0.04 m/s of 500 kg, and as much along the second axis at most.
    assert 0.04 * 500.0 < found.lower[0] < 4.0 * 0.04 * 500.0


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
