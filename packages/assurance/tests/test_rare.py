"""Intervals of rare events cover the probability, however many causes there are."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from rans_assurance.assure.rare import Rare, rare
from scipy.stats import binom, chi2, norm

from rans.errors import ConfigError


class Failures(NamedTuple):
    """A set of failures in D normal numbers, where the score is 1 or more."""

    score: Callable[[np.ndarray], np.ndarray]
    dimensions: int
    probability: float


def _any(*chances: float) -> float:
    """Probability that at least one of several independent events happens."""
    return 1.0 - math.prod(1.0 - p for p in chances)


RADIUS = math.sqrt(chi2.isf(1e-6, 12))
ONE = float(norm.sf(4.5))
LATE = float(norm.sf(4.3))
SETS = {
    "one side": Failures(lambda z: z[0] / 4.5, 10, ONE),
    "outside of a sphere": Failures(lambda z: np.linalg.norm(z, axis=0) / RADIUS, 12, 1e-6),
    "two sides": Failures(lambda z: np.abs(z[0]) / 4.5, 10, 2.0 * ONE),
    "two causes": Failures(lambda z: z[:2].max(axis=0) / 4.5, 10, _any(ONE, ONE)),
    "a near cause and a rarer one": Failures(
        lambda z: np.maximum(z[0] / 4.1, z[1] / 4.7),
        10,
        _any(float(norm.sf(4.1)), float(norm.sf(4.7))),
    ),
    "four causes on two sides": Failures(
        lambda z: np.abs(z[:4]).max(axis=0) / 4.5, 10, _any(*4 * [2.0 * ONE])
    ),
    "decoy": Failures(lambda z: np.maximum(z[0] / 4.5, np.minimum(0.9, z[1] / 2.5)), 10, ONE),
    # At middle levels of the score the most frequent cause is outlived by a rarer one that rises early.
    "late": Failures(
        lambda z: np.maximum(np.maximum(z[0] / 4.3, 0.0) ** 6, z[1] / 4.5), 10, _any(LATE, ONE)
    ),
    "late2": Failures(
        lambda z: np.maximum((z[0] / 4.3) ** 6, np.abs(z[1]) / 4.5),
        10,
        _any(2.0 * LATE, 2.0 * ONE),
    ),
    # A rarer cause rises to 0.9 at once, and from there slowly.
    "saturating": Failures(
        lambda z: np.maximum(
            z[0] / 4.3,
            np.where(z[1] < 1.5, 0.6 * np.maximum(z[1], 0.0), 0.9 + 0.1 * (z[1] - 1.5) / 3.1),
        ),
        10,
        _any(LATE, float(norm.sf(4.6))),
    ),
}


def _repeated(name: str, repetitions: int) -> list[Rare]:
    failures = SETS[name]
    return [
        rare(lambda z, _: failures.score(z), failures.dimensions, 4000, seed)
        for seed in range(repetitions)
    ]


def _wrong(name: str, results: list[Rare]) -> int:
    """Intervals without the probability; no interval claims nothing."""
    true = SETS[name].probability
    claims = [interval for one in results if (interval := one.interval) is not None]
    return sum(not low <= true <= high for low, high in claims)


def test_intervals_cover_what_they_say() -> None:
    results = _repeated("late", 15)
    # Of 15 intervals at 99 % more than 2 are wrong once in 2,400 times.
    assert binom.sf(2, 15, 0.01) < 4.2e-4
    assert _wrong("late", results) <= 2
    # Where larger errors lead to failures, there is an answer.
    assert sum(one.interval is None for one in results) <= 3


@pytest.mark.slow
def test_98_percent_of_200_intervals_are_right() -> None:
    wrong = []
    refused = 0
    for name, failures in SETS.items():
        results = _repeated(name, 20)
        wrong.append(_wrong(name, results))
        refused += sum(one.interval is None for one in results)
        # Without bias: the mean of 20 is within four of its own standard errors.
        estimates = np.array([one.probability for one in results]) / failures.probability
        assert abs(estimates.mean() - 1.0) < 4.0 * estimates.std() / math.sqrt(20), name
    assert sum(wrong) <= 4, wrong
    # Of 20 intervals at 99 % more than 2 are wrong once in 1,000 times.
    assert max(wrong) <= 2, wrong
    assert refused <= 6


@pytest.mark.parametrize("limit", [2.0, 4.5])
def test_many_flights_tell_more(limit: float) -> None:
    # The mean of 20 normal numbers, in its own standard deviation.
    found = rare(lambda z, _: z.sum(axis=0) / np.sqrt(20) / limit, 20, 20_000, 0)
    true = norm.sf(limit)
    assert found.interval is not None
    low, high = found.interval
    assert low <= true <= high < 2.0 * low
    assert found.is_counted == (limit == 2.0)
    if limit > 2.0:
        # A flight's factor is worth its about 7 flights, along two ways.
        assert found.gain > 10.0


def test_where_nothing_fails_nothing_is_estimated() -> None:
    found = rare(lambda z, _: np.zeros(z.shape[1]), 3, 2000, 0)
    assert (found.events, found.interval, found.to_json()["99 %"]) == (0, None, None)
    assert found.summary.startswith("no failure was met in ")


def test_what_only_some_groups_meet_is_no_estimate() -> None:
    """From a plateau that most flights reach, a narrow way leads on."""
    results = [
        rare(
            lambda z, _: np.maximum(np.minimum(0.8, z[1] / 2.0), z[0] / 3.6),
            10,
            4000,
            seed,
        )
        for seed in range(10)
    ]
    some = [one for one in results if 0.0 < sum(p > 0.0 for p in one.groups) < len(one.groups)]
    assert all(one.interval is None and "no estimate" in one.summary for one in some)
    sides = [one.interval for one in results if one.interval is not None]
    assert all(low <= norm.sf(3.6) <= high for low, high in sides)


def test_a_group_that_alone_met_a_frequent_cause_is_believed_no_more_than_the_others() -> None:
    agree = Rare((1e-6,) * 15 + (2e-6,), 10, 20_000, 4000, 0)
    differ = Rare((1e-6,) * 15 + (2e-5,), 10, 20_000, 4000, 0)
    assert agree.interval is not None
    assert differ.interval is None
    assert "differ (1e-06 to 2e-05)" in differ.summary


def test_counting_the_first_flights_overrules_what_groups_say() -> None:
    """10 of 4,000 flights as drawn failed: 2.5e-3, which no agreement on 1e-6 argues away."""
    found = Rare((1e-6,) * 15 + (2e-6,), 10, 20_000, 4000, 10)
    assert found.interval is not None
    low, high = found.interval
    assert 5e-4 < low < 2.5e-3 < high < 1e-2


def test_another_way_that_meets_more_failures_leaves_no_interval() -> None:
    agree = (1e-6,) * 15 + (2e-6,)
    more = (1e-5,) * 15 + (2e-5,)
    assert Rare(agree, 10, 20_000, 4000, 0, (agree, agree)).interval is not None
    missed = Rare(agree, 10, 20_000, 4000, 0, (agree, more))
    assert missed.interval is None
    assert "1.06e-05, as where kinds of failure differ in pace" in missed.summary
    # One that meets less is what it is there to show: it was led astray.
    assert Rare(more, 10, 20_000, 4000, 0, (agree, agree)).interval is not None


def test_failures_that_larger_errors_jump_over_are_noticed() -> None:
    """A band of failures so narrow that no factor on the errors lands in it, but the score leads there."""

    def score(z: np.ndarray, _: np.ndarray) -> np.ndarray:
        fails = (z[0] > 4.0) & (z[0] < 4.02)
        return np.where(fails, 1.0, 0.99 - 0.2 * np.abs(z[0] - 4.01))

    results = [rare(score, 2, 2000, seed) for seed in range(3)]
    assert all(one.interval is None for one in results)


@pytest.mark.slow
def test_failures_by_noise_are_estimated_right() -> None:
    """The number of an episode decides beside what is drawn: a uniform number between -1/4 and 1/4."""

    def score(z: np.ndarray, number: np.ndarray) -> np.ndarray:
        return z[0] / 4.0 + 0.5 * (number / 2.0**31 - 0.5)

    noise = (np.arange(1000) + 0.5) / 1000 - 0.5
    true = float(norm.sf(4.0 * (1.0 - 0.5 * noise)).mean())
    results = [rare(score, 5, 4000, seed).interval for seed in range(20)]
    # Of 20 intervals at 99 %, more than 2 are wrong once in 1,000 times.
    assert sum(not low <= true <= high for low, high in filter(None, results)) <= 2
    assert sum(one is None for one in results) <= 2


def test_what_has_no_cause_in_what_is_drawn_is_counted() -> None:
    def score(_: np.ndarray, number: np.ndarray) -> np.ndarray:
        return 1.2 * np.random.default_rng(number[:4].tolist()).random(len(number))

    found = rare(score, 5, 20_000, 1)
    assert found.interval is not None
    assert found.interval[0] <= 1.0 / 6.0 <= found.interval[1]
    assert found.gain == pytest.approx(1.0)


def test_too_few_flights_are_refused() -> None:
    with pytest.raises(ConfigError, match="count must be at least 1,600"):
        rare(lambda z, _: z[0], 1, 1599, 0)
