"""Estimates: medians that count failures, intervals that SciPy agrees with, differences that stay paired."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from rans.evaluation.measure.statistics import Bootstrap, Estimate, share

RANDOM = np.random.default_rng(7)


def test_median_counts_who_never_arrives() -> None:
    """Of 3, 5, never and never the middle ones are 5 and never, of which the larger half never arrives."""
    bootstrap = Bootstrap(5)
    assert bootstrap.median(np.array([3.0, 5.0, 4.0, math.inf, math.inf])).value == 5.0
    estimate = bootstrap.median(np.array([3.0, 5.0, math.inf, math.inf, math.inf]))
    assert estimate.value == math.inf
    assert estimate.low < math.inf  # some resamplings hold more of the two that arrive
    assert estimate.text().startswith("never (")


@pytest.mark.parametrize("centre", [np.mean, np.median])
def test_interval_is_that_of_scipy(centre: object) -> None:
    values = RANDOM.lognormal(size=60)
    ours = Bootstrap(60).mean(values) if centre is np.mean else Bootstrap(60).median(values)
    theirs = stats.bootstrap((values,), centre, n_resamples=9999, method="percentile",
                             rng=np.random.default_rng(1)).confidence_interval
    # Both ends are quantiles of random draws: 1,000 of them leave about 0.15 of the interval's width.
    width = theirs.high - theirs.low
    assert ours.low == pytest.approx(theirs.low, abs=0.15 * width)
    assert ours.high == pytest.approx(theirs.high, abs=0.15 * width)


def test_differences_are_paired() -> None:
    """A constant advantage is known exactly however much the starts differ."""
    easy_and_hard = RANDOM.uniform(1.0, 100.0, 40)
    difference = Bootstrap(40).difference(easy_and_hard + 0.25, easy_and_hard)
    for value in (difference.value, difference.low, difference.high):
        assert value == pytest.approx(0.25)
    assert difference.text("+.3g") != "0"


def test_difference_to_who_never_arrives() -> None:
    never, late = np.full(9, math.inf), np.full(9, 7.0)
    bootstrap = Bootstrap(9)
    assert bootstrap.difference(never, never) == Estimate(0.0, 0.0, 0.0)
    assert bootstrap.difference(late, never).value == -math.inf
    assert bootstrap.difference(never, late).text() == "never"


def test_ratio_of_returns() -> None:
    """Twice the reference is 2 from whatever starts are drawn; the mean ratio of unequal ones is not."""
    reference = RANDOM.uniform(1.0, 5.0, 30)
    twice = Bootstrap(30).ratio(2.0 * reference, reference)
    assert [twice.value, twice.low, twice.high] == pytest.approx([2.0] * 3)
    ratio = Bootstrap(2).ratio(np.array([1.0, 3.0]), np.array([2.0, 2.0]))
    assert ratio.value == 1.0
    assert (ratio.low, ratio.high) == (0.5, 1.5)


def test_share_has_a_width_even_where_all_succeed() -> None:
    """Wilson's lower end for 20 of 20 is 1 / (1 + z^2 / 20) = 0.839."""
    estimate = share(np.ones(20, dtype=bool))
    assert (estimate.value, estimate.high) == (1.0, 1.0)
    assert estimate.low == pytest.approx(0.839, abs=5e-4)


def test_json_has_no_infinities() -> None:
    assert Estimate(2.0, 1.0, math.inf).to_json() == [2.0, 1.0, None]
