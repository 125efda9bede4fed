"""Estimates: medians that count failures, intervals that SciPy agrees with, differences that stay paired."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import stats

from rans.evaluation.measure.statistics import Bootstrap, Estimate, figure, share

RANDOM = np.random.default_rng(7)


def test_median_counts_who_never_arrives():
    """Of 3, 5, never and never the middle ones are 5 and never, of which the larger half never arrives."""
    bootstrap = Bootstrap(5)
    assert bootstrap.median(np.array([3.0, 5.0, 4.0, math.inf, math.inf])).value == 5.0
    estimate = bootstrap.median(np.array([3.0, 5.0, math.inf, math.inf, math.inf]))
    assert estimate.value == math.inf
    assert estimate.low < math.inf  # some resamplings hold more of the two that arrive
    assert estimate.text().startswith("never (")


@pytest.mark.parametrize("centre", [np.mean, np.median])
def test_interval_is_that_of_scipy(centre):
    values = RANDOM.lognormal(size=60)
    ours = Bootstrap(60).mean(values) if centre is np.mean else Bootstrap(60).median(values)
    theirs = stats.bootstrap(
        (values,), centre, n_resamples=9999, method="percentile", rng=np.random.default_rng(1)
    ).confidence_interval
    # Both ends are quantiles of random draws: 1,000 of them leave about 0.15 of the interval's width.
    width = theirs.high - theirs.low
    assert ours.low == pytest.approx(theirs.low, abs=0.15 * width)
    assert ours.high == pytest.approx(theirs.high, abs=0.15 * width)


def test_means_of_several_columns_are_of_the_same_draws():
    values = RANDOM.lognormal(size=(60, 1)) * [1.0, 3.0]
    bootstrap = Bootstrap(60)
    drawn = bootstrap.means(values)
    np.testing.assert_allclose(drawn[:, 1], 3.0 * drawn[:, 0], rtol=1e-12)
    one = bootstrap.mean(values[:, 0])
    low, high = np.sort(drawn[:, 0])[[24, 974]]  # the 25th and the 975th of 1,000
    assert (low, high) == pytest.approx((one.low, one.high), rel=1e-12)


def test_differences_are_paired():
    """A constant advantage is known exactly however much the starts differ."""
    easy_and_hard = RANDOM.uniform(1.0, 100.0, 40)
    difference = Bootstrap(40).difference(easy_and_hard + 0.25, easy_and_hard)
    for value in (difference.value, difference.low, difference.high):
        assert value == pytest.approx(0.25)
    assert difference.text("+.3g") != "0"


def test_difference_to_who_never_arrives():
    never = np.full(9, math.inf)
    late = np.full(9, 7.0)
    bootstrap = Bootstrap(9)
    assert bootstrap.difference(never, never) == Estimate(0.0, 0.0, 0.0)
    assert bootstrap.difference(late, never).value == -math.inf
    assert bootstrap.difference(never, late).text() == "never"


@settings(deadline=None)  # SciPy's search for a p-value takes longer in its first call
@given(st.integers(1, 10_000), st.floats(0.0, 1.0))
def test_wilsons_interval_is_that_of_scipy(count, part):
    successes = round(part * count)
    theirs = stats.binomtest(successes, count).proportion_ci(method="wilson")
    ours = share(np.arange(count) < successes)
    # The quantile of the normal distribution has seven digits here.
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), rel=1e-6, abs=1e-12)
    assert 0.0 <= ours.low <= ours.value <= ours.high <= 1.0


def test_a_ratio_is_of_means_and_its_interval_too():
    """Half of the starts give 1 of 1, half 1 of 9: 100 of 500 are 20 %, the mean of the ratios is 56 %.

    The reference's mean is 5 with a standard error of 4 / sqrt(100): the ends are 1 / 5.8 and 1 / 4.2.
    """
    found = Bootstrap(100).ratio(np.ones(100), np.tile([1.0, 9.0], 50))
    assert found.value == pytest.approx(0.2)
    # A third of a standard error, as above: 0.34 x 0.4 of 5 is 3 %.
    assert (found.low, found.high) == pytest.approx((1 / 5.78, 1 / 4.22), rel=0.035)


def test_texts_of_estimates():
    assert Estimate(2.0, 1.0, math.inf).text() == "2 (1 to never)"
    assert Estimate(1.23456, 1.23456, 1.23456).text() == "1.23"
    assert Estimate(5.0, 2.0, 2.0).text() == "5 (2 to 2)"
    assert Estimate(-math.inf, -math.inf, -0.5).text("+.3g") == "-never (-never to -0.5)"
    assert Estimate(math.nan, 1.0, 2.0).text() == "- (1 to 2)"
    assert Estimate(1.0, 0.5, 2.0).scaled(100.0) == Estimate(100.0, 50.0, 200.0)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1153.4, "1,153"),
        (999.6, "1,000"),
        (-20500.0, "-20,500"),
        (998.0, "998"),
        (1e7, "1e+07"),
        (0.00123, "0.00123"),
        (math.inf, "never"),
        (-math.inf, "-never"),
        (math.nan, "-"),
    ],
)
def test_thousands_have_no_exponent(value, text):
    assert figure(value) == text
