"""Conditions of which an episode meets one of several."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from rans.episode import Episode, Setup, World
from rans.errors import ConfigError
from rans.model.fields import leaves
from rans.model.random import Draws
from rans.model.spacecraft_file import load_spacecraft
from rans.randomization.conditions import (
    BodyConditions,
    Conditions,
    FaultConditions,
    SensorConditions,
    SensorsConditions,
    ThrusterConditions,
)
from rans.randomization.parameters import EpisodeParameters
from rans.structure import structure
from rans.tasks import GoToPose

PLATFORM = load_spacecraft("floating-platform")
LATE = Conditions(thrusters=ThrusterConditions(latency=(0.1, 0.3)))
HEAVY = Conditions(body=BodyConditions(mass=2.0), weight=2.0)
NOISY = Conditions(sensors=SensorsConditions(SensorConditions(noise=0.05)))
MIXED = replace(LATE, others=(HEAVY, NOISY, Conditions()))
COUNT = 40_000


def drawn(conditions: Conditions, dtype: type = np.float64) -> EpisodeParameters:
    draws = Draws(1, 2, np.arange(COUNT, dtype=np.int32), 0, dtype)
    case = (
        World(Setup(PLATFORM, GoToPose(), conditions=conditions))
        .recalled(Episode(None, None), draws)
        .parameters
    )
    assert case is not None
    return case


def test_an_episode_meets_one_of_them_as_often_as_its_weight_says() -> None:
    case = drawn(MIXED)
    assert case.lag is not None
    assert case.sensors is not None
    assert case.sensors.noise is not None
    late = case.lag.latency > 0.0
    heavy = case.body.mass > 1.5 * PLATFORM.mass
    noisy = case.sensors.noise[0] > 0.0
    assert (late.astype(int) + heavy + noisy).max() == 1
    # Weights 1, 2, 1, 1 of 5; four standard deviations of a share of 40,000 are at most 0.01.
    shares = [x.mean() for x in (late, heavy, noisy)]
    np.testing.assert_allclose(shares, [0.2, 0.4, 0.2], atol=0.01)
    np.testing.assert_allclose(case.body.mass[heavy], 2.0 * PLATFORM.mass)
    latencies = case.lag.latency[late]
    assert 0.1 <= latencies.min() < 0.105
    assert 0.295 < latencies.max() <= 0.3
    assert set(case.sensors.noise[0]) == {0.0, 0.05}


def test_one_of_equals_draws_what_it_draws_alone() -> None:
    """Choosing takes numbers of a stream of its own."""
    alone = drawn(LATE)
    chosen = drawn(replace(LATE, others=(LATE, LATE)))
    for one, other in zip(leaves(alone), leaves(chosen), strict=True):
        assert np.array_equal(one, other)


def test_single_precision_stays_so() -> None:
    assert {x.dtype for x in leaves(drawn(MIXED, np.float32)) if isinstance(x, np.ndarray)} == {
        np.dtype("float32"),
        np.dtype("int32"),
    }


def test_episodes_remember_for_the_longest_of_them() -> None:
    """0.3 s of latency are felt for two periods of 0.2 s, a valve that holds for 0.7 s for four."""
    assert World(Setup(PLATFORM, GoToPose(), conditions=MIXED)).remembered == 2
    slow = Conditions(thrusters=ThrusterConditions(least_on=0.7))
    assert (
        World(Setup(PLATFORM, GoToPose(), conditions=replace(LATE, others=(slow,)))).remembered == 4
    )


def test_they_go_to_json_and_back() -> None:
    assert structure(json.loads(json.dumps(asdict(MIXED))), Conditions, "conditions") == MIXED


def test_what_cannot_be_mixed() -> None:
    with pytest.raises(ConfigError, match=r"others must be without others of their own"):
        Conditions(others=(MIXED,))
    with pytest.raises(ConfigError, match=r"others: faults\.kinds must be as in the first"):
        Conditions(others=(Conditions(faults=FaultConditions(1.0, ("weak",))),))
    with pytest.raises(ConfigError, match=r"others: thrusters\.fall must be as in the first"):
        Conditions(others=(Conditions(thrusters=ThrusterConditions(fall=0.1)),))
    with pytest.raises(ConfigError, match="weight must be a finite number > 0, got 0"):
        Conditions(weight=0.0)
