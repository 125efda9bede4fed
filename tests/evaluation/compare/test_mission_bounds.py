"""Bounds of missions on an orbit beside the flights of a comparison, and their figures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rans.evaluation.compare.contest import Contest, Contestant, Entry
from rans.evaluation.compare.mission_bounds import (
    MissionBounds,
    bounded,
    mission_bounds,
    steps_of,
)
from rans.evaluation.measure.metrics import impulses
from rans.model.spacecraft_file import load_spacecraft
from rans.optimal.control.mission_guidance import MissionGuidance
from rans.randomization.conditions import Conditions
from rans.show.figures.mission_figures import (
    margins_over_time,
    orbital_plane,
    spent_over_time,
)
from rans.tasks import Dock, GoToPose
from tests.support.comparisons import points

CRAFT = load_spacecraft("afrl-deputy")
TASK = Dock(deadline=(600.0, 700.0)).for_evaluation()
CONTEST = Contest(CRAFT, TASK, TASK.timing, seed=5, episodes=2)


@pytest.fixture(scope="module")
def entry() -> Entry:
    guidance = MissionGuidance(CRAFT, TASK)
    flight, _ = CONTEST.fly(guidance, workers=1)
    return Entry(Contestant("mission", guidance, "state", "none"), flight, np.zeros(1))


@pytest.mark.slow
def test_no_flight_is_below_the_bound_and_more_time_needs_no_more_impulse(entry: Entry) -> None:
    reported = 0

    def count(units: int) -> None:
        nonlocal reported
        reported += units

    found = mission_bounds(CONTEST, 2, count)
    assert reported == steps_of(CONTEST, 2)
    ratios = found.ratios(entry)
    assert ratios.shape == (2,)
    assert np.all((ratios > 1.0) & (ratios < 1.3))
    # Each bound is found on its own, to 0.2 %.
    assert np.all(np.diff(found.front) < 0.002 * found.front[:-1])


def test_ratios_are_of_flights_that_succeeded(entry: Entry) -> None:
    spent = impulses(entry.flight)
    found = MissionBounds(0.5 * spent, np.array([300.0, 600.0]), np.array([np.inf, 1.0]))
    assert found.ratios(entry) == pytest.approx([2.0, 2.0])
    assert "mission 2.000" in found.sentence([entry])
    assert found.to_json()["front"] == [None, 1.0]
    assert found.impossible([entry]) == []
    wrong = replace(found, lower=1.01 * spent)
    assert len(wrong.impossible([entry])) == 1


def test_other_contests_have_none() -> None:
    assert bounded(CONTEST)
    assert not bounded(Contest(CRAFT, TASK, TASK.timing, 5, 2, conditions=Conditions()))
    platform = load_spacecraft("floating-platform")
    pose = GoToPose()
    assert not bounded(Contest(platform, pose, pose.timing, 5, 2))


def test_figures_show_paths_margins_and_what_is_impossible(entry: Entry) -> None:
    (axes,) = orbital_plane([entry]).axes
    path = np.array(points(axes)["mission"])
    p = entry.flight.states.p
    assert path[0] == pytest.approx([p.y[0, 0], p.x[0, 0]])  # along the track, then radially
    (margins,) = margins_over_time([entry]).axes
    least = np.array(points(margins)["mission"])[:, 1]
    assert np.nanmin(least) == pytest.approx(
        min(margin.min() for margin in entry.flight.margins.values())
    )
    bounds = MissionBounds(np.ones(1), np.array([300.0, 600.0]), np.array([np.inf, 1.0]))
    (front,) = spent_over_time([entry], bounds).axes
    (marker,) = (line for line in front.get_lines() if line.get_label() == "mission")
    assert marker.get_ydata() == pytest.approx(impulses(entry.flight)[:1])
