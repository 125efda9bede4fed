"""Circumnavigation of a target: near its bound, far past the end, and in teams."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rans_missions.control import circumnavigation
from rans_missions.control.circumnavigation import Circumnavigation
from rans_missions.convex.inspecting import Burns
from rans_missions.convex.inspection import inspection_bound
from rans_missions.tasks import Inspect
from rans_missions.tasks.inspect import Inspected
from rans_missions.team.task import InspectTeam

from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.episode.step import Setup
from rans.evaluation.measure.metrics import impulses, won
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3, map_leaves
from rans.model.spacecraft_file import load_spacecraft
from tests.support.past_the_end import flown_on

DEPUTY = load_spacecraft("afrl-deputy")
TASK = Inspect()
END = 12_240.0
"""Length of an episode, s."""
STARTS = scenarios(TASK, DEPUTY, seed=70, count=4)


@pytest.mark.slow
def test_a_cheap_inspection_is_found_and_left_to_a_safe_orbit() -> None:
    """From every start near the bound: plans of two burns onto an orbit around the target are at 1.56 of it."""
    flight = fly(DEPUTY, TASK, Circumnavigation(DEPUTY, TASK), STARTS, TASK.timing)
    assert won(flight).all()
    spent = impulses(flight)
    both: Any = (STARTS.start, STARTS.goal)
    bounds = []
    for k in range(4):
        start, goal = map_leaves(lambda x, k=k: float(x[k]) if np.ndim(x) else x, both)
        bounds.append(inspection_bound(DEPUTY, TASK, start, goal, END, TASK.timing))
    assert np.all(spent >= bounds)
    assert spent.mean() < 1.35 * np.mean(bounds)
    # It keeps its distances long after, when nothing needs to be done.
    setup = Setup(DEPUTY, TASK, TASK.timing)
    continued = flown_on(setup, Circumnavigation(DEPUTY, TASK), STARTS, END + 5_000.0)
    assert continued.margin.min() > 0.0
    assert continued.after(END + 4_000.0).change.sum(axis=0).max() < 0.01


def test_a_team_flies_dearer_burns_if_their_coasts_alone_keep_apart(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Abreast of each other both coast through one point within a quarter of an orbit, unless one leaves."""

    def burns(price: float, away: float) -> Burns:
        changes = np.zeros((2, 1, 3))
        changes[:, 0] = [[away, 0.0, 0.0], [0.0, 0.0, 0.01]]
        return Burns(price, np.array([0]), changes, 5_000.0)

    class Searches:
        """Stand-in of a planner: its flights meet one another, except the dearest of the longest search."""

        earliest = 1_000.0
        coast = times = None

        def __init__(self, *settings: Any) -> None:
            is_whole = settings[5] == END
            self._flights = [burns(1.0, 0.0), burns(3.0, 0.05)] if is_whole else [burns(2.0, 0.0)]

        def best(self, paths: Any, is_safe: Any = lambda one: True) -> Burns:
            return next(filter(is_safe, self._flights), self._flights[0])

    monkeypatch.setattr(circumnavigation, "InspectionSearch", Searches)
    monkeypatch.setattr(Circumnavigation, "_beginnings", lambda *_: [])
    zero = np.zeros(2)
    still = Vec3(zero, zero, zero)
    level = Quat(zero + 1.0, zero, zero, zero)
    state = SpatialState(Vec3(zero, zero - 40.0, np.array([0.0, 30.0])), level, still, still)
    seen = Inspected(zero, zero, tuple(np.zeros((5, 2))))
    pilot = Circumnavigation(DEPUTY, InspectTeam(deputies=2))
    pilot.reset(2)
    change, _ = pilot.velocity_change(state, SpatialState(still, level, still, still, seen), 0.0)
    assert change[0, 0] == pytest.approx(0.05, abs=0.005)
