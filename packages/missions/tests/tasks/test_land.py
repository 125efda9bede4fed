"""Powered descent: rocket equation, free fall and the last possible burn by hand, in our engine and in Drake."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_missions.script import Script
from rans_missions.tasks.land import Land

from rans.episode.flight import Flight, fly
from rans.episode.scenario import Scenario, scenarios
from rans.episode.verdict import Failure
from rans.evaluation.measure.metrics import won
from rans.model.fields import Quat, Vec3
from rans.model.spacecraft_file import load_spacecraft
from rans.reference.flight import fly_in_drake

LANDER = load_spacecraft("mars-lander-steered")
TASK = Land()
G = 3.7114
MASS = 1905.0
SPEED = 225.0 * 9.80665 * math.cos(math.radians(27.0))
"""Thrust along z over mass flow, m/s: 1966."""
FLOW = 0.8 * 6.0 * 3100.0 / (225.0 * 9.80665)
"""At most thrust, kg/s: 6.7438."""
both_engines = pytest.mark.parametrize("flying", [fly, fly_in_drake])


def above(height: float, speed: float, attitude: Quat | None = None, aside: float = 0.0) -> Any:
    """One start over the site that sinks, m and m/s."""
    starts = scenarios(TASK, LANDER, seed=1, count=1)
    zero = np.zeros(1)
    start = replace(
        starts.start, p=Vec3(zero + aside, zero, zero + height), v=Vec3(zero, zero, zero - speed)
    )
    if attitude is not None:
        start = replace(start, attitude=Quat(*(zero + x for x in attitude_columns(attitude))))
    return Scenario(start, starts.goal)


def attitude_columns(attitude: Quat) -> tuple[Any, ...]:
    return attitude.w, attitude.x, attitude.y, attitude.z


def flown(flying: Any, start: Any, throttle: float, steps: int) -> Flight:
    timing = replace(TASK.timing, episode_steps=steps)
    held = np.repeat([throttle, 0.0], [6, 3])
    return flying(LANDER, TASK, Script(np.tile(held, (steps, 1, 1))), start, timing)


@both_engines
def test_the_rocket_equation(flying):
    """10 s of most thrust: 67.4 kg, 1966 m/s ln(1905 / 1837.6) - 37.1 m/s = 33.7 m/s."""
    flight = flown(flying, above(3000.0, 0.0), 0.8, 20)
    left = MASS - FLOW * 10.0
    gained = SPEED * math.log(MASS / left) - G * 10.0
    assert gained == pytest.approx(33.74, abs=0.01)
    # Engine and Drake take thrust over the falling mass as a line or a staircase in each half second.
    assert float(flight.states.v.z[-1, 0]) == pytest.approx(gained, abs=1e-5)
    assert float(flight.states.stores[0][-1, 0]) == pytest.approx(400.0 - 67.438, abs=1e-3)


@pytest.mark.slow
@both_engines
def test_the_burn_at_the_last_moment_lands(flying):
    """Most thrust all the way, from where it stops 0.2 m above the ground after 20 s: closed forms."""
    time = 20.0
    left = MASS - FLOW * time
    speed = SPEED * math.log(MASS / left) - G * time
    way = SPEED * (time - left / FLOW * math.log(MASS / left)) - 0.5 * G * time**2
    height = 0.2 + speed * time - way
    assert (round(speed, 2), round(height, 1)) == (70.14, 719.3)
    flight = flown(flying, above(height, speed), 0.8, 60)
    assert won(flight).all()
    assert flight.lengths is not None
    assert flight.lengths.tolist() == [40]
    # A second later is too late: it is at the ground at tens of metres per second.
    late = flown(flying, above(height - speed, speed), 0.8, 60)
    assert late.verdict.failure().tolist() == [Failure.VIOLATED]
    assert (late.margins["ground"].min(), late.done.tolist()) < (0.0, [True])  # type: ignore[union-attr]


@pytest.mark.parametrize(("degrees", "lost"), [(39.0, False), (41.0, True)])
def test_a_tilt_beyond_the_limit_is_lost(degrees, lost):
    half = 0.5 * math.radians(degrees)
    start = above(1000.0, 10.0, Quat(math.cos(half), math.sin(half), 0.0, 0.0))
    assert flown(fly, start, 0.5, 1).failed().tolist() == [lost]


@pytest.mark.parametrize(("height", "lost"), [(7.1, False), (6.7, True)])
def test_below_the_glide_slope_is_lost(height, lost):
    """Seen from the rim of the site, 1 m, a craft 100 m away is at 4 degrees 6.92 m above the ground."""
    start = above(height, 0.0, aside=100.0)
    # A hover: 1905 kg weigh 7070 N, 16,573 N are full thrust; nothing moves by more than 0.1 m in half a second.
    flight = flown(fly, start, MASS * G / (18600.0 * math.cos(math.radians(27.0))), 1)
    assert flight.failed().tolist() == [lost]


def test_starts_are_those_of_the_publication_and_around():
    starts: Any = scenarios(TASK, LANDER, seed=3, count=2000).start
    distance = np.hypot(starts.p.x, starts.p.y)
    away = (starts.p.x * starts.v.x + starts.p.y * starts.v.y) / distance
    across = (starts.p.x * starts.v.y - starts.p.y * starts.v.x) / distance
    for values, low, high in (
        (distance, 1900.0, 2100.0),
        (away, 50.0, 80.0),
        (across, 0.0, 30.0),
        (starts.p.z, 1450.0, 1650.0),
        (-starts.v.z, 65.0, 77.0),
    ):
        assert low - 1e-9 <= values.min() < low + 0.01 * (high - low)
        assert high - 0.01 * (high - low) < values.max() <= high + 1e-9
    # Every bearing: the mean direction of 2,000 has a length of 1 / sqrt(2000) = 0.022 in the mean.
    assert np.hypot((starts.p.x / distance).mean(), (starts.p.y / distance).mean()) < 0.1
