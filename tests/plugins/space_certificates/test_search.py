"""The search for on/off controls in space: its equations, its roundings, and what it must find."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_space_certificates.bounder import SpatialBounder
from rans_space_certificates.impulses_kernel import _off, _projected, _slopes, refined
from rans_space_certificates.pulses_kernel import final_state
from rans_space_certificates.reach import SpinLattice
from rans_space_certificates.search import (
    ArrivalSearch,
    _draw_pulses,
    _round_duties,
    gauss,
    is_in_goal_set,
    search_fixed_pulses,
    search_fixed_time,
)
from rans_space_certificates.throttled import throttled

from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from rans.optimal.certificate import hull
from rans.optimal.certificate.certificate import certified_least_time
from rans.optimal.certificate.flight import state_after
from rans.optimal.certificate.goal_set import GoalSet
from rans.optimal.certificate.problem import Problem, SearchEffort
from tests.support.space_reach import (
    FLYER,
    PERIOD,
    REST,
    TASK_SET,
    lopsided,
    moving,
)

LATTICE = SpinLattice(FLYER, PERIOD)


def wanted(
    start: Any, goal: Any, goal_set: GoalSet = TASK_SET, seconds: float = 0.5
) -> ArrivalSearch:
    return ArrivalSearch(LATTICE, start, goal, goal_set, True, seconds)


def still(seed: int) -> SpatialState:
    return replace(moving(seed, 0.0), v=Vec3(0.0, 0.0, 0.0))


def _columns(state: Any) -> np.ndarray:
    unit = state.attitude.normalised()
    return np.array(
        [*state.p.columns(), unit.w, unit.x, unit.y, unit.z, *state.v.columns(), *state.w.columns()]
    )


@pytest.mark.parametrize("build", [lambda: FLYER, lopsided], ids=["free flyer", "unequal"])
def test_pulses_end_where_the_engines_equations_say(build: Any) -> None:
    """Eight pulses in 20 periods, two of them at once; Magnus of order four is within 1e-5 of substeps."""
    craft = build()
    random = np.random.default_rng(3)
    lattice = SpinLattice(craft, PERIOD)
    start = moving(3, 0.6)
    when = random.integers(0, 20, 8)
    who = random.integers(0, len(craft.thrusters), 8)
    when[5] = when[4]
    who[4] = 0
    who[5] = 1
    commands = np.zeros((20, len(craft.thrusters)))
    np.add.at(commands, (when, who), 1.0)
    query = ArrivalSearch(lattice, start, start, TASK_SET, True, 1.0)
    state = final_state(
        when,
        who,
        20,
        query.wrenches,
        query.ends[0],
        PERIOD,
        gauss(),
        np.zeros(8, np.int64),
        np.zeros((2, 13)),
    )
    assert state == pytest.approx(
        _columns(state_after(craft, start, commands, PERIOD, 16)), abs=1e-5
    )


def test_slopes_of_instants_are_differences() -> None:
    """Central ones of 1e-5 s, good to 1e-9 of metres."""
    random = np.random.default_rng(5)
    query = wanted(moving(5, 0.0), still(6))
    who, when, order, parts = random.integers(0, 16, 9), random.uniform(0.5, 19.5, 9), *_scratch(9)
    off = np.zeros(9)
    ahead = np.zeros(9)
    found = np.zeros((9, 9))
    data = (20.0, query.wrenches, *query.ends, PERIOD)
    _off(when, who, *data, off, order, parts)
    _slopes(when, 20.0, order, parts, found)
    for j in range(9):
        step = 1e-5 * np.eye(9)[j]
        _off(when + step, who, *data, ahead, order, parts)
        _off(when - step, who, *data, off, order, parts)
        assert found[:6, j] == pytest.approx((ahead - off)[:6] / 2e-5, abs=1e-7)
    turned = np.linalg.norm(found[6:], axis=0)
    assert turned == pytest.approx(
        np.full(9, LATTICE.spin)
    )  # one quantum each, about whatever axis


def _scratch(count: int) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros(count, np.int64), np.zeros((count, 9))


def test_what_is_outside_a_ball() -> None:
    """Of 3 m where 1 m is free 2 m are left; moves along it count whole, across two thirds; inside none."""
    off = np.array([3.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 4.0])
    moves = np.tile(np.eye(3), (3, 1))
    _projected(off, np.array([1.0, 1.0, 2.0]), moves)
    assert off == pytest.approx([2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    assert moves[:3] == pytest.approx(np.diag([1.0, 2.0 / 3.0, 2.0 / 3.0]))
    assert not moves[3:6].any()
    assert np.diag(moves[6:]) == pytest.approx([0.25, 0.25, 0.5])


@pytest.mark.slow
def test_instants_are_moved_until_they_arrive() -> None:
    """A flight of 12 pulses, each moved by up to half a second, finds a way back to where it ended."""
    random = np.random.default_rng(1)
    query = wanted(still(1), still(1))
    who, when, order, parts = (
        random.integers(0, 16, 12),
        random.uniform(1.0, 18.0, 12),
        *_scratch(12),
    )
    start = query.ends[0]
    goal = np.zeros(13)
    off = np.zeros(9)
    zero = np.zeros(13)
    zero[3] = 1.0
    _off(when, who, 20.0, query.wrenches, start, zero, PERIOD, off, order, parts)
    angle = float(np.linalg.norm(off[6:]))
    goal[:3], goal[7:10], goal[3] = off[:3], off[3:6], math.cos(angle / 2.0)
    goal[4:7] = math.sin(angle / 2.0) / angle * off[6:]
    moved = when + random.uniform(-0.5, 0.5, 12)
    assert refined(moved, who, 20.0, query.wrenches, start, goal, PERIOD, np.full(3, 0.01)) < 0.011
    assert np.abs(moved - when).max() > 1e-3


@pytest.mark.slow
def test_few_pulses_are_found_where_some_arrive() -> None:
    """Where two random pulses end at rest is a goal, to 4 mm and 0.6 degrees; 9 m away is none."""
    start = still(4)
    steps = 6
    even = [np.ones((steps, 16))]
    tight = GoalSet(0.004, 0.004, 0.01, 1e-9)
    opposite = [
        pair for pair in itertools.product(range(16), repeat=2) if LATTICE.products[pair] == -1
    ]
    random = np.random.default_rng(0)
    for i, j in random.permutation(opposite)[:6].tolist():
        commands = np.zeros((steps, 16), dtype=np.int64)
        commands[random.integers(steps), i] = 1
        commands[random.integers(steps), j] = 1
        goal: Any = state_after(FLYER, start, commands, PERIOD, 8)
        found = search_fixed_pulses(
            wanted(start, replace(goal, w=Vec3(0.0, 0.0, 0.0)), tight), steps, 2, even
        )
        assert found is not None
        assert found.sum() == 2
    assert (
        search_fixed_pulses(
            wanted(start, replace(start, p=start.p + Vec3(9.0, 0.0, 0.0)), tight, 0.05),
            steps,
            2,
            even,
        )
        is None
    )


def test_pulses_are_drawn_where_shares_are() -> None:
    """Two of 1 and 5 of 0.4, which makes four pulses: one each of the first, the rest nearby."""
    duties = np.zeros((20, 16))
    (i, j) = next(
        pair for pair in itertools.product(range(16), repeat=2) if LATTICE.products[pair] == -1
    )
    duties[2, i] = 1.0
    duties[17, j] = 1.0
    duties[8:13, i] = 0.2
    duties[8:13, j] = 0.2
    instants, who = _draw_pulses(wanted(still(1), still(2)), duties, 4, np.random.default_rng(0))
    assert who.tolist().count(i) == who.tolist().count(j) == 2  # no spin is left
    periods = instants / PERIOD - 0.5
    assert np.abs(periods - [2.0, 10.0, 10.0, 17.0]).max() <= 3.0
    assert np.abs(periods - [2.0, 10.0, 10.0, 17.0])[[0, 3]].max() <= 1.0


@pytest.mark.slow
def test_shares_arrive_with_less_than_pulses_need() -> None:
    """Flown by the engines they end in the goal set, at rest but for 5 cm/s; the hull's bound is below."""
    start, goal = _away()
    found = throttled(LATTICE, start, goal, TASK_SET, 40)
    assert 1 <= len(found) <= 2
    for fuel, duties in found:
        assert duties.shape == (40, 16)
        assert PERIOD * duties.sum() == pytest.approx(fuel, rel=1e-6)
        assert is_in_goal_set(state_after(FLYER, start, duties, PERIOD, 8), goal, TASK_SET, True)
        assert hull.least_fuel(FLYER, REST, start, goal, 8.0, TASK_SET) < fuel
    assert found[0].fuel <= found[-1].fuel


