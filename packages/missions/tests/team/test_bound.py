"""Bound of a team, against divisions that are tried one by one, and attacked by flights that programs find."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from rans_missions.convex.inspecting import InspectionSearch
from rans_missions.convex.rendezvous import state_of
from rans_missions.team.bound import _divided, team_bound
from rans_missions.team.task import InspectTeam

from rans.episode.scenario import scenarios
from rans.model.fields import map_leaves
from rans.model.spacecraft_file import load_spacecraft

DEPUTY = load_spacecraft("afrl-deputy")
MASS = 12.0


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
