"""Counts and sums over many flights, by hand."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rans.episode.flight_statistics import QUANTITIES, FlightStatistics, Sums
from tests.support.engines import PLATFORM


def test_sums_have_the_mean_and_its_error():
    values = np.array([1.0, 4.0, 7.0, 8.0])
    sums = Sums.of(values[:1]) + Sums.of(values[1:])
    assert sums.mean == 5.0
    # Deviations -4, -1, 2, 3: variance 30 / 3, over four flights.
    assert sums.error == pytest.approx(math.sqrt(10 / 4), rel=1e-12)
    assert math.isnan(Sums().mean)
    assert math.isnan(Sums.of(values[:1]).error)


def statistics(
    numbers: list[int], kinds: list[int], settled: list[int], listed: int = 3
) -> FlightStatistics:
    """Four flights of two steps, of which those with these numbers failed."""
    failure = np.zeros(4, np.int64)
    failure[: len(kinds)] = kinds
    all_ = np.array([*numbers, *range(100, 104 - len(numbers))])
    at = np.array([*settled, *[0] * (4 - len(settled))])
    world: Any = SimpleNamespace(timing=SimpleNamespace(episode_steps=2), craft=PLATFORM)
    return FlightStatistics.of(world, all_, (failure, at), [np.ones(4)] * 3, listed, "by hand")


def test_verdicts_add_up():
    both = (
        statistics([9, 5], [2, 3], [3, 1])
        + statistics([1, 7], [3, 5], [3, 2])
        + FlightStatistics.none(2, 3)
    )
    assert (both.flights, both.unsolved, both.settled_at.sum()) == (8, 4, 4)
    assert {kind.name: count for kind, count in both.failures.items()} == {
        "NOT_FINITE": 0,
        "TERMINATED": 1,
        "LEFT": 2,
        "UNSETTLED": 0,
        "LATE": 1,
        "VIOLATED": 0,
        "UNFINISHED": 0,
    }
    # Numbers rise, and the fourth is beyond what is listed.
    assert both.numbers.tolist() == [1, 5, 7]
    assert both.kinds.tolist() == [3, 3, 5]
    assert both.settled_at.tolist() == [4, 0, 0]
    assert both.sums["return"].mean == 1.0
    assert set(both.sums) == set(QUANTITIES)
    assert both.ways == {"by hand"}


def test_the_instant_by_which_a_share_is_settled():
    found = statistics([9], [2], [0, 1, 1, 2])
    assert [found.settling_step(share) for share in (0.25, 0.5, 0.75, 0.76)] == [
        1.0,
        1.0,
        2.0,
        math.inf,
    ]
    assert FlightStatistics.none(2).settling_step() == math.inf
