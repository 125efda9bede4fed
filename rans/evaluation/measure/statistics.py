"""Estimates with 95 % bootstrap intervals, of everybody over the same resampled starts."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rans.evaluation.measure.engines import wilson
from rans.evaluation.measure.summary import RESAMPLES


@dataclass(frozen=True)
class Estimate:
    """A value and its interval; infinite where most flights never get there."""

    value: float
    low: float
    high: float

    def text(self, digits: str = ".3g") -> str:
        """As tables show it."""
        value, low, high = (_text(x, digits) for x in (self.value, self.low, self.high))
        return value if value == low == high else f"{value} ({low} to {high})"

    def to_json(self) -> list[float | None]:
        """Value, low and high; null where infinite."""
        return [x if math.isfinite(x) else None for x in (self.value, self.low, self.high)]


def _text(value: float, digits: str) -> str:
    if math.isnan(value):
        return "-"
    return ("never" if value > 0 else "-never") if math.isinf(value) else format(value, digits)


class Bootstrap:
    """Percentile bootstrap over starts (Efron and Tibshirani, 1993, section 13.3).

    All estimates of one comparison draw the same starts, so that they stay paired.

    Args:
        count: of starts.
        seed: of the draws; the same seed gives the same intervals.
    """

    def __init__(self, count: int, seed: int = 0) -> None:
        self._picks = np.random.default_rng(seed).integers(0, count, (RESAMPLES, count))

    def median(self, values: np.ndarray) -> Estimate:
        """Of (N,) values; infinity is a value like any other, and larger than all."""
        return self._of(np.median, values)

    def mean(self, values: np.ndarray) -> Estimate:
        """Of (N,) finite values."""
        return self._of(np.mean, values)

    def ratio(self, values: np.ndarray, reference: np.ndarray) -> Estimate:
        """Mean of (N,) values as a share of the mean of the reference from the same starts."""
        draws = values[self._picks].mean(axis=1) / reference[self._picks].mean(axis=1)
        return _interval(float(values.mean() / reference.mean()), draws)

    def difference(self, values: np.ndarray, reference: np.ndarray) -> Estimate:
        """Median of the differences per start; 0 where neither of two gets there."""
        both = np.isinf(values) & np.isinf(reference)
        with np.errstate(invalid="ignore"):
            return self.median(np.where(both, 0.0, values - reference))

    def _of(self, centre: Callable[..., Any], values: np.ndarray) -> Estimate:
        with np.errstate(invalid="ignore"):  # the median between infinities of both signs
            return _interval(float(centre(values)), centre(values[self._picks], axis=1))


def share(successes: np.ndarray) -> Estimate:
    """Share of successes, (N,) truth values, with Wilson's score interval."""
    value = float(np.mean(successes))
    return Estimate(value, *wilson(value, len(successes)))


def _interval(value: float, draws: np.ndarray) -> Estimate:
    # "inverted_cdf" takes an order statistic: interpolating between two infinities gives NaN.
    low, high = np.quantile(draws, (0.025, 0.975), method="inverted_cdf")
    return Estimate(value, float(low), float(high))
