"""Least propellant of landings: the published case, hand-worked burns, bounds and flights of what is found."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from rans_missions.bounds.landings import landings
from rans_missions.convex.landing import (
    Descent,
    Lander,
    best_landing,
    landing,
    largest_turning,
    least_propellant,
    thrusts,
)
from rans_missions.tasks.land import Land

from rans import ConfigError
from rans.episode.scenario import Scenario, scenarios
from rans.model.fields import Vec3
from rans.model.spacecraft_file import load_spacecraft

CRAFT = load_spacecraft("mars-lander-steered")
LANDER = Lander.of(CRAFT)
PUBLISHED = np.array([2000.0, 0.0, 1500.0]), np.array([80.0, 30.0, -75.0])
"""Acikmese and Ploen (2007)."""
EXACT = Descent(margin=1e-3)


def test_the_lander_of_a_craft():
    """Six engines of 3100 N, canted by 27 degrees, at 30 and at 80 %; 225 s of specific impulse."""
    cosine = math.cos(math.radians(27.0))
    assert LANDER.least_thrust == pytest.approx(0.3 * 6 * 3100 * cosine)
    assert LANDER.largest_thrust == pytest.approx(0.8 * 6 * 3100 * cosine)
    assert LANDER.exhaust_speed == pytest.approx(225 * 9.80665 * cosine)
    with pytest.raises(ConfigError, match="'free-flyer' is no lander"):
        Lander.of(load_spacecraft("free-flyer"))


@pytest.mark.parametrize(("time", "expected"), [(74.0, 374.0), (75.0, 373.6), (80.0, 378.6)])
def test_the_published_landing(time, expected):
    """Propellant of an independent implementation with accelerations held for half a second, within 0.1 %.

    It bounds the thrust by the mass at the start of a period instead of that in its middle, which is dearer.
    """
    found = landing(LANDER, EXACT, PUBLISHED, time)
    assert found is not None
    assert found.propellant == pytest.approx(expected, rel=1e-3)
    # The relaxation is lossless: the slack is the acceleration's size.
    size = np.linalg.norm(found.acceleration, axis=1)
    np.testing.assert_allclose(found.slack, size, rtol=1e-5)
    assert abs(found.propellant - found.dual) < 1e-3


def test_too_short_a_flight_is_out_of_reach():
    assert landing(LANDER, EXACT, PUBLISHED, 70.0) is None
    assert best_landing(LANDER, EXACT, PUBLISHED, 2.0, times=(20.0, 60.0)) is None


@pytest.mark.parametrize("apart", [False, True])
def test_no_landing_is_below_the_rocket_equation_of_its_flight_time(apart):
    """Straight down, all thrust is against the velocity and gravity: it is the optimum then."""
    lander = Lander.of(CRAFT, apart=apart)
    descent = Descent.of(Land())
    down = np.array([0.0, 0.0, 1500.0]), np.array([0.0, 0.0, -75.0])
    for start, time, share in (PUBLISHED, 80.0, 0.85), (down, 30.0, 0.99), (down, 50.0, 0.99):
        one = landing(lander, descent, start, time, 1.0, "bound")
        assert one is not None
        floor = least_propellant(lander, descent, start, time)
        assert share * one.propellant < floor <= one.propellant
    # A thrust that is too weak, and more than all that it has.
    assert least_propellant(lander, descent, down, 6.0) == math.inf
    assert least_propellant(lander, descent, down, 400.0) == math.inf
    # Engines that can go out have a thrust without a flow, too.
    shut = replace(lander, corners=(*lander.corners, (0.0, 0.0, 0.0)) if apart else ())
    assert least_propellant(shut, descent, down, 50.0) == floor


@pytest.mark.slow
def test_the_burn_at_the_last_moment_is_the_optimum():
    """A start for which most thrust all the way stops it just above the ground has no cheaper landing."""
    time = 20.0
    flow = LANDER.largest_thrust / LANDER.exhaust_speed
    left = LANDER.mass - flow * time
    speed = LANDER.exhaust_speed * math.log(LANDER.mass / left) - 3.7114 * time
    way = LANDER.exhaust_speed * (time - left / flow * math.log(LANDER.mass / left))
    height = speed * time - (way - 0.5 * 3.7114 * time**2)
    start = np.array([0.0, 0.0, height + 0.5]), np.array([0.0, 0.0, -speed])
    found = best_landing(LANDER, EXACT, start, 0.5, times=(10.0, 40.0))
    assert found is not None
    # Half a metre of room; flight times are whole half seconds, in which most thrust takes 3 kg.
    assert flow * time < found.propellant < flow * (time + 0.5)
    assert found.time == pytest.approx(20.0, abs=0.51)
    lower = np.array([0.0, 0.0, height - 5.0]), start[1]
    assert best_landing(LANDER, EXACT, lower, 0.5, times=(10.0, 40.0)) is None


@pytest.mark.slow
def test_what_is_found_flies_in_our_engine_and_in_drake():
    """From the published start, within the tolerances; exactly it costs a little more."""
    one = scenarios(Land(), CRAFT, 0, 1)
    p, v = (Vec3(*(np.full(1, x) for x in part)) for part in PUBLISHED)
    starts = Scenario(replace(one.start, p=p, v=v), one.goal)
    [answer] = landings(CRAFT, Land(), starts)
    assert answer.good
    assert answer.landing is not None
    assert answer.bound <= answer.landing.propellant <= 1.0002 * answer.bound
    exact = landing(LANDER, Descent.of(Land(), exact=True), PUBLISHED, answer.landing.time)
    assert exact is not None
    assert 0.0 < exact.propellant - answer.landing.propellant < 1.0


def test_a_craft_that_turns_needs_more():
    """860 N m about two axes at once, 1715 kg m^2: 0.709 rad/s^2, 5.1 degrees in half a second and 20.4 in one."""
    turning = largest_turning(load_spacecraft("mars-lander-steered"))
    assert turning == pytest.approx(math.sqrt(2.0) * 860.0 / 1715.0)
    descent = Descent.of(Land())
    at_once = landing(LANDER, descent, PUBLISHED, 75.0, side="bound")
    turned = landing(LANDER, replace(descent, turning=turning), PUBLISHED, 75.0, side="bound")
    assert at_once is not None
    assert turned is not None
    assert turned.propellant > at_once.propellant
    size = np.linalg.norm(turned.acceleration, axis=1)
    tilt = np.degrees(np.arccos(turned.acceleration[:, 2] / size))
    # Mass, and inertia with it, falls by 0.2 % in half a second at most thrust.
    assert tilt[0] <= 5.1 * 1.003
    assert tilt[1] <= 20.4 * 1.006
    assert np.degrees(np.arccos(at_once.acceleration[0, 2] / at_once.slack[0])) > 30.0


def test_engines_throttled_one_by_one_push_no_more_and_no_lower_than_the_lines_say():
    """Random throttles of five engines, of a craft that is tilted and rolled at random within its limit."""
    random = np.random.default_rng(3)
    lander = Lander.of(CRAFT, (0,), apart=True)
    pushes = np.array([np.multiply(t.direction, t.force) for t in CRAFT.thrusters[1:]])
    flows = np.array([t.force for t in CRAFT.thrusters[1:]]) / (225 * 9.80665)
    throttles = random.uniform(0.3, 0.8, (2000, 5))
    throttles[1000:] = random.choice([0.3, 0.8], (1000, 5))
    used = throttles @ flows * lander.exhaust_speed
    assert used.min() >= lander.least_thrust - 1e-6
    assert used.max() <= lander.largest_thrust + 1e-6
    force = throttles @ pushes
    for tilt in (0.0, 0.4, 0.7):
        sizes, heights = thrusts(lander.corners, tilt)
        size = np.linalg.norm(force, axis=1)
        assert (size <= _least_of(sizes, used) + 1e-3).all()
        assert np.isclose(size, _least_of(sizes, used)).any()
        tilts = random.uniform(0.0, tilt, 2000)
        roll = random.uniform(-math.pi, math.pi, 2000)
        sideways = force[:, 0] * np.cos(roll) + force[:, 1] * np.sin(roll)
        height = np.cos(tilts) * force[:, 2] - np.sin(tilts) * sideways
        assert (-height <= _least_of(heights, used) + 1e-3).all()


def _least_of(lines: tuple[tuple[float, float], ...], x: np.ndarray) -> np.ndarray:
    return np.min([slope * x + intercept for slope, intercept in lines], axis=0)


def test_a_craft_that_cannot_tilt_lands_by_throttling_its_engines_one_by_one():
    """A flight with random throttles, from its end back to its start, uses at least the bound of its start."""
    random = np.random.default_rng(5)
    period, count = 0.5, 40
    throttles = random.uniform(0.5, 0.8, (count, 6))
    throttles[:, :2] = 0.8
    flow = throttles.sum(axis=1) * 3100.0 / (225 * 9.80665)
    mass = LANDER.mass - period * np.concatenate([[0.0], np.cumsum(flow)])
    force = throttles @ np.array([np.multiply(t.direction, t.force) for t in CRAFT.thrusters])
    push = force / np.sqrt(mass[1:] * mass[:-1])[:, None] - np.array([0.0, 0.0, 3.7114])
    p, v = np.zeros(3), np.zeros(3)
    for acceleration in push[::-1]:
        v = v - period * acceleration
        p = p - period * v - 0.5 * period**2 * acceleration
    upright = replace(EXACT, tilt=1e-3)
    found = landing(
        Lander.of(CRAFT, apart=True), upright, (p, v), period * count, period, side="bound"
    )
    assert found is not None
    assert 0.9 * (mass[0] - mass[-1]) < found.dual <= mass[0] - mass[-1]
    assert landing(LANDER, upright, (p, v), period * count, period, side="bound") is None
