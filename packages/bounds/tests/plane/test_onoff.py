"""Upper bounds are flights: whatever the solver says, the shared equations decide."""

from __future__ import annotations

import numpy as np
import pytest
from rans_bounds.flight import fuel, state_after
from rans_bounds.goal_set import GoalSet
from rans_bounds.plane.ascent import scale, towards_goal
from rans_bounds.plane.dual import Relaxation
from rans_bounds.plane.lattice import Lattice
from rans_bounds.plane.onoff import nozzles, replayed_within_cost

from tests.support.tiny_lattice import PERIOD, instance, lopsided

SNUG = GoalSet(0.01, 0.01, 0.03)
NAMES = ("position", "velocity", "heading", "spin")


@pytest.mark.parametrize("seed", range(5))
def test_nozzles_are_found_whenever_a_flight_exists_and_only_then(seed):
    """For the attitude of a flight that arrives with room to spare the solver finds as cheap a one."""
    craft = lopsided()
    steps = 3
    start, goal, flown = instance(craft, steps, seed)
    lattice = Lattice(craft, PERIOD)
    relaxation = Relaxation(lattice, start, goal, SNUG, steps, None)
    roomy = GoalSet(0.0095, 0.0095, 0.03)  # within the polygon, 2 % inside the disc
    arrived = flown.arrived(goal, roomy, NAMES)
    best = np.flatnonzero(arrived)[flown.fuel[arrived].argmin()]
    path = _path(lattice, flown.commands[best])
    bound = relaxation.bound(towards_goal(relaxation) * scale(relaxation), relaxation.reachable())
    commands = nozzles(relaxation, path, bound, float(flown.fuel[best]), 5.0)
    assert commands is not None
    assert fuel(craft, commands, PERIOD) <= flown.fuel[best] + 1e-9
    assert SNUG.contains(state_after(craft, start, commands, PERIOD), goal)
    # Below the least fuel of all flights there is nothing to find.
    arrived = flown.arrived(goal, SNUG, NAMES)
    best = np.flatnonzero(arrived)[flown.fuel[arrived].argmin()]
    bound = relaxation.bound(np.zeros(4), relaxation.reachable())
    path = _path(lattice, flown.commands[best])
    assert nozzles(relaxation, path, bound, float(flown.fuel[best]) - 0.01, 5.0) is None


def test_a_path_is_flown_at_its_price_and_not_below():
    craft = lopsided()
    steps = 3
    start, goal, arrived = instance(craft, steps, 1)
    relaxation = Relaxation(Lattice(craft, PERIOD), start, goal, SNUG, steps, None)
    [best, *_] = np.flatnonzero(arrived.arrived(goal, SNUG, NAMES))
    patterns = relaxation.lattice.patterns
    wrenches = np.array(craft.wrench_map)
    path = np.array(
        [
            np.abs((patterns.commands - fired) @ wrenches).max(axis=1).argmin()
            for fired in arrived.commands[best]
        ]
    )
    price = float(patterns.thrust[path].sum()) * PERIOD
    commands = replayed_within_cost(relaxation, path, price)
    assert commands is not None
    assert fuel(craft, commands, PERIOD) == pytest.approx(price)
    assert replayed_within_cost(relaxation, path, 0.99 * price) is None
    free = Relaxation(relaxation.lattice, start, goal, SNUG, steps, None, fuel=0.0)
    assert replayed_within_cost(free, path, 0.0) is not None


def _path(lattice: Lattice, commands: np.ndarray) -> np.ndarray:
    """Any patterns with the same net torques."""
    torque = commands @ lattice.multiples
    return np.array([np.flatnonzero(lattice.patterns.torque == t)[0] for t in torque])
