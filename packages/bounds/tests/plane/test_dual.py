"""The bound of any costate: what brute force finds, and never above what a flight costs."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from rans_bounds.flight import fuel, state_after
from rans_bounds.goal_set import GoalSet
from rans_bounds.plane.ascent import ascend, scale, towards_goal
from rans_bounds.plane.dual import Relaxation
from rans_bounds.plane.lattice import Lattice

from rans.base.errors import NonFiniteState
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2, map_leaves
from tests.support.states import planar
from tests.support.tiny_lattice import CRAFTS, PERIOD, PLATFORM, SNUG, Flown, instance

multipliers = st.lists(st.floats(-30.0, 30.0, allow_subnormal=False), min_size=4, max_size=4)


@lru_cache
def tiny(name: str, seed: int) -> tuple[Relaxation, PlanarState, Flown]:
    """65,536, 32,768 or 4,096 sequences."""
    craft, steps = CRAFTS[name]
    start, goal, flown = instance(craft, steps, seed)
    return Relaxation(Lattice(craft, PERIOD), start, goal, SNUG, steps, None), goal, flown


@pytest.mark.parametrize("name", CRAFTS)
@settings(max_examples=25)
@given(seed=st.integers(0, 3), costate=multipliers)
def test_inner_minimum_equals_brute_force(name, seed, costate):
    relaxation, goal, flown = tiny(name, seed)
    turned = flown.arrived(goal, SNUG, ("heading", "spin"))
    final = map_leaves(lambda x: x[turned], flown.final)
    speed = final.v - Vec2(goal.v.x, goal.v.y)
    way = final.p - Vec2(goal.p.x, goal.p.y)
    miss = np.array([speed.x, speed.y, way.x, way.y])
    radii = SNUG.velocity * math.hypot(*costate[:2]) + SNUG.position * math.hypot(*costate[2:])
    expected = (flown.fuel[turned] + np.array(costate) @ miss).min() - radii
    multiplier = np.array(costate)
    ours = relaxation.bound(multiplier, relaxation.reachable())
    # rounding of sums of up to 1e2
    assert ours.value + relaxation.margin(multiplier) == pytest.approx(expected, abs=1e-12)
    assert ours.value <= expected


@pytest.mark.filterwarnings("ignore:overflow encountered")
def test_overflow_is_no_proof():
    """Infinite costs once meant that no path is left; with such numbers they may be sums too large."""
    rest = planar()
    relaxation = Relaxation(Lattice(PLATFORM, PERIOD), rest, rest, GoalSet(), 3, None)
    for costate in (np.full(4, np.nan), np.full(4, 1e305)):
        with pytest.raises(NonFiniteState, match="far too large numbers"):
            relaxation.bound(costate, relaxation.everything)
        with pytest.raises(NonFiniteState, match="far too large numbers"):
            relaxation.shrunk(costate, relaxation.everything, 1.0)


@pytest.mark.slow
@settings(max_examples=40)
@given(seed=st.integers(0, 2**20), duty=st.floats(0.0, 0.4), costate=multipliers)
def test_no_flight_beats_any_costate(seed, duty, costate):
    """A random flight, whose end is the goal, costs at least the bound and stays in what is searched."""
    random = np.random.default_rng(seed)
    lattice = Lattice(PLATFORM, PERIOD)
    steps = 12
    patterns = lattice.patterns
    path = np.where(
        random.random(steps) < duty,
        random.integers(0, len(patterns.torque), steps),
        np.flatnonzero(patterns.thrust == 0)[0],
    )
    x, y, angle, u, v, w = random.uniform(-1.0, 1.0, 6)
    start = PlanarState(Vec2(x, y), Heading(angle), Vec2(u, v), w)
    goal = state_after(PLATFORM, start, patterns.commands[path], PERIOD)
    paid = fuel(PLATFORM, patterns.commands[path], PERIOD)
    relaxation = Relaxation(lattice, start, goal, GoalSet(), steps, paid)
    everything = relaxation.reachable()
    assert relaxation.inside(path, everything)
    for costate_ in (np.array(costate), towards_goal(relaxation) * scale(relaxation)):
        assert relaxation.bound(costate_, everything).value <= paid
        assert relaxation.inside(path, relaxation.shrunk(costate_, everything, paid))
    best = ascend(relaxation, everything, towards_goal(relaxation), [], np.inf, 1e-3, 0.5, 25).best
    assert best.value <= paid
    assert lattice.next_fuel(best.value, relaxation.net) <= paid + 1e-9
    assert relaxation.inside(path, relaxation.shrunk(best.costate, everything, paid))


def test_gradient_is_that_of_the_bound():
    relaxation, _, _ = tiny("floating-platform", 1)
    everything = relaxation.reachable()
    costate = np.array([3.0, -2.0, 1.0, 5.0])
    here = relaxation.bound(costate, everything)
    for other in np.random.default_rng(0).normal(size=(20, 4)) * 10:
        there = relaxation.bound(other, everything)
        # concave: below its tangent everywhere, up to rounding
        assert there.value <= here.value + here.gradient @ (other - costate) + 1e-9
