"""Search over on/off pulses: what it begins with, how it judges a miss, and that it finds a way from one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rans_missions.improve.judging import Burns
from rans_missions.improve.pulses import rounded, shortfall
from rans_missions.improve.search import improve

from rans.episode import Setup
from rans.evaluation.measure.metrics import impulses
from rans.flight import Flight, fly
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.scenario import Scenario, scenarios
from rans.tasks import GoToPosition

CRAFT = load_spacecraft("floating-platform")
NEAR = 0.3
"""Distance of the starts from the goal, m: six tolerances."""
TASK = GoToPosition(evaluation_distance=(NEAR, NEAR)).for_evaluation()
SETUP = Setup(CRAFT, TASK, Timing(episode_steps=30))
EYE = np.eye(CRAFT.thruster_count)


def starts(count: int) -> Scenario:
    return scenarios(TASK, CRAFT, 2023, count)


def flown(commands: np.ndarray) -> Flight:
    return fly(CRAFT, TASK, Burns(commands, EYE), starts(commands.shape[1]), SETUP.timing)


@given(st.integers(0, 10_000), st.floats(0.01, 1.0))
def test_pulses_stay_and_their_sums_keep_to_those_of_the_commands(seed: int, offset: float) -> None:
    random = np.random.default_rng(seed)
    pulses = (random.random((40, 3)) < 0.2).astype(float)
    np.testing.assert_array_equal(rounded(pulses, offset), pulses)
    throttled = random.random((40, 3)) * random.random(3)
    found = rounded(throttled, offset)
    assert set(np.unique(found)) <= {0.0, 1.0}
    away = np.cumsum(found, axis=0) - np.cumsum(throttled, axis=0)
    assert np.abs(away).max() <= 1.0 + 1e-6


def test_a_miss_is_measured_in_tolerances_of_the_worst_instant_at_the_end() -> None:
    """A craft that rests at six tolerances misses by five, and one that drifts past its goal by more at the end."""
    coast = np.zeros((30, 1, CRAFT.thruster_count))
    assert shortfall(flown(coast))[0] == pytest.approx(NEAR / TASK.position_tolerance - 1.0)
    pushed = coast.copy()
    pushed[0, 0] = 1.0
    flight = flown(pushed)
    last = flight.errors()["position"][-6:, 0]
    assert shortfall(flight)[0] == pytest.approx(last.max() / TASK.position_tolerance - 1.0)


def test_a_broken_limit_counts_beside_the_errors() -> None:
    flight = flown(np.zeros((30, 2, CRAFT.thruster_count)))
    margin = np.full((30, 2), 0.1)
    margin[3, 1] = -0.1
    near, broken = shortfall(replace(flight, margins={"zone": margin}))
    assert broken == pytest.approx(near + 2.0)


def test_a_search_finds_pulses_from_a_flight_that_misses_its_goal() -> None:
    """From a coast at rest, six tolerances away."""
    coast = np.zeros((30, 1, CRAFT.thruster_count))
    found = improve(SETUP, starts(1), [Burns(coast, EYE)], rounds=12)
    assert np.isnan(found.before[0])
    assert set(np.unique(found.changes)) <= {0.0, 1.0}
    flight = flown(found.changes)
    assert np.asarray(flight.verdict.solved).all()
    np.testing.assert_allclose(impulses(flight), found.after, rtol=1e-9)
    # A push and one back are the least with which a craft at rest comes to rest elsewhere.
    assert found.after[0] >= 2.0 * 0.2 - 1e-9
