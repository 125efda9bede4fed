"""Which thrusters fail, when and how: as likely as conditions say, and as they say."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from scipy import stats

from rans import Conditions, ConfigError, FaultConditions, ThrusterConditions
from rans.episode.scenario import draws
from rans.episode.step import Episode, Setup, World
from rans.model.body import Body
from rans.randomization.faults import fault_sets
from rans.randomization.parameters import draw
from tests.support.draws import COUNT, CRAFTS, LIKELY, PLATFORM, TASK, parameters


def health(conditions: FaultConditions, time: float = 0.0, count: int = COUNT) -> Any:
    """Gains and leaks, (thrusters, N) each."""
    body = parameters(Conditions(faults=conditions), count=count).body_at(time)
    return [np.array([np.broadcast_to(x, count) for x in part]) for part in (body.gain, body.leak)]


@pytest.mark.parametrize(
    ("kind", "gain", "leak"),
    [
        ("dead", (0.0, 0.0), (0.0, 0.0)),
        ("stuck-open", (0.0, 0.0), (1.0, 1.0)),
        ("stuck", (0.0, 0.0), (0.3, 0.8)),
        ("weak", (0.3, 0.8), (0.0, 0.0)),
    ],
)
def test_each_kind_does_what_it_says(kind, gain, leak):
    gains, leaks = health(FaultConditions(count=1.0, kinds=(kind,), share=(0.3, 0.8)))
    hit = (gains != 1.0) | (leaks != 0.0)
    assert (hit.sum(axis=0) == 1).all()
    for values, (low, high) in ((gains[hit], gain), (leaks[hit], leak)):
        assert low <= values.min()
        assert values.max() <= high
        assert low == high or values.std() > 0.1  # of a uniform range of a half: 0.14


def test_named_thrusters_fail_in_every_episode_and_no_others():
    gains, leaks = health(FaultConditions(kinds=("dead", "stuck-open"), thrusters=(5, 2)))
    assert (gains[[2, 5]] == 0.0).all()
    assert (gains[[0, 1, 3, 4, 6, 7]] == 1.0).all()
    assert (leaks[[0, 1, 3, 4, 6, 7]] == 0.0).all()
    # Each has a kind of its own.
    open_ = leaks[[2, 5]] == 1.0
    assert stats.binomtest(int(open_.sum()), open_.size).pvalue > LIKELY
    assert stats.binomtest(int((open_[0] != open_[1]).sum()), COUNT).pvalue > LIKELY
    later, _ = health(FaultConditions(kinds=("dead",), time=1.0, thrusters=(5,)))
    assert (later == 1.0).all()


def test_four_distinct_thrusters_fail_each_set_as_likely():
    gains, _ = health(FaultConditions(count=4.0, kinds=("dead",)))
    assert ((gains == 0.0).sum(axis=0) == 4).all()
    seen = Counter(tuple(np.nonzero(column == 0.0)[0].tolist()) for column in gains.T)
    sets = list(combinations(range(8), 4))
    assert set(seen) <= set(sets)
    assert stats.chisquare([seen[one] for one in sets]).pvalue > LIKELY


def test_as_many_fail_as_are_drawn_and_kinds_are_as_likely():
    gains, leaks = health(FaultConditions(count=(0.0, 2.0), kinds=("dead", "stuck-open")))
    number = (gains == 0.0).sum(axis=0)
    assert stats.chisquare(np.bincount(number, minlength=3)).pvalue > LIKELY
    dead = (leaks[gains == 0.0] == 0.0).sum()
    assert stats.binomtest(int(dead), int(number.sum())).pvalue > LIKELY


@pytest.mark.parametrize(
    ("dimension", "kind", "count", "among"),
    [
        (2, "dead", 1, "recoverable"),
        (2, "dead", 1, "unrecoverable"),  # which there are none of
        (2, "dead", 2, "unrecoverable"),
        (3, "stuck-open", 1, "recoverable"),
        (3, "stuck-open", 2, "unrecoverable"),
    ],
)
def test_sets_that_are_recoverable_or_not_are_each_as_likely(among, count, kind, dimension):
    faults = FaultConditions(float(count), (kind,), among=among)
    expected = {
        one.thrusters
        for one in fault_sets(CRAFTS[dimension], count, kind)
        if one.recoverable == (among == "recoverable")
    }
    if not expected:
        with pytest.raises(
            ConfigError, match=f"un.* of 1 {kind} thruster, but .* has none; `rans faults`"
        ):
            parameters(Conditions(faults=faults), dimension)
        return
    body = parameters(Conditions(faults=faults), dimension).body_at(0.0)
    hit = np.array([np.broadcast_to(x, COUNT) for x in body.gain]) == 0.0
    assert (
        np.array([np.broadcast_to(x, COUNT) for x in body.leak])[hit] == (kind == "stuck-open")
    ).all()
    seen = Counter(tuple(np.flatnonzero(column).tolist()) for column in hit.T)
    assert set(seen) == expected
    assert stats.chisquare(list(seen.values())).pvalue > LIKELY


def test_recoverable_faults_are_as_many_and_of_each_kind_as_often_and_pairs_fail_alike():
    conditions = FaultConditions(count=(0.0, 2.0), among="recoverable")
    gains, leaks = health(conditions)
    number = (gains == 0.0).sum(axis=0)
    stuck = (leaks == 1.0).sum(axis=0)
    assert stats.chisquare(np.bincount(number, minlength=3)).pvalue > LIKELY
    assert ((stuck == 0) | (stuck == number)).all()
    assert stats.binomtest(int((stuck > 0).sum()), int((number > 0).sum())).pvalue > LIKELY


def test_kinds_with_sets_of_their_own_keep_them():
    """Of a craft whose thruster 0 is too strong for the others to balance, it cannot be stuck open."""
    first, *others = PLATFORM.thrusters
    strong = replace(PLATFORM, thrusters=(replace(first, force=20.0), *others))
    faults = FaultConditions(1.0, ("dead", "stuck-open"), among="recoverable")
    own = draws(11, COUNT)
    world = World(Setup(strong, TASK, conditions=Conditions(faults=faults)))
    body = world.recalled(Episode(None, None), own).parameters.body_at(0.0)  # type: ignore[union-attr]
    assert (np.array(body.gain[0]) == 0.0).any()
    assert not np.array(body.leak[0]).any()
    dead = (np.array(body.gain) == 0.0) & (np.array(body.leak) == 0.0)
    assert stats.binomtest(int(dead.any(axis=0).sum()), COUNT).pvalue > LIKELY
    assert stats.chisquare(dead.sum(axis=1)).pvalue > LIKELY


def test_who_does_not_fail_keeps_the_thrust_it_drew():
    """And who is stuck open gives all of it."""
    drawn = Conditions(
        thrusters=ThrusterConditions(thrust=(0.7, 0.9)),
        faults=FaultConditions(count=1.0, kinds=("stuck-open",), time=5.0),
    )
    found = parameters(drawn, count=50)
    sound = found.body_at(0.0)
    failed = found.body_at(5.0)
    whole = np.array(failed.gain) + np.array(failed.leak)
    np.testing.assert_allclose(whole, np.array(sound.gain), rtol=1e-15)
    assert ((np.array(failed.leak) > 0.0).sum(axis=0) == 1).all()


def test_where_one_or_two_fail_one_alone_is_any_of_those_that_may():
    """Not the first of two, which is seldom one of the last thrusters."""
    faults = FaultConditions(count=(1.0, 2.0), kinds=("dead",), among="recoverable")
    gains, _ = health(faults)
    lost = gains == 0.0
    single = lost.sum(axis=0) == 1
    assert stats.binomtest(int(single.sum()), COUNT).pvalue > LIKELY
    may = [one.thrusters[0] for one in fault_sets(PLATFORM, 1, "dead") if one.recoverable]
    seen = lost[:, single].sum(axis=1)
    assert seen.sum() == seen[may].sum()
    assert stats.chisquare(seen[may]).pvalue > LIKELY


def test_the_strongest_body_gives_what_leaks_as_thrust():
    """By hand: nozzles that leak 0.2 give 1.2 before; stuck at 0.5 one would give less, stuck open 1."""
    leaking = replace(Body.of(PLATFORM), gain=(1.0,) * 8, leak=(0.2,) * 8)
    own = draws(5, 4)
    for share in (0.5, 1.0):
        stuck = Conditions(faults=FaultConditions(count=1.0, kinds=("stuck",), share=share))
        strongest = draw(stuck, PLATFORM, leaking, 125, own.first, own).strongest()
        assert np.allclose(strongest.gain, 1.2)
        assert not np.any(strongest.leak)
