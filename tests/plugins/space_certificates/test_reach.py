"""The on/off bound in space: below every firing sequence, closer than the hull, refused where it fails."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_bounds import hull
from rans_bounds.certificate import certified_least_fuel, certified_least_time
from rans_bounds.goal_set import GoalSet
from rans_bounds.problem import Problem, SearchEffort
from rans_space_certificates.bounder import SpatialBounder
from rans_space_certificates.reach import ReachRelaxation, SpinLattice

from rans import Spacecraft, Thruster
from rans.model.fields import Vec3, map_leaves
from tests.support.space_reach import (
    PERIOD,
    POSE,
    craft_with,
    lopsided,
    moving,
    near,
)
from tests.support.tiny_lattice import fly_everything

LOOSE = GoalSet(0.02, 0.02, 0.05, 0.1)


def equal() -> Spacecraft:
    """Four nozzles of 1 N, one of them through the centre: pulses, but no parity."""
    return craft_with(
        "equal",
        (
            Thruster((0.3, 0.0, 0.1), (0.0, 1.0, 0.0), 1.0),
            Thruster((-0.3, 0.0, 0.1), (0.0, 1.0, 0.0), 1.0),
            Thruster((0.0, 0.1, 0.3), (0.0, -0.6, -0.8), 1.0),
            Thruster((0.0, 0.0, 0.2), (0.0, 0.0, 1.0), 1.0),
        ),
    )


def crossed() -> Spacecraft:
    """Four equal nozzles, each of one quantum, about two axes: parity."""
    return craft_with(
        "crossed",
        (
            Thruster((0.2, 0.0, 0.1), (0.0, 1.0, 0.0), 1.0),
            Thruster((-0.2, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0),
            Thruster((0.0, 0.2, 0.0), (0.0, 0.0, 1.0), 1.0),
            Thruster((0.0, -0.2, 0.0), (0.0, 0.0, 1.0), 1.0),
        ),
    )


CRAFTS = {"lopsided": lopsided, "crossed": crossed}


def instance(
    craft: Spacecraft, steps: int, seed: int, spin: float = 0.0
) -> tuple[Any, Any, np.ndarray, Any]:
    """A moving start, a goal that some sequence just reaches, all fuels and all final states."""
    start = moving(seed, spin)
    flown = fly_everything(craft, start, steps, substeps=4)
    spent = flown.fuel
    final = flown.final
    pick = np.random.default_rng(seed).integers(len(spent))
    end = map_leaves(lambda x: float(x[pick]), final)
    goal = replace(end, p=end.p + Vec3(0.004, -0.003, 0.005), w=Vec3(0.0, 0.0, 0.0))
    return start, goal, spent, final


def _paid(
    craft: Spacecraft, spent: Any, final: Any, goal: Any, velocity: np.ndarray, position: np.ndarray
) -> Any:
    """The Lagrangian of flights, whose tolerances are granted."""
    off = [np.array((getattr(final, name) - getattr(goal, name)).columns()) for name in ("v", "p")]
    spared = LOOSE.velocity * np.linalg.norm(velocity) + LOOSE.position * np.linalg.norm(position)
    return spent - craft.mass * (velocity @ off[0] + position @ off[1] + spared)


@pytest.mark.parametrize(
    ("name", "seed", "spin"),
    [
        pytest.param("lopsided", 1, 0.7, marks=pytest.mark.slow),
        ("crossed", 2, 0.0),
        ("crossed", 3, 0.3),
    ],
)
def test_no_sequence_costs_less_than_any_costate_says(name, seed, spin):
    """Every one of 4,096 that ends in the goal's attitude, wherever else, pays its Lagrangian at least."""
    craft = CRAFTS[name]()
    steps = 3
    start, goal, spent, final = instance(craft, steps, seed, spin)
    close = near(final, goal, LOOSE.heading)
    assert close.any()
    relaxation = ReachRelaxation(SpinLattice(craft, PERIOD), POSE, start, goal, LOOSE, steps)
    for size in 3.0 ** np.arange(-4, 8):
        velocity, position = np.random.default_rng(seed + 10).normal(size=(2, 3)) * size
        paid = _paid(craft, spent, final, goal, velocity, position)
        assert relaxation.bound(velocity, position) <= paid[close].min()


@pytest.mark.slow
@pytest.mark.parametrize(("build", "seed"), [(lopsided, 4), (equal, 5), (crossed, 4)])
def test_least_fuel_and_time_are_below_those_of_every_sequence(build, seed):
    craft = build()
    steps = 3
    start, goal, spent, final = instance(craft, steps, seed)
    errors = [
        np.linalg.norm((getattr(final, x) - getattr(goal, x)).columns(), axis=0) for x in ("p", "v")
    ]
    inside = (
        near(final, goal, LOOSE.heading)
        & (errors[0] <= LOOSE.position)
        & (errors[1] <= LOOSE.velocity)
    )
    least = float(spent[inside].min())
    lattice = SpinLattice(craft, PERIOD)
    effort = SearchEffort(1e-9)
    found = certified_least_fuel(
        SpatialBounder(lattice), Problem(start, goal, LOOSE, POSE), steps, effort
    )
    assert hull.least_fuel(craft, POSE, start, goal, steps * PERIOD, LOOSE) <= found.lower + 1e-9
    assert found.lower <= least + 1e-9  # rounding of sums of pulses
    assert (
        certified_least_time(
            SpatialBounder(lattice), Problem(start, goal, LOOSE, POSE), 9, effort
        ).lower
        <= steps * PERIOD + 1e-9
    )
