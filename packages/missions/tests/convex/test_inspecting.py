"""Cheap inspections, replayed with thrust of whole periods by matrix exponentials, and against the lower bound."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from rans_missions.convex.inspecting import Burns, InspectionSearch
from rans_missions.convex.inspection import inspection_bound
from rans_missions.convex.rendezvous import state_of
from rans_missions.tasks import Inspect

from rans.episode.scenario import each, scenarios
from rans.model.spacecraft_file import load_spacecraft
from tests.support.clohessy_wiltshire import transition

DEPUTY = load_spacecraft("afrl-deputy")
MASS = 12.0
WITHIN = 6_000.0
STARTS: list[Any] = list(each(scenarios(Inspect(), DEPUTY, seed=5, count=4)))


def searched(
    task: Inspect, start: Any, is_safe: Callable[[Burns], bool] = lambda burns: True
) -> Burns:
    """What the search finds from the flight without a burn, and from its reflections."""
    known = np.zeros(task.points, bool)
    sun = float(start.goal.notes.sun)
    search = InspectionSearch(
        task, task.timing, state_of(start)[None], sun, known, WITHIN, 20.0 / MASS
    )
    found = search.best([search.coast, -search.coast, search.coast * [1, 1, -1]], is_safe)
    assert found is not None
    return found


def test_flights_that_are_found_inspect_at_little_more_than_the_bound():
    """All of 20 points: seen at the time that the search says, and not before, outside of the ball."""
    task = Inspect(points=20)
    normals = np.array(task.normals)
    move = transition(task.mean_motion, 10.0)
    for start in (STARTS[0], STARTS[1], STARTS[3]):
        burns = searched(task, start)
        x = state_of(start)
        seen = np.zeros(20, bool)
        finish = np.inf
        nearest = np.inf
        for check in range(1, int(WITHIN / 10.0) + 1):
            pushes = burns.changes[0, burns.periods == (check - 1) // 2].sum(axis=0) / 20.0
            x = (move @ np.concatenate([x, pushes]))[:6]
            angle = float(start.goal.notes.sun) - task.mean_motion * 10.0 * check
            lit = normals @ [np.cos(angle), np.sin(angle), 0.0] > 0.0
            seen |= lit & (normals @ x[:3] > 10.0)
            nearest = min(nearest, float(np.linalg.norm(x[:3])))
            if seen.all():
                finish = 10.0 * check
                break
        # The search sees at every second check.
        assert finish <= burns.finish < finish + 20.0
        assert nearest > 15.0
        spent = MASS * float(np.abs(burns.changes).sum())
        bound = inspection_bound(DEPUTY, task, start.start, start.goal, WITHIN, task.timing)
        # The bound sees one point, these flights all.
        assert bound <= spent < 1.1 * bound


def test_a_start_whose_coast_inspects_enough_needs_no_burn():
    task = Inspect(points=1)
    burns = searched(task, STARTS[0])
    assert burns.price == 0.0
    assert len(burns.periods) == 0
    assert burns.finish == 20.0


def test_the_cheapest_safe_flight_is_flown_and_else_the_cheapest():
    task = Inspect(points=20)
    cheapest = searched(task, STARTS[2]).price
    dearer = searched(task, STARTS[2], lambda burns: burns.price > 1.01 * cheapest).price
    assert 1.01 * cheapest < dearer < 1.2 * cheapest
    assert searched(task, STARTS[2], lambda burns: False).price == cheapest


def test_half_of_the_points_are_those_that_cost_little():
    """Inspecting 11 of 20 points may choose them, and costs less than half of inspecting all."""
    whole, half = (
        searched(Inspect(points=20, unseen_tolerance=tolerance), STARTS[1]).price
        for tolerance in (0.01, 0.5)
    )
    assert half < 0.5 * whole
