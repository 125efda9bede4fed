"""Metrics of very many flights, of which only `rans.flight_statistics.FlightStatistics` is kept."""

from __future__ import annotations

import math
from collections.abc import Iterator

from scipy.stats import binomtest

from rans.episode import Setup
from rans.evaluation.measure.aggregate import Metric, Metrics
from rans.evaluation.measure.metrics import metric_definitions
from rans.evaluation.measure.statistics import NORMAL_95
from rans.flight_statistics import FlightStatistics, Sums
from rans.tasks import Task
from rans.verdict import Failure


def measure_many(statistics: FlightStatistics, controller: str, setup: Setup) -> Metrics:
    """Metrics from statistics, with names and units as in `rans.evaluation.measure.metrics`.

    Intervals are for 95 %: of shares the exact one (Clopper and Pearson, Biometrika 26, 1934), of the median that
    between order statistics by the binomial distribution, of means two standard errors.
    """
    period = setup.timing.control_period
    engine = f"fast; {', '.join(sorted(statistics.ways))}"
    return Metrics(
        controller,
        engine,
        setup.craft.name,
        statistics.flights,
        statistics.steps,
        period,
        tuple(_rows(statistics, period, setup.task)),
    )


def _rows(result: FlightStatistics, period: float, task: Task) -> Iterator[Metric]:
    """Metrics of counts and sums, named as those of stored flights, with exact intervals of shares."""
    count = result.flights
    of_solved, of_time = metric_definitions(task)
    yield _percentage("success", "solved", of_solved, count - result.unsolved, count)
    width = 0.5 * NORMAL_95 / math.sqrt(count)
    median, low, high = (
        period * result.settling_step(level) for level in (0.5, 0.5 - width, 0.5 + width)
    )
    yield Metric("success", "settling time", of_time, "s", median, low, high)
    ended = result.failures[Failure.TERMINATED] + result.failures[Failure.NOT_FINITE]
    yield _percentage("success", "failed", "declared failed by the task at any time", ended, count)
    yield _percentage("failures", "not solved", "in any of these ways", result.unsolved, count)
    for kind, failures in result.failures.items():
        yield _percentage(
            "failures", kind.name.lower().replace("_", " "), kind.meaning, failures, count
        )
    for name, meaning, unit, factor in (
        ("duty at rest", "mean share of thrusters open over the last fifth", "%", 100.0),
        ("impulse", "thrust spent an episode, up to a failure", "N s", 1.0),
        ("return", "sum of rewards of an episode, up to a failure", "", 1.0),
    ):
        yield Metric("effort", name, meaning, unit, *_mean(result.sums[name], factor))


def _percentage(group: str, name: str, meaning: str, successes: int, count: int) -> Metric:
    """A share in percent with its exact interval (Clopper and Pearson)."""
    interval = binomtest(successes, count).proportion_ci(method="exact")
    return Metric(
        group,
        name,
        meaning,
        "%",
        100.0 * successes / count,
        100.0 * interval.low,
        100.0 * interval.high,
    )


def _mean(sums: Sums, factor: float) -> tuple[float, float, float]:
    half = NORMAL_95 * sums.error
    return factor * sums.mean, factor * (sums.mean - half), factor * (sums.mean + half)