def _away() -> tuple[SpatialState, SpatialState]:
    """Two metres and 74 degrees."""
    goal = replace(still(0), p=Vec3(0.0, 0.0, 0.0), attitude=Quat(1.0, 0.0, 0.0, 0.0))
    return replace(goal, p=Vec3(1.5, -1.0, 0.5), attitude=Quat(0.8, 0.0, 0.6, 0.0)), goal


def test_roundings_sum_up_as_shares_do() -> None:
    """To less than a period at any time; what is shut stays shut, and open open."""
    duties = np.random.default_rng(3).uniform(0.0, 1.0, (30, 16))
    duties[:, 0] = 0.0
    duties[:, 1] = 1.0
    duties[12:, 2] = 0.0
    duties[12:, 3] = 1.0
    commands = _round_duties(wanted(still(1), still(2)), duties, np.random.default_rng(0))
    assert set(np.unique(commands)) == {0, 1}
    assert np.abs(np.cumsum(commands - duties, axis=0)).max() < 1.0
    assert (commands[12:, :4] == [0, 1, 0, 1]).all()


def test_one_rounding_of_many_is_chosen() -> None:
    """Two thrusters of opposite torque, half open for a second: every other rounding leaves no spin."""
    i, j = next(
        pair for pair in itertools.product(range(16), repeat=2) if LATTICE.products[pair] == -1
    )
    duties = np.zeros((5, 16))
    duties[:, [i, j]] = 0.5
    for seed in range(10):
        commands = _round_duties(wanted(still(1), still(1)), duties, np.random.default_rng(seed))
        assert commands[:, i].sum() == commands[:, j].sum()


