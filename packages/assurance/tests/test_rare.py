"""Estimates of rare events have no bias, and claim no interval but that of a count."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from rans_assurance.assure.rare import Rare, rare
from scipy.stats import chi2, norm

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
MANY = math.sqrt(chi2.isf(1e-6, 60))
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
    # Two errors that must be large together, beside failures by sixty small ones: all ways miss it.
    "two_sixty": Failures(
        lambda z: np.maximum(z[:2].min(axis=0) / 2.9, np.linalg.norm(z[2:], axis=0) / MANY),
        62,
        _any(float(norm.sf(2.9)) ** 2, 1e-6),
    ),
}


def _repeated(name: str, repetitions: int) -> list[Rare]:
    failures = SETS[name]
    return [
        rare(lambda z, _: failures.score(z), failures.dimensions, 4000, seed)
        for seed in range(repetitions)
    ]


def test_what_is_not_counted_claims_no_interval() -> None:
    for one in _repeated("two_sixty", 3):
        assert not one.is_counted
        assert one.interval is None
        assert "no bound" in one.summary or "no estimate" in one.summary


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in SETS if name != "two_sixty"])
def test_estimates_have_no_bias(name: str) -> None:
    """The mean of 20 is within four of its own standard errors. That of two_sixty stands on rare, large ones."""
    results = _repeated(name, 20)
    estimates = np.array([one.probability for one in results]) / SETS[name].probability
    assert abs(estimates.mean() - 1.0) < 4.0 * estimates.std() / math.sqrt(20)
    # Where larger errors lead to failures, there is an answer: as often as it was found, and twice more.
    assert sum(not one.is_estimated for one in results) <= 6


@pytest.mark.parametrize("limit", [2.0, 4.5])
def test_many_flights_tell_more(limit: float) -> None:
    # The mean of 20 normal numbers, in its own standard deviation.
    found = rare(lambda z, _: z.sum(axis=0) / np.sqrt(20) / limit, 20, 20_000, 0)
    true = norm.sf(limit)
    assert found.is_estimated
    assert found.is_counted == (limit == 2.0)
    # The groups' own standard error, of which four are wrong once in 16,000 times.
    assert abs(found.probability - true) < 4.0 * found.error
    if found.interval is not None:
        assert found.interval[0] <= true <= found.interval[1]
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
    assert all(not one.is_estimated and "no estimate" in one.summary for one in some)


def test_a_group_that_alone_met_a_frequent_cause_is_believed_no_more_than_the_others() -> None:
    agree = Rare((1e-6,) * 15 + (2e-6,), 10, 20_000, 4000, 0)
    differ = Rare((1e-6,) * 15 + (2e-5,), 10, 20_000, 4000, 0)
    assert agree.is_estimated
    assert not differ.is_estimated
    assert "differ (1e-06 to 2e-05)" in differ.summary


def test_another_way_that_meets_more_failures_leaves_no_estimate() -> None:
    agree = (1e-6,) * 15 + (2e-6,)
    more = (1e-5,) * 15 + (2e-5,)
    assert Rare(agree, 10, 20_000, 4000, 0, (agree, agree)).is_estimated
    missed = Rare(agree, 10, 20_000, 4000, 0, (agree, more))
    assert not missed.is_estimated
    assert "1.06e-05, as where kinds of failure differ in pace" in missed.summary
    # One that meets less is what it is there to show: it was led astray.
    assert Rare(more, 10, 20_000, 4000, 0, (agree, agree)).is_estimated


def test_failures_that_larger_errors_jump_over_are_noticed() -> None:
    """A band of failures so narrow that no factor on the errors lands in it, but the score leads there."""

    def score(z: np.ndarray, _: np.ndarray) -> np.ndarray:
        fails = (z[0] > 4.0) & (z[0] < 4.02)
        return np.where(fails, 1.0, 0.99 - 0.2 * np.abs(z[0] - 4.01))

    results = [rare(score, 2, 2000, seed) for seed in range(3)]
    assert not any(one.is_estimated for one in results)


@pytest.mark.slow
def test_failures_by_noise_are_estimated_right() -> None:
    """The number of an episode decides beside what is drawn: a uniform number between -1/4 and 1/4."""

    def score(z: np.ndarray, number: np.ndarray) -> np.ndarray:
        return z[0] / 4.0 + 0.5 * (number / 2.0**31 - 0.5)

    noise = (np.arange(1000) + 0.5) / 1000 - 0.5
    true = float(norm.sf(4.0 * (1.0 - 0.5 * noise)).mean())
    results = [rare(score, 5, 4000, seed).probability / true for seed in range(20)]
    # The mean of 20 is within four of its own standard errors.
    assert abs(np.mean(results) - 1.0) < 4.0 * np.std(results) / math.sqrt(20)


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
