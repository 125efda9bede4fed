"""Verdicts of a stress report, by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rans_assurance.stress.outcome import StressOutcome, holds_to

from rans import Timing
from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.evaluation.measure.metrics import solved
from rans.evaluation.measure.statistics import Estimate
from rans.model.spacecraft_file import load_spacecraft
from tests.support.evaluation_flights import flight_of, two_episodes
from tests.support.missions import Pass


def shares(*values: float) -> list[Estimate]:
    return [Estimate(x, x - 0.02, x + 0.02) for x in values]


def test_outcomes_are_the_largest_errors_of_the_last_fifth():
    """Tolerances are 5 cm and 5 degrees; the last fifth are two of ten steps."""
    found = StressOutcome.of(two_episodes())
    np.testing.assert_allclose(found.errors["position"], [0.004, 0.06], rtol=1e-12)
    np.testing.assert_allclose(np.degrees(found.errors["attitude"]), [0.5, 0.0], atol=1e-9)
    np.testing.assert_allclose(found.excess, [0.1, 1.2], rtol=1e-9)
    assert found.solved.tolist() == [True, False] == solved(two_episodes()).tolist()
    assert found.worst(3) == [1]


def test_a_mission_won_past_a_broken_limit_is_not_solved():
    """Every start passes the wall at -0.5 m on its way, and then succeeds."""
    task = Pass(wall=-0.5, violation_ends=False)
    craft = load_spacecraft("floating-platform")
    shut: Any = SimpleNamespace(name="shut", reset=lambda count: None)
    shut.act = lambda state, goal, observation: np.zeros((len(observation), craft.thruster_count))
    flight = fly(craft, task, shut, scenarios(task, craft, seed=1, count=3), Timing(1.0, 1, 5, 4))
    assert flight.done is not None
    assert flight.done.all()
    assert StressOutcome.of(flight).solved.tolist() == [False] * 3


def test_who_is_lost_is_farthest():
    found = StressOutcome.of(flight_of([[1.0, 1.0, 0.0]] * 5 + [[0.2, np.nan, 0.0]], 0.0))
    assert found.excess.tolist() == [pytest.approx(4.0), np.inf, 0.0]
    assert found.worst(5) == [1, 0]
    assert found.worst(1) == [1]
    again = StressOutcome.joined([found, found])
    assert again.worst(9) == [1, 4, 0, 3]
    assert again.share.value == pytest.approx(1 / 3)


@pytest.mark.parametrize(
    ("values", "limit"),
    [
        ((1.0, 1.0, 1.0), (2.0, True)),
        ((1.0, 0.99, 0.5), (1.0, True)),
        ((0.98, 1.0, 1.0), (None, True)),
        ((1.0, 0.5, 1.0), (0.0, True)),
        ((1.0, 0.5, None), (0.0, True)),
        ((1.0, 1.0, None), (1.0, False)),
        ((1.0, None, 0.5), (0.0, False)),
        ((None, 1.0, 1.0), (None, False)),
    ],
)
def test_to_which_size_somebody_holds(values, limit):
    """A size counts only if all smaller ones are flown and solved too."""
    rates = [None if value is None else shares(value)[0] for value in values]
    assert holds_to([0.0, 1.0, 2.0], rates) == limit
