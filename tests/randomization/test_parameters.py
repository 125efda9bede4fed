"""What episodes draw: distributions, independence, and what each kick and swing does."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from rans import BodyConditions, Conditions, DisturbanceConditions, ThrusterConditions
from rans.base.structure import structure
from rans.episode.scenario import scenarios
from rans.model.fields import leaves
from rans.randomization.parameters import _STREAMS, EpisodeParameters
from tests.support.draws import (
    BOTH,
    COUNT,
    CRAFTS,
    FLYER,
    LIKELY,
    PLATFORM,
    TASK,
    begun,
    parameters,
)
from tests.support.worlds import EFFECTS


def assert_uniform(values: Any, low: float, high: float) -> None:
    assert np.shape(values) == (COUNT,)
    assert low <= np.min(values)
    assert np.max(values) <= high
    # Standard error of the mean of uniform numbers; five of them are passed once in two million.
    assert np.mean(values) == pytest.approx(
        (low + high) / 2, abs=5 * (high - low) / math.sqrt(12 * COUNT)
    )
    assert stats.kstest(values, stats.uniform(low, high - low).cdf).pvalue > LIKELY


def turned(found: EpisodeParameters, number: int) -> tuple[Any, Any]:
    """Parts of a thruster's true direction to the left of the designed one, and along it."""
    x, y, _ = PLATFORM.thrusters[number].direction
    true = found.body.mountings[number].direction
    return x * true[1] - y * true[0], x * true[0] + y * true[1]


UNIFORM: dict[str, tuple[float, float, Callable[[EpisodeParameters], Any]]] = {
    "body.mass": (0.7, 1.4, lambda c: c.body.mass / PLATFORM.mass),
    "body.inertia": (0.5, 2.0, lambda c: c.body.inertia[0] / PLATFORM.inertia[2][2]),
    "body.centre": (0.01, 0.03, lambda c: np.hypot(*c.body.centre)),
    "thrusters.thrust": (0.7, 1.3, lambda c: c.body.gain[5]),
    "thrusters.pressure": (0.8, 1.0, lambda c: c.body.gain[2]),
    "thrusters.droop": (0.1, 0.3, lambda c: c.body.droop),
    "thrusters.latency": (0.02, 0.1, lambda c: c.lag and c.lag.latency),
    "thrusters.rise": (0.02, 0.1, lambda c: c.lag and c.lag.rise),
    "thrusters.least_on": (0.0, 0.6, lambda c: c.dwell and c.dwell.on),
    "faults.time": (1.0, 20.0, lambda c: c.fault and c.fault.begins),
    "disturbances.force": (0.1, 0.3, lambda c: c.push and c.push.force.norm()),
    "disturbances.torque": (0.1, 0.3, lambda c: c.push and abs(c.push.torque)),
    "disturbances.kick": (0.1, 0.3, lambda c: c.kick and c.kick.impulse.force.norm()),
    "disturbances.slow_force": (0.1, 0.3, lambda c: c.swing and c.swing.amplitude.force.norm()),
    "thrusters.noise": (0.05, 0.1, lambda c: c.noise),
    "thrusters.misalignment": (0.02, 0.1, lambda c: abs(np.arctan2(*turned(c, 3)))),
    "sensors.velocity.bias": (
        0.01,
        0.02,
        lambda c: c.sensors and c.sensors.bias and c.sensors.bias[2].norm(),
    ),
}
"""Ranges by their places in a file, and what is drawn from each."""


@pytest.mark.parametrize("name", UNIFORM)
def test_ranges_are_uniform_within_their_bounds(name):
    low, high, value = UNIFORM[name]
    *rooms, entry = name.split(".")
    table: dict[str, Any] = {entry: [low, high]}
    if entry == "time":  # of a fault, of which each episode has one
        table["count"] = 1.0
    for room in reversed(rooms):
        table = {room: table}
    assert_uniform(value(parameters(structure(table, Conditions, name))), low, high)


def test_a_force_points_to_all_sides_and_a_torque_to_both():
    push = parameters(Conditions(disturbances=DisturbanceConditions(force=0.3, torque=0.1))).push
    assert_uniform(np.arctan2(push.force.y, push.force.x), -math.pi, math.pi)
    left = int(np.sum(push.torque > 0.0))
    assert stats.binomtest(left, COUNT).pvalue > LIKELY


@BOTH
def test_a_number_is_no_distribution(dimension):
    late = ThrusterConditions(latency=0.05, command_delay=0.1)
    fixed = parameters(Conditions(BodyConditions(mass=1.2), late), dimension)
    assert fixed.body.mass == CRAFTS[dimension].mass * 1.2
    assert fixed.lag.latency == pytest.approx(0.15)


