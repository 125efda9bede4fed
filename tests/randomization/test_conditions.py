"""Conditions that cannot be are refused in sentences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rans import (
    BodyConditions,
    Conditions,
    GoToPose,
    SensorConditions,
    SensorsConditions,
    ThrusterConditions,
)
from rans.episode.step import Episode, Setup, World
from rans.model.fields import leaves
from rans.model.random import Draws
from rans.model.spacecraft_file import load_spacecraft
from rans.randomization.conditions import (
    BodyConditions as Body,
    FaultConditions as Faults,
    ThrusterConditions as Thrusters,
)
from rans.randomization.parameters import EpisodeParameters


def test_how_long_a_command_is_felt():
    """Until its ramp is over, begun after both delays."""
    lag = Thrusters(latency=(0.0, 0.1), command_delay=0.2, rise=(0.0, 0.08))
    assert Conditions(thrusters=lag).delay == pytest.approx(0.3)
    assert Conditions(thrusters=lag).lasting == pytest.approx(0.38)
    assert Conditions(thrusters=Thrusters(rise=0.05)).lasting == 0.05


def test_which_thrusters_are_known_to_be_dead():
    """Only if nothing else can happen to them, and nothing happens later."""
    dead = Conditions(faults=Faults(kinds=("dead",), thrusters=(4, 1)), description="without two")
    assert (dead.dead, dead.only_dead) == ((4, 1), True)
    heavy = replace(dead, body=Body(mass=1.1))
    assert (heavy.dead, heavy.only_dead) == ((4, 1), False)
    later = replace(dead, others=(replace(dead, faults=replace(dead.faults, time=3.0)),))
    for other in (
        Conditions(),
        Conditions(faults=Faults(count=1.0, kinds=("dead",))),
        Conditions(faults=Faults(thrusters=(1,))),
        later,
    ):
        assert (other.dead, other.only_dead) == ((), False)


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


def test_an_episode_meets_one_of_them_as_often_as_its_weight_says():
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


def test_one_of_equals_draws_what_it_draws_alone():
    """Choosing takes numbers of a stream of its own."""
    alone = drawn(LATE)
    chosen = drawn(replace(LATE, others=(LATE, LATE)))
    for one, other in zip(leaves(alone), leaves(chosen), strict=True):
        assert np.array_equal(one, other)


def test_single_precision_stays_so():
    assert {x.dtype for x in leaves(drawn(MIXED, np.float32)) if isinstance(x, np.ndarray)} == {
        np.dtype("float32"),
        np.dtype("int32"),
    }


def test_episodes_remember_for_the_longest_of_them():
    """0.3 s of latency are felt for two periods of 0.2 s, a valve that holds for 0.7 s for four."""
    assert World(Setup(PLATFORM, GoToPose(), conditions=MIXED)).remembered == 2
    slow = Conditions(thrusters=ThrusterConditions(least_on=0.7))
    assert (
        World(Setup(PLATFORM, GoToPose(), conditions=replace(LATE, others=(slow,)))).remembered == 4
    )
