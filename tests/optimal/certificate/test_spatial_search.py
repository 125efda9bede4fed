"""The search for on/off controls in space: its equations, its slopes, and what it must find."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from rans.optimal.certificate import hull
from rans.optimal.certificate.impulses_kernel import _off, _projected, _slopes, refined
from rans.optimal.certificate.lattice import GoalSet
from rans.optimal.certificate.onoff import replay
from rans.optimal.certificate.pulses_kernel import ended
from rans.optimal.certificate.spatial import SpinLattice
from rans.optimal.certificate.spatial_kernel import slopes
from rans.optimal.certificate.spatial_search import (
    Wanted,
    _drawn,
    _Model,
    arrived,
    gauss,
    in_time,
    with_pulses,
)
from rans.optimal.certificate.spatial_shares import throttled
from tests.optimal.certificate.test_spatial import FLYER, PERIOD, REST, TASK_SET, lopsided, moving

LATTICE = SpinLattice(FLYER, PERIOD)


def wanted(start: Any, goal: Any, goal_set: GoalSet = TASK_SET, seconds: float = 0.5) -> Wanted:
    return Wanted(LATTICE, start, goal, goal_set, True, seconds)


def still(seed: int) -> SpatialState:
    return replace(moving(seed, 0.0), v=Vec3(0.0, 0.0, 0.0))


def _columns(state: Any) -> np.ndarray:
    unit = state.attitude.normalised()
    return np.array([*state.p.columns(), unit.w, unit.x, unit.y, unit.z, *state.v.columns(),
                     *state.w.columns()])


@pytest.mark.parametrize("build", [lambda: FLYER, lopsided], ids=["free flyer", "unequal"])
def test_pulses_end_where_the_engines_equations_say(build: Any) -> None:
    """Eight pulses in 20 periods, two of them at once; Magnus of order four is within 1e-5 of substeps."""
    craft, random = build(), np.random.default_rng(3)
    lattice, start = SpinLattice(craft, PERIOD), moving(3, 0.6)
    when, who = random.integers(0, 20, 8), random.integers(0, len(craft.thrusters), 8)
    when[5], who[4], who[5] = when[4], 0, 1
    commands = np.zeros((20, len(craft.thrusters)))
    np.add.at(commands, (when, who), 1.0)
    query = Wanted(lattice, start, start, TASK_SET, True, 1.0)
    state = ended(when, who, 20, query.wrenches, query.ends[0], PERIOD, gauss(), np.zeros(8, np.int64),
                  np.zeros((2, 13)))
    assert state == pytest.approx(_columns(replay(craft, start, commands, PERIOD, 16)), abs=1e-5)


def test_slopes_of_instants_are_differences() -> None:
    """Central ones of 1e-5 s, good to 1e-9 of metres."""
    random, query = np.random.default_rng(5), wanted(moving(5, 0.0), still(6))
    who, when, order, parts = random.integers(0, 16, 9), random.uniform(0.5, 19.5, 9), *_scratch(9)
    off, ahead, found = np.zeros(9), np.zeros(9), np.zeros((9, 9))
    data = (20.0, query.wrenches, *query.ends, PERIOD)
    _off(when, who, *data, off, order, parts)
    _slopes(when, 20.0, order, parts, found)
    for j in range(9):
        step = 1e-5 * np.eye(9)[j]
        _off(when + step, who, *data, ahead, order, parts)
        _off(when - step, who, *data, off, order, parts)
        assert found[:6, j] == pytest.approx((ahead - off)[:6] / 2e-5, abs=1e-7)
    turned = np.linalg.norm(found[6:], axis=0)
    assert turned == pytest.approx(np.full(9, LATTICE.spin))  # one quantum each, about whatever axis


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


def test_instants_are_moved_until_they_arrive() -> None:
    """A flight of 12 pulses, each moved by up to half a second, finds a way back to where it ended."""
    random, query = np.random.default_rng(1), wanted(still(1), still(1))
    who, when, order, parts = random.integers(0, 16, 12), random.uniform(1.0, 18.0, 12), *_scratch(12)
    start, goal = query.ends[0], np.zeros(13)
    off, zero = np.zeros(9), np.zeros(13)
    zero[3] = 1.0
    _off(when, who, 20.0, query.wrenches, start, zero, PERIOD, off, order, parts)
    angle = float(np.linalg.norm(off[6:]))
    goal[:3], goal[7:10], goal[3] = off[:3], off[3:6], math.cos(angle / 2.0)
    goal[4:7] = math.sin(angle / 2.0) / angle * off[6:]
    moved = when + random.uniform(-0.5, 0.5, 12)
    assert refined(moved, who, 20.0, query.wrenches, start, goal, PERIOD, np.full(3, 0.01)) < 0.011
    assert np.abs(moved - when).max() > 1e-3


def test_slopes_of_shares_are_those_of_the_engines() -> None:
    """Their equations, opened by 1e-4 more and less, in eight substeps."""
    query, shares = wanted(moving(2, 0.2), still(7)), np.random.default_rng(2).uniform(0.1, 0.9, (4, 16))
    off, found = slopes(shares.copy(), query.wrenches, *query.ends, PERIOD, gauss())
    final: Any = replay(FLYER, query.start, shares, PERIOD, 8)
    assert off[:3] == pytest.approx(np.subtract(final.p.columns(), query.goal.p.columns()), abs=1e-6)
    turn = query.goal.attitude.normalised().to(final.attitude.normalised()).magnitude()
    assert np.linalg.norm(off[6:9]) == pytest.approx(turn, abs=1e-5)  # Magnus, order four
    for k, i in ((0, 0), (1, 5), (3, 15)):
        more, less = (_columns(replay(FLYER, query.start, _opened(shares, k, i, by), PERIOD, 8))
                      for by in (1e-4, -1e-4))
        slope = (more - less) / 2e-4
        assert found[[0, 1, 2, 3, 4, 5, 9, 10, 11], 16 * k + i] == pytest.approx(
            slope[[0, 1, 2, 7, 8, 9, 10, 11, 12]], abs=1e-5)


def _opened(shares: np.ndarray, k: int, i: int, by: float) -> np.ndarray:
    changed = shares.copy()
    changed[k, i] += by
    return changed


def test_few_pulses_are_found_where_some_arrive() -> None:
    """Where two random pulses end at rest is a goal, to 4 mm and 0.6 degrees; 9 m away is none."""
    start, steps = still(4), 6
    even = [np.ones((steps, 16))]
    tight = GoalSet(0.004, 0.004, 0.01, 1e-9)
    opposite = [pair for pair in itertools.product(range(16), repeat=2)
                if LATTICE.products[pair] == -1]
    random = np.random.default_rng(0)
    for i, j in random.permutation(opposite)[:6].tolist():
        commands = np.zeros((steps, 16), dtype=np.int64)
        commands[random.integers(steps), i] = 1
        commands[random.integers(steps), j] = 1
        goal: Any = replay(FLYER, start, commands, PERIOD, 8)
        found = with_pulses(wanted(start, replace(goal, w=Vec3(0.0, 0.0, 0.0)), tight), steps, 2, even)
        assert found is not None
        assert found.sum() == 2
    assert with_pulses(wanted(start, replace(start, p=start.p + Vec3(9.0, 0.0, 0.0)), tight, 0.05), steps,
                       2, even) is None


def test_pulses_are_drawn_where_shares_are() -> None:
    """Two of 1 and 5 of 0.4, which makes four pulses: one each of the first, the rest nearby."""
    shares, (i, j) = np.zeros((20, 16)), next(pair for pair in itertools.product(range(16), repeat=2)
                                              if LATTICE.products[pair] == -1)
    shares[2, i], shares[17, j], shares[8:13, i] = 1.0, 1.0, 0.2
    shares[8:13, j] = 0.2
    instants, who = _drawn(wanted(still(1), still(2)), shares, 4, np.random.default_rng(0))
    assert who.tolist().count(i) == who.tolist().count(j) == 2  # no spin is left
    periods = instants / PERIOD - 0.5
    assert np.abs(periods - [2.0, 10.0, 10.0, 17.0]).max() <= 3.0
    assert np.abs(periods - [2.0, 10.0, 10.0, 17.0])[[0, 3]].max() <= 1.0


def test_shares_arrive_with_less_than_pulses_need() -> None:
    """Flown by the engines they end in the goal set, at rest but for 5 cm/s; the hull's bound is below."""
    start, goal = _away()
    found = throttled(LATTICE, start, goal, TASK_SET, 40)
    assert 1 <= len(found) <= 2
    for fuel, shares in found:
        assert shares.shape == (40, 16)
        assert PERIOD * shares.sum() == pytest.approx(fuel, rel=1e-6)
        assert arrived(replay(FLYER, start, shares, PERIOD, 8), goal, TASK_SET, True)
        assert hull.least_fuel(FLYER, REST, start, goal, 8.0, TASK_SET) < fuel
    assert found[0].fuel <= found[-1].fuel


