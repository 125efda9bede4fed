"""Bound of a team, against divisions that are tried one by one, and attacked by flights that programs find."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_missions.convex.inspecting import InspectionSearch
from rans_missions.convex.rendezvous import state_of
from rans_missions.team.bound import _divided, _Stay, team_bound
from rans_missions.team.task import InspectTeam

from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3, map_leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import scenarios
from tests.support.clohessy_wiltshire import transition

DEPUTY = load_spacecraft("afrl-deputy")
MASS = 12.0


@pytest.mark.parametrize("seed", range(20))
def test_the_cheapest_division_is_that_of_all_divisions(seed: int) -> None:
    """Six points, of which four are asked; each of three deputies pays for the dearest that it sees."""
    rng = np.random.default_rng(seed)
    prices = rng.uniform(0.0, 1.0, (3, 6)).round(1)
    least = rng.uniform(0.0, 0.5, 3)
    best = math.inf
    for points in itertools.combinations(range(6), 4):
        for who in itertools.product(range(3), repeat=4):
            spent = least.copy()
            for point, deputy in zip(points, who, strict=True):
                spent[deputy] = max(spent[deputy], prices[deputy, point])
            best = min(best, spent.sum())
    assert _divided(prices, list(least), 4, math.inf) == pytest.approx(best, abs=1e-12)


def test_no_flight_that_programs_find_is_cheaper_than_the_bound() -> None:
    """Three deputies from three starts, at ends of many times; the cheapest ones are near the bound."""
    task = InspectTeam()
    starts: Any = scenarios(task, DEPUTY, seed=2023, count=9)
    ratios = []
    for k in range(0, 9, 3):
        team = [map_leaves(lambda x, j=j: float(x[j]), starts) for j in range(k, k + 3)]
        motion = np.array([state_of(one) for one in team])
        sun, known = float(team[0].goal.notes.sun), np.zeros(100, bool)
        bound = team_bound(
            DEPUTY, task, [one.start for one in team], team[0].goal, 4_000.0, task.timing
        )
        best = math.inf
        for within in (2_800.0, 2_900.0, 3_000.0, 3_200.0, 4_000.0):
            search = InspectionSearch(
                task, task.timing, motion, sun, known, within, 20.0 / MASS, 0.0, 0.0, 10.0
            )
            burns = search.best([search.coast], 0)
            best = best if burns is None else min(best, MASS * burns.price)
        assert best >= bound
        if best < math.inf:
            ratios.append((bound, best))
    bounds, found = np.sum(ratios, axis=0)
    assert len(ratios) >= 2
    assert found < 1.5 * bounds


@pytest.mark.parametrize("is_uneven", [False, True])
def test_to_stay_costs_no_more_than_any_flight_that_stays(is_uneven: bool) -> None:
    """A deputy 100 m above the target drifts 800 m away; brakes at any time that keep it in cost at least that.

    The uneven one has four thrusters, one of them against its drift.
    """
    height, side = math.sqrt(8.0) / 3.0, math.sqrt(2.0) / 3.0
    ways = [(height, 1 / 3, 0.0), *((-side, 1 / 3, x * math.sqrt(3.0) * side) for x in (1.0, -1.0))]
    thrusters = [replace(DEPUTY.thrusters[0], direction=x) for x in ((0.0, -1.0, 0.0), *ways)]
    thrusters = [replace(x, position=(0.0, 0.0, 0.0)) for x in thrusters]
    craft = replace(DEPUTY, thrusters=tuple(thrusters)) if is_uneven else DEPUTY
    task = InspectTeam()
    level, still = Quat(1.0, 0.0, 0.0, 0.0), Vec3(0.0, 0.0, 0.0)
    start = SpatialState(Vec3(100.0, 0.0, 0.0), level, still, still)
    stay = _Stay(craft, task, start, 3_000.0, task.timing).price(300)
    assert stay > 0.1
    move = transition(task.mean_motion, 10.0)[:6, :6]
    changes = np.linspace(0.0, -0.3, 61)
    cheapest = math.inf
    for begin in range(0, 200, 5):
        x = np.repeat([[100.0, 0.0, 0.0, 0.0, 0.0, 0.0]], len(changes), axis=0)
        farthest = np.zeros(len(changes))
        for check in range(300):
            x[:, 4] += changes if check == begin else 0.0
            x = x @ move.T
            farthest = np.maximum(farthest, np.linalg.norm(x[:, :3], axis=1))
        inside = farthest <= 800.0
        if inside.any():
            cheapest = min(cheapest, MASS * float(np.abs(changes[inside]).min()))
    assert stay <= cheapest < 1.2 * stay
