"""No trajectory is ever better than its certificate: brute force where possible, flights where not."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from rans_bounds import hull
from rans_bounds.certificate import (
    certified_least_fuel,
    certified_least_time,
)
from rans_bounds.flight import fuel, state_after
from rans_bounds.goal_set import GoalSet
from rans_bounds.plane import bounder
from rans_bounds.plane.bounder import PlanarBounder
from rans_bounds.plane.lattice import Lattice
from rans_bounds.problem import Problem, SearchEffort

from rans import GoToPose
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2, map_leaves
from rans.reference.flight import rows_from_states, states_from_rows
from rans.reference.plant import Plant
from rans.tasks.goal_set import aims
from tests.support.states import planar
from tests.support.tiny_lattice import (
    CRAFTS,
    PERIOD,
    PLATFORM,
    SNUG,
    Flown,
    doubled,
    fly_everything,
    instance,
    lopsided,
)


@pytest.mark.parametrize(("seed", "name"), [*enumerate(CRAFTS)])
def test_least_fuel_against_brute_force(name, seed):
    craft, steps = CRAFTS[name]
    start, goal, flown = instance(craft, steps, seed)
    reached = flown.arrived(goal, SNUG, ("position", "velocity", "heading", "spin"))
    best = flown.fuel[reached].min()
    answer = certified_least_fuel(
        PlanarBounder(Lattice(craft, PERIOD)), Problem(start, goal, SNUG), steps
    )
    assert answer.lower <= best + 1e-12
    assert answer.upper >= best - 1e-12
    assert answer.commands is not None
    assert SNUG.contains(state_after(craft, start, answer.commands, PERIOD), goal)
    assert answer.upper == pytest.approx(fuel(craft, answer.commands, PERIOD))
    if name != "lopsided":  # whole pulses: branching closes the gap
        assert answer.lower == pytest.approx(answer.upper)


@pytest.mark.parametrize("name", ["through", "doubled", "centred", "lopsided"])
@pytest.mark.parametrize("seed", range(2))
def test_least_time_against_brute_force(name, seed):
    craft, most = CRAFTS[name]
    start, goal, _ = instance(craft, most, seed)
    names = ("position", "velocity", "heading", "spin")
    first = next(
        steps
        for steps in (1, 2, 3)
        if fly_everything(craft, start, steps).arrived(goal, SNUG, names).any()
    )
    answer = certified_least_time(
        PlanarBounder(Lattice(craft, PERIOD)), Problem(start, goal, SNUG), most
    )
    assert (answer.lower, answer.upper) == pytest.approx((first * PERIOD, first * PERIOD))


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("dead", "stuck"), [((2,), (0,)), ((), (0, 3))])
def test_least_time_of_failed_thrusters(dead, stuck, seed):
    """Of all sequences those are looked at in which who is dead never fires and who is stuck always does."""
    craft = lopsided()
    names = ("position", "velocity", "heading", "spin")
    start, _, flown = instance(craft, 2, seed)

    def possible(flown: Flown) -> np.ndarray:
        never = flown.commands[:, :, list(dead)] == 0
        always = flown.commands[:, :, list(stuck)] == 1
        return never.all(axis=(1, 2)) & always.all(axis=(1, 2))

    pick = np.flatnonzero(possible(flown))[7 * seed]
    goal = map_leaves(lambda x: float(x[pick]), flown.final)
    both = [fly_everything(craft, start, steps) for steps in (1, 2)]
    first = next(
        k for k, one in enumerate(both, 1) if one.arrived(goal, SNUG, names)[possible(one)].any()
    )
    answer = certified_least_time(
        PlanarBounder(Lattice(craft, PERIOD, dead, stuck)), Problem(start, goal, SNUG), 2
    )
    assert (answer.lower, answer.upper) == pytest.approx((first * PERIOD, first * PERIOD))
    assert answer.commands is not None
    assert (answer.commands[:, list(dead)] == 0).all()
    assert (answer.commands[:, list(stuck)] == 1).all()


@pytest.mark.parametrize("seed", range(2))
def test_without_patience_bounds_hold(seed):
    """What is left open counts as not excluded."""
    start, goal, flown = instance(PLATFORM, 2, seed)
    reached = flown.arrived(goal, SNUG, ("position", "velocity", "heading", "spin"))
    lattice = Lattice(PLATFORM, PERIOD)
    hasty = SearchEffort(work=1e-9)
    fuel_answer = certified_least_fuel(PlanarBounder(lattice), Problem(start, goal, SNUG), 2, hasty)
    assert 0 < fuel_answer.lower <= flown.fuel[reached].min() + 1e-12
    assert (fuel_answer.upper, fuel_answer.commands) == (math.inf, None)
    time_answer = certified_least_time(PlanarBounder(lattice), Problem(start, goal, SNUG), 2, hasty)
    assert time_answer.lower <= 2 * PERIOD
    assert time_answer.upper == math.inf


@settings(max_examples=8)
@given(seed=st.integers(0, 2**20))
def test_starts_that_move_and_spin(seed):
    """Any position, velocity and spin: of two spins that differ by q one is within q / 2 of rest."""
    x, y, angle, u, v, w = np.random.default_rng(seed).uniform(-1.0, 1.0, 6)
    start = PlanarState(
        Vec2(0.2 * x, 0.2 * y), Heading(3.0 * angle), Vec2(0.1 * u, 0.1 * v), 0.6 * w
    )
    goal = planar()
    lattice = Lattice(PLATFORM, PERIOD)
    goals = GoalSet(0.08, 0.08, 0.3, spin=0.5 * lattice.spin)
    answer = certified_least_time(
        PlanarBounder(lattice), Problem(start, goal, goals), 25, SearchEffort(2.0, levels=6)
    )
    assert answer.commands is not None
    rows = rows_from_states(start)[None]
    for command in answer.commands:
        rows = Plant(PLATFORM).advance(rows, command[None], PERIOD)
    # what integrators leave after 5 s on the goal set's edge
    edge = GoalSet(0.08 + 1e-9, 0.08 + 1e-9, 0.3 + 1e-8, goals.spin + 1e-8)
    end = map_leaves(lambda x: float(x[0]), states_from_rows(rows, start))
    assert edge.contains(end, goal)
    loose = hull.least_time(PLATFORM, aims(GoToPose()), start, goal, goals)
    assert loose <= answer.lower <= answer.upper


def test_what_cannot_be_split_is_not_excluded(monkeypatch):
    """One attitude left, no commands found for it and nothing to branch on: the level stays open."""
    monkeypatch.setattr("rans_bounds.plane.bounder._parts", lambda *_: [])
    monkeypatch.setattr("rans_bounds.plane.bounder._commands", lambda *_: None)
    start, goal, flown = instance(PLATFORM, 2, 0)
    reached = flown.arrived(goal, SNUG, ("position", "velocity", "heading", "spin"))
    answer = certified_least_fuel(
        PlanarBounder(Lattice(PLATFORM, PERIOD)), Problem(start, goal, SNUG), 2
    )
    assert answer.lower <= flown.fuel[reached].min() + 1e-12
    assert answer.commands is None


@pytest.mark.parametrize(
    ("ends", "bounds"),
    [
        ("xx?c", (0.6, 0.8)),
        ("x?xc", (0.4, 0.8)),
        ("??c", (0.2, 0.6)),
        ("x?", (0.4, math.inf)),
        ("xxxx", (1.0, math.inf)),
        ("c", (0.2, 0.2)),
        ("???c", (0.2, math.inf)),
    ],
)
def test_the_bound_of_time_is_the_first_that_was_not_excluded(ends, bounds, monkeypatch):
    """By periods of 0.2 s: excluded (x), left open (?) or reached by commands (c); three open end it.

    The start is 0.1 mm outside the goal set, so that the hull's bound excludes no period.
    """

    def decide(relaxation, *_):
        end = ends[min(relaxation.steps, len(ends)) - 1]
        fired = np.ones((relaxation.steps, 4))
        return bounder._Outcome(end == "x", fired if end == "c" else None)

    monkeypatch.setattr(bounder, "_decide", decide)
    root = SimpleNamespace(best=SimpleNamespace(value=0.0))
    monkeypatch.setattr(bounder, "_root_ascent", lambda *_: root)
    rest = planar()
    away = dataclasses.replace(rest, p=Vec2(0.0501, 0.0))
    craft = PlanarBounder(Lattice(doubled(), PERIOD))
    found = certified_least_time(craft, Problem(away, rest), len(ends), SearchEffort(levels=3))
    assert (found.lower, found.upper) == pytest.approx(bounds)
    assert (found.commands is not None) == math.isfinite(bounds[1])


@pytest.mark.parametrize(
    ("pulses", "tolerance", "can"), [(3.0, 0.0, True), (2.5, 0.0, False), (2.5, 0.6, True)]
)
def test_a_spin_stops_that_whole_pulses_take_to_the_goal_s(pulses, tolerance, can):
    """Spins and tolerances in units of what one pulse changes."""
    lattice = Lattice(PLATFORM, PERIOD)
    start = dataclasses.replace(planar(), w=pulses * lattice.spin)
    goals = dataclasses.replace(SNUG, spin=tolerance * lattice.spin)
    assert PlanarBounder(lattice).can_stop(Problem(start, planar(), goals)) == can
