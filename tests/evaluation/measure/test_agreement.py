"""The engines' agreement is judged as it should be, and an agent flown on many processes is the same."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rans.evaluation.measure.agreement import compare_engines
from rans.model.fields import map_leaves
from tests.support.evaluation_flights import TrackNothing, flight_of, many_episodes


def moved(flight: Any, way: Any) -> Any:
    """The same flight, farther from its goal by a way, of all episodes or one of each."""
    states = replace(flight.states, p=replace(flight.states.p, x=flight.states.p.x - way))
    return replace(flight, states=states, engine="drake")


def test_equal_flights_agree():
    flight = many_episodes(40)
    comparison = compare_engines(flight, replace(flight, engine="drake"))
    assert comparison.passed
    assert comparison.same_commands == 1.0
    assert [pair.difference for pair in comparison.pairs] == [0.0] * 4


@pytest.mark.parametrize(("way", "agrees"), [(0.9e-3, True), (1.1e-3, False)])
def test_a_millimetre_is_the_bound_of_the_position(way, agrees):
    flight = many_episodes(40)
    comparison = compare_engines(flight, moved(flight, way))
    pair = {p.name: p for p in comparison.pairs}["position error"]
    assert pair.difference == pytest.approx(100 * way, rel=1e-9)
    assert (pair.passed, comparison.passed) == (agrees, agrees)


def test_an_engine_that_loses_its_numbers_disagrees():
    flight = many_episodes(8)
    assert compare_engines(flight, moved(flight, np.nan)).passed is False


def test_fewer_solved_than_the_interval_allows_fail():
    """40 of 40 solved have the interval 91.2 % to 100 %: 37 may be, 36 may not."""
    flight = many_episodes(40)
    flight = replace(
        flight,
        states=map_leaves(lambda x: 0.0 * x, flight.states),
        goals=map_leaves(lambda x: 0.0 * x, flight.goals),
    )
    for lost, passed in ((3, True), (4, False)):
        way = np.zeros(40)
        way[:lost] = 1.0
        pair = compare_engines(flight, moved(flight, way)).pairs[0]
        assert (pair.drake.value, pair.passed) == (100.0 - 2.5 * lost, passed)


@pytest.mark.parametrize(
    ("task", "bound"),
    [
        (None, {"error_degrees": 0.1}),
        (TrackNothing(), {"speed": (1e-3, 0.0)}),
        (TrackNothing(), {"spin": math.radians(0.1)}),
    ],
    ids=["attitude", "velocity", "spin"],
)
@pytest.mark.parametrize("share", [0.9, 1.1])
def test_bounds_of_the_others(task, bound, share):
    still: dict[str, Any] = {"distance": np.ones((11, 1)), "error_degrees": 0.0, "task": task}
    flown: dict[str, Any] = still | {name: share * np.array(value) for name, value in bound.items()}
    assert compare_engines(flight_of(**still), flight_of(**flown)).passed is (share < 1.0)
