"""Least pulses and kinds of thrusters that differ between episodes, against craft whose files have them."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

import rans
from rans.episode import Setup, World
from rans.errors import ConfigError
from rans.flight import Flight, fly
from rans.model.actuators import OnOff, Pulsed, Throttle
from rans.model.fields import leaves, map_leaves
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions
from rans.randomization.parameters import CommandLimits
from rans.reference.flight import fly_in_drake
from rans.scenario import draws, scenarios
from tests.support.engines import both_crafts
from tests.support.played import Played

TASK = rans.GoToPose()
TIMING = Timing(0.1, 4, 6)
COUNT = 8


def commands(craft: rans.Spacecraft) -> np.ndarray:
    shape = (TIMING.episode_steps, COUNT, craft.command_count)
    return np.random.default_rng(2).random(shape)


def limited(**ranges: Any) -> Conditions:
    return Conditions(thrusters=rans.ThrusterConditions(**ranges))


def flown(
    craft: rans.Spacecraft,
    conditions: Conditions | None = None,
    given: np.ndarray | None = None,
    how: Any = fly,
) -> Flight:
    played = Played(commands(craft) if given is None else given)
    starts = scenarios(TASK, craft, 0, COUNT)
    return how(craft, TASK, played, starts, TIMING, conditions=conditions, draws=draws(0, COUNT))


def differences(a: Flight, b: Flight) -> np.ndarray:
    """Largest difference of any number of the states of each flight, (N,)."""
    pairs = zip(leaves(a.states), leaves(b.states), strict=True)
    return np.max([np.abs(x - y).max(axis=0) for x, y in pairs], axis=0)


def test_pulses_and_switches_by_hand() -> None:
    """Ten counts in a period of 0.1 s: pulses of 0, 1, 2, 2, 3 and 10 counts, of which 3 are the least."""
    duties = np.array([0.04, 0.14, 0.15, 0.24, 0.25, 1.0])
    pulsed = CommandLimits(least_pulse=0.03).enforced([*duties], Pulsed(10), 0.1)
    assert np.ravel(pulsed).tolist() == [0.0, 0.0, 0.0, 0.0, 0.25, 1.0]
    # A least pulse that is longer than a period leaves whole periods.
    long = CommandLimits(least_pulse=7.0).enforced([*duties], Pulsed(10), 0.1)
    assert np.ravel(long).tolist() == [0.0] * 5 + [1.0]
    throttle = Throttle(most=0.8)
    switched = CommandLimits(on_off=np.array([1.0, 0.0]))
    both = switched.enforced([np.array([c, c]) for c in (0.39, 0.4, 0.7)], throttle, 0.1)
    assert np.array(both).tolist() == [[0.0, 0.39], [0.8, 0.4], [0.8, 0.7]]


@both_crafts
def test_a_least_pulse_is_that_of_a_craft_which_has_it(craft: rans.Spacecraft) -> None:
    pulsed, other = (replace(craft, actuators=Pulsed(5, least)) for least in (0, 3))
    found = flown(pulsed, limited(least_pulse=0.06))
    np.testing.assert_array_less(differences(found, flown(other)), 1e-12)
    assert differences(found, flown(pulsed)).min() > 1e-4


@both_crafts
def test_thrusters_are_on_off_in_a_part_of_the_episodes(craft: rans.Spacecraft) -> None:
    """A craft that throttles flies about half of its episodes as one with on/off thrusters."""
    throttled = replace(craft, actuators=Throttle())
    found = flown(throttled, limited(on_off=0.5))
    given = commands(craft)
    on_off = differences(found, flown(craft, given=(given >= 0.5) * 1.0)) < 1e-12
    as_designed = differences(found, flown(throttled)) < 1e-12
    np.testing.assert_array_equal(on_off, ~as_designed)
    assert 0 < on_off.sum() < COUNT


@pytest.mark.parametrize("ranges", [{"least_pulse": (0.0, 0.1)}, {"on_off": 0.5}])
def test_engine_and_drake_limit_likewise(ranges: Any) -> None:
    craft = replace(rans.load_spacecraft("floating-platform"), actuators=Pulsed(5))
    conditions = limited(**ranges)
    expected = flown(craft, conditions)
    assert len({*np.round(differences(expected, flown(craft)), 12)}) > 2
    # Drake's steps are accurate to 1e-9.
    judged = flown(craft, conditions, how=fly_in_drake)
    np.testing.assert_array_less(differences(judged, expected), 1e-8)
    engine = rans.Engine(
        craft, TASK, COUNT, replace(TIMING, episode_steps=9), conditions=conditions
    )
    for command in commands(craft):
        engine.step(torch.as_tensor(command, dtype=torch.float32))
    state = map_leaves(np.asarray, engine.state)
    last = map_leaves(lambda x: x[-1], expected.states)
    # Single precision.
    for a, b in zip(leaves(state), leaves(last), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-5)


@pytest.mark.parametrize(
    ("ranges", "actuators"),
    [
        ({"least_pulse": 0.1}, Throttle()),
        ({"on_off": 0.5}, OnOff()),
        ({"on_off": 0.5}, Throttle(0.2, always_lit=True)),
    ],
)
def test_limits_that_a_craft_cannot_have_are_refused(ranges: Any, actuators: Any) -> None:
    craft = replace(rans.load_spacecraft("floating-platform"), actuators=actuators)
    with pytest.raises(ConfigError, match=next(iter(ranges))):
        limited(**ranges).check_craft(craft)
    with pytest.raises(ConfigError, match="on_off"):
        limited(on_off=1.5)


def test_a_least_pulse_above_the_control_period_is_refused() -> None:
    """At the period itself thrusters are on/off, and above it nothing is left to be longer."""
    craft = replace(rans.load_spacecraft("floating-platform"), actuators=Pulsed(5))
    period = TIMING.control_period
    for pulse in (period, 1.01 * period):
        setup = Setup(craft, TASK, TIMING, limited(least_pulse=(0.0, pulse)))
        with pytest.raises(ConfigError, match="least_pulse") if pulse > period else nullcontext():
            World(setup)
