"""Bound of a team, against divisions that are tried one by one, and attacked by flights that programs find."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_missions.convex.inspecting import InspectionSearch
from rans_missions.convex.inspection import point_prices
from rans_missions.convex.rendezvous import state_of
from rans_missions.tasks.inspect import Inspected
from rans_missions.team.bound import _divided, _Stay, team_bound
from rans_missions.team.task import InspectTeam
from scipy.optimize import linprog

from rans.episode.scenario import scenarios
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3, map_leaves
from rans.model.spacecraft_file import load_spacecraft
from tests.support.clohessy_wiltshire import transition

DEPUTY = load_spacecraft("afrl-deputy")
MASS = 12.0
STILL = Vec3(0.0, 0.0, 0.0)
LEVEL = Quat(1.0, 0.0, 0.0, 0.0)
GOAL: Any = SpatialState(STILL, LEVEL, STILL, STILL, notes=Inspected(0.5, 0.0, ()))


@pytest.mark.parametrize("seed", range(20))
def test_the_cheapest_division_is_that_of_all_divisions(seed):
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


def test_no_flight_that_programs_find_is_cheaper_than_the_bound():
    """Three deputies from two starts, at ends of many times; the cheapest ones are near the bound."""
    task = InspectTeam()
    starts: Any = scenarios(task, DEPUTY, seed=2023, count=9)
    ratios = []
    for k in (3, 6):
        team = [map_leaves(lambda x, j=j: float(x[j]), starts) for j in range(k, k + 3)]
        motion = np.array([state_of(one) for one in team])
        sun, known = float(team[0].goal.notes.sun), np.zeros(100, bool)
        bound = team_bound(
            DEPUTY, task, [one.start for one in team], team[0].goal, 4_000.0, task.timing
        )
        best = math.inf
        for within in (2_800.0, 2_900.0, 3_000.0, 3_200.0, 4_000.0):
            search = InspectionSearch(task, task.timing, motion, sun, known, within, 20.0 / MASS)
            burns = search.best([search.coast])
            best = best if burns is None else min(best, MASS * burns.price)
        assert best >= bound
        if best < math.inf:
            ratios.append((bound, best))
    bounds, found = np.sum(ratios, axis=0)
    assert len(ratios) == 2
    assert found < 1.4 * bounds


@pytest.mark.parametrize("is_uneven", [pytest.param(False, marks=pytest.mark.slow), True])
def test_a_stay_with_a_point_costs_no_more_than_programs_find(is_uneven):
    """A deputy that drifts away and burns every 100 s stays in a prism inside the zone and sees one point.

    The uneven one has four thrusters, one of them against its drift.
    """
    height, side = math.sqrt(8.0) / 3.0, math.sqrt(2.0) / 3.0
    ways = [(height, 1 / 3, 0.0), *((-side, 1 / 3, x * math.sqrt(3.0) * side) for x in (1.0, -1.0))]
    thrusters = [replace(DEPUTY.thrusters[0], direction=x) for x in ((0.0, -1.0, 0.0), *ways)]
    thrusters = [replace(x, position=(0.0, 0.0, 0.0)) for x in thrusters]
    craft = replace(DEPUTY, thrusters=tuple(thrusters)) if is_uneven else DEPUTY
    task = InspectTeam()
    start = SpatialState(Vec3(100.0, 0.0, 0.0), LEVEL, STILL, STILL)
    stay = _Stay(craft, task, start, GOAL, 3_000.0, task.timing)
    proof = stay.proof(300)
    alone = point_prices(craft, task, start, GOAL, 3_000.0, task.timing)[-1]
    both = stay.with_points(proof, alone, 300, math.inf)
    moves = np.array([transition(task.mean_motion, 100.0 * k)[:3, :6] for k in range(31)])
    pushes = np.array([thruster.direction for thruster in craft.thrusters]).T / MASS
    burns = np.zeros((31, 3, 30, len(craft.thrusters)))
    for check, burn in zip(*np.tril_indices(31, -1), strict=True):
        burns[check, :, burn] = moves[check - burn, :, 3:] @ pushes
    burns = burns.reshape(31, 3, -1)
    free = moves @ [100.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    # The base has 16 sides, at 784 m from the centre at most; the height is 150 m either way.
    angles = np.arange(16) * math.pi / 8.0
    sides = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1) / 784.0
    sides = np.vstack([sides, [0.0, 0.0, 1.0 / 150.0], [0.0, 0.0, -1.0 / 150.0]])
    ratios = []
    for point in range(0, 100, 20):
        normal = np.array(task.normals[point])
        best = math.inf
        for check in range(1, 31):
            angle = 0.5 - task.mean_motion * 100.0 * check
            if normal @ [math.cos(angle), math.sin(angle), 0.0] <= 0.0:
                continue
            found = linprog(
                np.ones(burns.shape[2]),
                A_ub=np.vstack([*(sides @ burns), -normal @ burns[check]]),
                b_ub=np.append(1.0 - free @ sides.T, normal @ free[check] - 10.0),
            )
            best = min(best, found.fun)
        ratios.append(both[point] / best)
    assert max(ratios) <= 1.0
    assert np.median(ratios) > 0.75
    assert (both > np.maximum(alone, proof.price) * 1.05).sum() >= 10