def test_thrusts_are_drawn_one_by_one_and_pressure_for_all():
    thrust = np.array(parameters(EFFECTS["thrust"]).body.gain)
    own = np.array(
        parameters(Conditions(thrusters=ThrusterConditions(thrust=(0.7, 1.3)))).body.gain
    )
    assert np.abs(np.corrcoef(own) - np.eye(8)).max() < 5 / math.sqrt(COUNT)  # five standard errors
    ratio = thrust / own
    np.testing.assert_allclose(ratio, ratio[:1].repeat(8, axis=0), rtol=1e-12)
    assert_uniform(ratio[0], 0.8, 1.0)


@BOTH
def test_thrusts_have_new_noise_in_every_period(dimension):
    """Normal about the designed force, and independent between thrusters, periods and episodes."""
    noisy = Conditions(thrusters=ThrusterConditions(noise=0.1))
    world, own, now = begun(noisy, dimension)
    still = (0.0,) * world.craft.command_count
    gains = np.concatenate(
        [
            world.step_inputs(replace(now, clock=now.clock + k), still, own).body.gain
            for k in (0, 1, 2)
        ]
    )
    assert gains.shape == (3 * world.craft.thruster_count, COUNT)
    for row in gains:
        assert stats.kstest((row - 1.0) / 0.1, "norm").pvalue > LIKELY
    assert np.abs(np.corrcoef(gains) - np.eye(len(gains))).max() < 6 / math.sqrt(COUNT)


def test_a_thrust_never_pulls():
    """With a deviation as large as the force, every sixth number is below zero."""
    world, own, now = begun(Conditions(thrusters=ThrusterConditions(noise=1.0)))
    gain = np.array(world.step_inputs(now, (0.0,) * 8, own).body.gain)
    assert np.min(gain) == 0.0
    assert np.mean(gain == 0.0) == pytest.approx(stats.norm.cdf(-1.0), abs=5 / math.sqrt(8 * COUNT))


def test_misaligned_thrusters_in_space_point_to_all_sides():
    """The angle is that of the conditions, and its bearing about the designed direction is uniform."""
    wrong = Conditions(thrusters=ThrusterConditions(misalignment=0.1))
    mountings = parameters(wrong, 3).body.mountings
    for thruster, mounting in zip(FLYER.thrusters, mountings, strict=True):
        true = np.array([np.broadcast_to(x, COUNT) for x in mounting.direction])
        designed = np.array(thruster.direction)
        np.testing.assert_allclose(designed @ true, np.cos(0.1), rtol=1e-12)
        # Any frame across the thrust serves to measure the bearing.
        one, two = np.linalg.svd(designed[None])[2][1:] @ true
        assert_uniform(np.arctan2(two, one), -math.pi, math.pi)


def test_directions_in_space_are_uniform_on_the_sphere():
    push = parameters(EFFECTS["push"], 3).push
    for vector in (push.force, push.torque):  # Archimedes: every coordinate is
        for x in vector.columns():
            assert_uniform(x / vector.norm(), -1.0, 1.0)


PARTS: dict[str, Callable[[Any], Any]] = {
    "body": lambda c: (c.body.mass, c.body.inertia, c.body.centre),
    "thrust": lambda c: (c.body.gain, c.body.droop),
    "latency": lambda c: c.lag.latency,
    "hold": lambda c: c.dwell,
    "push": lambda c: c.push,
    "swing": lambda c: c.swing,
    "kick": lambda c: c.kick,
    "faults": lambda c: c.fault.begins,
    "mountings": lambda c: (c.noise, c.body.mountings),
}


@BOTH
@pytest.mark.parametrize("effect", PARTS)
def test_an_effect_draws_the_same_beside_others(effect, dimension):
    alone, among = (
        PARTS[effect](parameters(EFFECTS[name], dimension, 50)) for name in (effect, "all")
    )
    assert leaves(alone)
    for a, b in zip(leaves(alone), leaves(among), strict=True):
        assert np.array_equal(a, b)


def test_whatever_is_switched_on_starts_and_goals_stay():
    *_, now = begun(EFFECTS["all"], count=20)
    usual = scenarios(TASK, PLATFORM, 11, 20)
    assert np.array_equal(leaves((now.state, now.goal)), leaves((usual.start, usual.goal)))


# What pushes.


def test_the_moment_of_a_kick_is_any_period_of_the_episode():
    found = parameters(Conditions(disturbances=DisturbanceConditions(kick=1.0)))
    seen = np.bincount(found.kick.step.astype(int))
    assert len(seen) == 125
    assert stats.chisquare(seen).pvalue > LIKELY


def test_every_effect_has_random_numbers_of_its_own():
    """256 blocks each, and the first ones for start and goal."""
    assert len({0, *_STREAMS.values()}) == 1 + len(_STREAMS)