def _away() -> tuple[SpatialState, SpatialState]:
    """Two metres and 74 degrees."""
    goal = replace(still(0), p=Vec3(0.0, 0.0, 0.0), attitude=Quat(1.0, 0.0, 0.0, 0.0))
    return replace(goal, p=Vec3(1.5, -1.0, 0.5), attitude=Quat(0.8, 0.0, 0.6, 0.0)), goal


@pytest.fixture(scope="module")
def arriving() -> np.ndarray:
    """Commands that arrive after 3.4 s; the time is for who compiles first."""
    found = in_time(wanted(*_away(), seconds=600.0), 17)
    assert found is not None
    return found


def test_commands_that_arrive_in_time(arriving: np.ndarray) -> None:
    """In 3.4 s, and not in one: 8 N on 5.32 kg for a second are 0.75 m."""
    start, goal = _away()
    assert arriving.shape == (17, 16)
    assert arrived(replay(FLYER, start, arriving, PERIOD, 16), goal, TASK_SET, True)
    assert in_time(wanted(*_away(), seconds=0.01), 5) is None


def test_a_program_mends_commands(arriving: np.ndarray) -> None:
    """Those that arrive, with one pair of a torque and its opposite opened or shut: four changes suffice."""
    query, spoilt = wanted(*_away()), arriving.copy()
    i, j = next((i, j) for i, j in itertools.product(range(16), repeat=2)
                if query.mates[i, j] == -1 and spoilt[2, i] == spoilt[3, j])
    spoilt[2, i], spoilt[3, j] = 1 - spoilt[2, i], 1 - spoilt[3, j]
    model = _Model(query, spoilt.astype(float))
    assert model.miss > 0.1
    mended = model.solved(np.zeros_like(model.shares), np.ones_like(model.shares), 60.0, 4)
    assert mended is not None
    assert np.abs(np.round(mended) - spoilt).sum() <= 4
    assert _Model(query, np.round(mended)).miss < 0.5 * model.miss


def test_a_programs_shares_are_nearer() -> None:
    """All half open miss by metres; one linear program's shares miss less, at rest, within their limits."""
    query = wanted(still(1), still(2))
    model = _Model(query, np.full((12, 16), 0.5))
    trial = model.solved(np.full((12, 16), 0.3), np.full((12, 16), 0.7))
    assert trial is not None
    assert trial.min() >= 0.3
    assert trial.max() <= 0.7
    assert _Model(query, trial).miss < model.miss
    whole = model.solved(np.zeros((12, 16)), np.ones((12, 16)), 60.0)  # which it does not need
    assert whole is not None
    assert set(np.unique(np.round(whole, 6))) <= {0.0, 1.0}
    assert LATTICE.spin * np.linalg.norm(_Model(query, np.round(whole)).spin) < 1e-9
