"""Phase-plane switching: its times are minimum times, and it settles sooner than a regulator everywhere."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from rans import TASKS, GoToPose, Timing
from rans.control.allocation import ThrusterPatterns
from rans.control.switching import Curve, Switching, time_to_rest
from rans.episode.flight import fly
from rans.episode.scenario import Scenario, scenarios
from rans.evaluation.measure.metrics import settling_times
from rans.model.dynamics import PlanarState, SpatialState
from rans.model.fields import Heading, Quat, Vec2, Vec3, map_leaves
from rans.model.spacecraft_file import load_spacecraft
from tests.support.crafts import heavier

PLATFORM = load_spacecraft("floating-platform")
FLYER = load_spacecraft("free-flyer")
SHARED = load_spacecraft("floating-platform-shared")
TASK = GoToPose().for_evaluation()
TIMING = Timing()


def searched(x: float, v: float, most: float) -> float:
    """Minimum time by root search: full thrust one way for t, then the other way until at rest, at 0."""
    times = []
    for sense in (-1.0, 1.0):

        def missed(t: float, push: float = sense * most) -> float:
            turned = v + push * t
            there = x + v * t + 0.5 * push * t * t
            rest = turned / push  # braking with -push
            return there + turned * rest - 0.5 * push * rest * rest

        first = max(0.0, -v / (sense * most))  # the braking that follows takes no negative time
        if missed(first) * missed(first + 50.0) <= 0.0:
            t: Any = brentq(missed, first, first + 50.0, xtol=1e-13)
            times.append(t + abs(v + sense * most * t) / most)
    return min(times)


def test_least_time_on_a_line():
    random = np.random.default_rng(0)
    for x, v, most in random.uniform((-5.0, -2.0, 0.1), (5.0, 2.0, 3.0), (200, 3)):
        ours = time_to_rest(np.array([x]), np.array([v]), most)
        assert ours == pytest.approx(searched(x, v, most), abs=1e-9)  # its roots are 1e-13 s off


def test_least_time_by_hand():
    """1 m from rest at 1 m/s^2: 1 s of thrust, 1 s of braking. Resting anywhere: v / a. Both add as roots."""
    # across, at 1 m/s
    x = np.array([3.0, 4.0]) / 5.0
    v = np.array([-4.0, 3.0]) / 5.0
    assert time_to_rest(x, 0.0 * v, 1.0) == pytest.approx(2.0)
    assert time_to_rest(None, v, 0.5) == pytest.approx(2.0)
    assert time_to_rest(x, v, 1.0) == pytest.approx(math.hypot(2.0, 1.0 + math.sqrt(2.0)))
    assert time_to_rest(0.0 * x, 0.0 * v, 1.0) == 0.0


@pytest.mark.parametrize("craft", [PLATFORM, SHARED], ids=lambda craft: craft.name)
def test_no_neighbour_of_the_pattern_is_better(craft):
    """Of all 256 patterns, those that differ in at most two thrusters; and the best of all is found often."""
    patterns = ThrusterPatterns(craft)
    random = np.random.default_rng(1)
    wanted = random.normal(size=(40, 3)) * (1.0, 1.0, 0.3)
    every = np.array(list(product([False, True], repeat=8)))

    def cost(which, candidates):
        return np.abs(wanted[which][:, None] - patterns.wrench(candidates)).sum(axis=2)

    found = patterns.best(np.zeros((40, 8), bool), cost, np.arange(40) < 39)
    costs = cost(np.arange(40), np.broadcast_to(every, (40, 256, 8)))
    ours = cost(np.arange(40), found[:, None])[:, 0]
    near = (every[None] ^ found[:, None]).sum(axis=2) <= 2
    assert (ours[:39] <= np.where(near, costs, np.inf).min(axis=1)[:39] + 1e-12).all()
    assert (ours[:39] <= costs.min(axis=1)[:39] + 1e-12).mean() > 0.7
    assert not found[39].any()  # was not free to change


def planar(x: float, turn: float, v: float, w: float) -> PlanarState:
    """On W's x axis, one episode."""
    state = PlanarState(Vec2(x, 0.0), Heading(turn), Vec2(v, 0.0), w)
    return map_leaves(lambda number: np.array([number]), state)


def command(state: PlanarState, **settings: float) -> np.ndarray:
    """The first, to the origin."""
    controller = Switching(PLATFORM, TASK, TIMING, Curve(**settings))
    controller.reset(1)
    return controller.act(state, planar(0.0, 0.0, 0.0, 0.0), np.zeros((1, 0)))[0]


def test_switches_where_braking_must_begin():
    """Four of 1 N at 45 degrees push with 2.83 N: at 0.3 m/s and 75 % of it 0.11 m before the goal."""
    push = np.array(PLATFORM.wrench_map)[:, 0]
    brake = 0.3**2 / (2.0 * 0.75 * math.sqrt(8.0) / PLATFORM.mass)
    for distance, sense in ((3.0 * brake, 1.0), (1.1 * brake, -1.0), (0.5 * brake, -1.0)):
        assert np.sign(command(planar(-distance, 0.0, 0.3, 0.0)) @ push) == sense


def test_coasts_where_thrust_is_dear_and_rests_in_the_dead_band():
    far = planar(-2.0, 0.0, 0.3, 0.0)
    assert command(far).any()
    assert not command(far, thrust_time_weight=30.0).any()
    assert not command(planar(0.02, 0.03, 0.0, 0.0)).any()
    assert command(planar(0.2, 0.03, 0.0, 0.0)).any()


def test_a_craft_of_a_thousand_times_the_mass_and_force_flies_the_same():
    """Its accelerations are the same, so nothing but the numbers of N and kg differs; 2^11 rounds nothing."""
    much = 2.0**11
    thrusters = tuple(replace(one, force=much * one.force) for one in PLATFORM.thrusters)
    large = heavier(PLATFORM, much, much, thrusters=thrusters)
    starts = scenarios(TASK, PLATFORM, 47, 4)
    timing = Timing(episode_steps=60)
    small, same = (
        fly(craft, TASK, Switching(craft, TASK, timing), starts, timing).commands
        for craft in (PLATFORM, large)
    )
    assert small.any()
    assert np.array_equal(small, same)


def test_does_not_wait_for_ever_where_pulses_are_long():
    """0.109 rad from the goal, where turning and stopping with two thrusters goes 0.012 rad too far."""
    task = TASKS["track-velocity-heading"]()
    turn = Rotation.from_rotvec([0.05, 0.06, 0.075]).as_quat()
    zero = Vec3(0.0, 0.0, 0.0)
    goal = SpatialState(zero, Quat(1.0, 0.0, 0.0, 0.0), Vec3(0.3, 0.0, 0.0), zero)
    start = replace(goal, attitude=Quat(float(turn[3]), *map(float, turn[:3])))
    starts = Scenario(*(map_leaves(lambda x: np.array([x]), s) for s in (start, goal)))
    timing = Timing(episode_steps=25)
    assert (
        settling_times(fly(FLYER, task, Switching(FLYER, task, timing), starts, timing))[0] <= 1.0
    )
