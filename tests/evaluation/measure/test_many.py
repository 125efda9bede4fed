"""Metrics of many flights, by numbers worked out by hand or by other ways."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import binom

from rans.episode import Setup
from rans.evaluation.measure.aggregate import Metrics
from rans.evaluation.measure.many import measure_many
from rans.flight_statistics import FlightStatistics, Sums
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.tasks import GoToPose
from rans.verdict import Failure

COUNT = 10_000
SETUP = Setup(load_spacecraft("floating-platform"), GoToPose(), Timing(episode_steps=5))


def measured(at: list[int], failures: dict[Failure, int]) -> Metrics:
    sums = {
        "return": Sums(2e4, 5e4, COUNT),
        "impulse": Sums(0.0, 0.0, COUNT),
        "duty at rest": Sums(1e3, 1e2, COUNT),
    }
    found = FlightStatistics(
        COUNT,
        5,
        np.array(at),
        dict.fromkeys(Failure, 0) | failures,
        np.zeros(0, np.int64),
        np.zeros(0, np.uint8),
        sums,
    )
    return measure_many(found, "somebody", SETUP)


def test_shares_have_exact_intervals() -> None:
    metrics = measured([0, 9990, 5, 0, 0, 0], {Failure.LEFT: 3, Failure.TERMINATED: 4})
    rate = metrics["not solved"]
    assert rate.value == pytest.approx(0.07)
    # At either end, seven or more, and seven or fewer, have a chance of 2.5 %.
    assert binom.sf(6, COUNT, rate.low / 100) == pytest.approx(0.025, rel=1e-6)
    assert binom.cdf(7, COUNT, rate.high / 100) == pytest.approx(0.025, rel=1e-6)
    assert metrics["solved"].value == pytest.approx(99.93)
    assert (metrics["failed"].value, metrics["left"].value) == pytest.approx((0.04, 0.03))
    none = metrics["late"]
    assert (none.value, none.low) == (0.0, 0.0)
    # None of n: (1 - p)^n = 2.5 %.
    assert none.high == pytest.approx(100 * (1 - 0.025 ** (1 / COUNT)), rel=1e-9)


def test_the_median_has_order_statistics() -> None:
    time = measured([0, 4950, 100, 4950, 0, 0], {})["settling time"]
    # The 5,000th flight settles at the second instant, 0.4 s; 98 flights to either side are at the others.
    assert (time.value, time.low, time.high) == pytest.approx((0.4, 0.2, 0.6))
    assert measured([4000, 0, 0, 0, 0, 0], {})["settling time"].value == math.inf


def test_means_have_standard_errors() -> None:
    metrics = measured([COUNT, 0, 0, 0, 0, 0], {})
    gain = metrics["return"]
    # Mean 2, mean square 5: variance 1, of ten thousand.
    assert gain.value == 2.0
    assert gain.high - gain.value == pytest.approx(1.96 * 0.01, rel=1e-3)
    assert metrics["duty at rest"].value == pytest.approx(10.0)
    assert (metrics.episodes, metrics.steps, metrics.spacecraft) == (COUNT, 5, "floating-platform")
