"""Certificates beside every firing sequence of a small instance."""

from __future__ import annotations

from typing import Any

import pytest

from rans.optimal.certificate.certificate import (
    bounder,
    certified_least_fuel,
    certified_least_time,
)
from rans.optimal.certificate.goal_set import GoalSet
from rans.optimal.certificate.problem import Problem, SearchEffort
from tests.support.tiny_lattice import PERIOD, fly_everything, instance, lopsided


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_one_start_is_as_good_as_every_firing_sequence(seed: int) -> None:
    """All 2^10 of a craft of five thrusters in two periods: some arrive, none after one."""
    craft = lopsided()
    loose = GoalSet()
    names = ("position", "velocity", "heading", "spin")
    start, goal, flown = instance(craft, 2, seed)
    assert not fly_everything(craft, start, 1).arrived(goal, loose, names).any()
    arrived = flown.arrived(goal, loose, names)
    problem = Problem(start, goal, loose, {"position", "attitude", "velocity", "spin"})
    solvers: dict[Any, float] = {
        certified_least_time: 2 * PERIOD,
        certified_least_fuel: float(flown.fuel[arrived].min()),
    }
    for solve, value in solvers.items():
        found = solve(bounder(craft, PERIOD), problem, 2, SearchEffort(0.3))
        assert found.lower <= value + 1e-9  # rounding of sums of pulses
        assert found.upper == pytest.approx(value, abs=1e-9)
