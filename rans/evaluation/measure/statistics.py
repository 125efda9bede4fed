"""Estimates with 95 % intervals, over the same resampled episodes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rans.base.errors import counted

RESAMPLES = 1000
"""Number of bootstrap resamples: 25 of them lie beyond each end of a 95 % interval."""

SEED = 0
"""Seed of the resamples, so that equal flights have equal intervals."""

_TAILS = (0.025, 0.975)
"""Quantiles between which 95 % lie."""
NORMAL_95 = 1.959964
"""97.5 % quantile of the standard normal distribution."""

WANTED = 0.99
"""Share of solved episodes from which an effect counts as tolerated, and a task as solved."""

_FEWEST = math.ceil(NORMAL_95**2 * WANTED / (1.0 - WANTED))
"""Fewest episodes that show it: with n of n solved, Wilson's lower end is n / (n + z^2)."""


@dataclass(frozen=True)
class Estimate:
    """A value and its interval; infinite if the event of most flights never happens."""

    value: float
    low: float
    high: float

    def text(self, digits: str = ".3g") -> str:
        """Value and interval as in tables."""
        value, low, high = (figure(x, digits) for x in (self.value, self.low, self.high))
        return value if value == low == high else f"{value} ({low} to {high})"

    def scaled(self, factor: float) -> Estimate:
        """The estimate in another unit."""
        return Estimate(factor * self.value, factor * self.low, factor * self.high)


def figure(value: float, digits: str = ".3g") -> str:
    """A number as in tables: "never" for an infinite time, a dash for NaN.

    Thousands have no exponent: 1,153 rather than 1.15e+03.
    """
    if math.isnan(value):
        return "-"
    if math.isinf(value):
        return "never" if value > 0 else "-never"
    text = format(value, digits)
    return f"{value:,.0f}" if "e+" in text and abs(value) < 1e6 else text


def quantity(value: float, unit: str) -> str:
    """A `figure` with its unit, if it is a number and has one."""
    return f"{figure(value)} {unit}".rstrip() if math.isfinite(value) else figure(value)


def interval(low: float, high: float) -> str:
    """An interval as in tables; of two infinite times "never" alone."""
    ends = figure(low), figure(high)
    return ends[0] if math.isinf(low) and low == high else f"{ends[0]} to {ends[1]}"


class Bootstrap:
    """Percentile bootstrap over episodes (Efron and Tibshirani, 1993, section 13.3).

    All estimates of one evaluation or comparison draw the same episodes, so that they stay paired; equal numbers of
    episodes draw the same. An interval has no width if all episodes agree; after N of N successes a failure
    probability of about 3/N is still possible at 95 % (rule of three).
    """

    def __init__(self, count: int) -> None:
        self._picks = np.random.default_rng(SEED).integers(0, count, (RESAMPLES, count))

    def means(self, values: np.ndarray) -> np.ndarray:
        """(RESAMPLES, K) means of (N, K) values, one row for each resample."""
        times = np.array([np.bincount(picks, minlength=len(values)) for picks in self._picks])
        return times @ values / len(values)

    def median(self, values: np.ndarray) -> Estimate:
        """Median of (N,) values; infinity is a value too, the largest."""
        return self.of(np.median, values)

    def mean(self, values: np.ndarray) -> Estimate:
        """Mean of (N,) finite values."""
        return self.of(np.mean, values)

    def ratio(self, values: np.ndarray, reference: np.ndarray) -> Estimate:
        """Mean of (N,) values over the mean of the reference from the same starts."""
        draws = values[self._picks].mean(axis=1) / reference[self._picks].mean(axis=1)
        return _interval(float(values.mean() / reference.mean()), draws)

    def difference(self, values: np.ndarray, reference: np.ndarray) -> Estimate:
        """Median of the differences per start; a difference of two infinite values is 0."""
        both = np.isinf(values) & np.isinf(reference)
        with np.errstate(invalid="ignore"):
            return self.median(np.where(both, 0.0, values - reference))

    def of(self, centre: Callable[..., Any], values: np.ndarray) -> Estimate:
        """``np.mean`` or ``np.median`` of (N,) values."""
        with np.errstate(invalid="ignore"):  # the median between infinities of both signs
            return _interval(float(centre(values)), centre(values[self._picks], axis=1))


def share(successes: np.ndarray) -> Estimate:
    """Share of successes, (N,) truth values, with Wilson's score interval.

    It has a width even at 0 and 1 (Wilson, JASA 22, 1927). SciPy's `binomtest` gives the same ends, and tests hold
    these against it; its module takes as long to import as an evaluation to fly.
    """
    value = float(np.mean(successes))
    count = len(successes)
    z2 = NORMAL_95**2
    centre = value + z2 / (2 * count)
    whole = 1 + z2 / count
    half = NORMAL_95 * math.sqrt(value * (1 - value) / count + z2 / (4 * count**2))
    # Exact ends without failures or successes, where rounding would leave 1e-17.
    low = 0.0 if value == 0.0 else (centre - half) / whole
    high = 1.0 if value == 1.0 else (centre + half) / whole
    return Estimate(value, low, high)


def _interval(value: float, draws: np.ndarray) -> Estimate:
    # "inverted_cdf" takes an order statistic: interpolating between two infinities gives NaN.
    low, high = np.quantile(draws, _TAILS, method="inverted_cdf")
    return Estimate(value, float(low), float(high))


def wanted(count: int) -> str:
    """What is asked of a number of episodes: 99 %, which are all of them where one alone is more than 1 %."""
    if (count - 1) / count < WANTED:
        return f"all of {counted(count, 'episode')}"
    return f"at least {100.0 * WANTED:g} % of the episodes"


def too_few(count: int) -> str:
    """Sentence that a number of episodes, even if all are solved, does not show 99 %; "" if it can."""
    if count >= _FEWEST:
        return ""
    low = math.floor(1000.0 * share(np.ones(count)).low) / 10.0
    return (
        f"{counted(count, 'episode')} cannot show {100.0 * WANTED:g} %: with all solved, the share is at least "
        f"{low:g} % at 95 % confidence; at least {_FEWEST} are needed."
    )