@pytest.mark.slow
def test_commands_are_found_a_period_above_the_bound() -> None:
    """Two metres away: 2.8 s are excluded; in 3.2 s on/off commands arrive, by twice as many substeps too."""
    start, goal = _away()
    found = certified_least_time(
        SpatialBounder(LATTICE), Problem(start, goal, TASK_SET, REST), 40, SearchEffort(20.0)
    )
    assert found.lower == pytest.approx(3.0)
    assert found.upper == pytest.approx(3.2)
    assert found.commands is not None
    assert found.commands.shape == (16, 16)
    assert is_in_goal_set(
        state_after(FLYER, start, found.commands, PERIOD, 16), goal, TASK_SET, True
    )


@pytest.mark.slow
def test_commands_at_the_edge_of_the_goal_set() -> None:
    """From 6 cm: four nozzles at 45 degrees, 2.8 N, for a period and back make 2.1 cm: inside 5 cm, not 2.

    One period ends at 0.1 m/s.
    """
    start = replace(still(1), p=Vec3(0.06, 0.0, 0.0), attitude=Quat(1.0, 0.0, 0.0, 0.0))
    goal = replace(start, p=Vec3(0.0, 0.0, 0.0))
    found = certified_least_time(
        SpatialBounder(LATTICE), Problem(start, goal, TASK_SET, REST), 40, SearchEffort(20.0)
    )
    assert found.upper == pytest.approx(0.4)


@pytest.mark.slow
def test_no_commands_where_none_arrive() -> None:
    """In one second 8 N on 5.32 kg are 0.75 m."""
    start, goal = _away()
    assert search_fixed_time(wanted(start, goal, seconds=0.05), [np.ones((5, 16))]) is None
