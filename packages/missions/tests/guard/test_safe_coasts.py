"""Passive safety by the filter: coasts from the midst of flights, integrated by SciPy."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_missions.guard import safety_filter
from rans_missions.guard.safe_coasts import SafeCoasts
from rans_missions.tasks import Dock, Hold
from rans_missions.vectors import motion_of
from scipy.integrate import solve_ivp

from rans.episode import Setup, World
from rans.flight import Flight, fly
from rans.model.fields import Vec3, map_leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.scenario import scenarios
from tests.support.clohessy_wiltshire import orbit
from tests.support.ramming import Ramming

TASK = Hold()
CRAFT = load_spacecraft("vbar-chaser")
RADIUS = 50.0
PERIOD = 10.0
SETUP = Setup(CRAFT, TASK, Timing(PERIOD, None, 4, checks=10))


def flown(guard: Any) -> Flight:
    """Flights that thrust fully at the target, from rest: by a burn or two a coast goes through the ball."""
    starts = scenarios(TASK, CRAFT, seed=4, count=2, first=4)
    return fly(CRAFT, TASK, Ramming(), starts, SETUP.timing, guard=guard)


def least_coast_distance(flight: Flight, flying: int) -> float:
    """Least distance from the target, m, of coasts of an orbit after a part of each burn of one flight."""
    system = orbit(TASK.mean_motion)
    directions = np.array([x.direction for x in CRAFT.thrusters]) * 10.0 / CRAFT.mass
    states = motion_of(flight.states)[:, flying]
    shut = []
    for state, command in zip(states[:-1], flight.commands[:, flying], strict=True):
        push = np.concatenate([np.zeros(3), command @ directions])

        def rate(_: float, x: np.ndarray, push: np.ndarray = push) -> np.ndarray:
            return system @ x + push

        parts = np.linspace(0.0, PERIOD, 5)
        burning = solve_ivp(rate, (0.0, PERIOD), state, "DOP853", parts, rtol=1e-10, atol=1e-10)
        shut.append(burning.y[:, 1:])
    start = np.concatenate(shut, axis=1)
    seconds = 2.0 * math.pi / TASK.mean_motion
    coasting = solve_ivp(
        lambda _, x: (system @ x.reshape(start.shape)).ravel(),
        (0.0, seconds),
        start.ravel(),
        "DOP853",
        np.linspace(0.0, seconds, 1500),
        rtol=1e-8,
        atol=1e-8,
    )
    positions = coasting.y.reshape(*start.shape, -1)[:3]
    return float(np.linalg.norm(positions, axis=0).min())


@pytest.mark.slow
def test_a_craft_that_flies_at_the_target_stays_passively_safe() -> None:
    guard = safety_filter(SETUP, safe_coasts=True)
    kept = flown(guard)
    assert kept.guarded is not None
    assert kept.guarded.any(axis=0).all()
    assert min(least_coast_distance(kept, row) for row in range(2)) > RADIUS
    # The filter of the ball alone lets it coast through the ball.
    ball_alone = flown(safety_filter(SETUP))
    assert min(least_coast_distance(ball_alone, row) for row in range(2)) < RADIUS


def test_a_coast_that_enters_sooner_than_it_lasts_is_refused() -> None:
    """Across the plane z oscillates: from rest at 150 m to 75 m in a sixth of an orbit, and to 46 m in a fifth."""
    start = scenarios(TASK, CRAFT, seed=4, count=1)
    state = map_leaves(lambda x: float(np.ravel(x)[0]), start.start)
    goal = map_leaves(lambda x: float(np.ravel(x)[0]), start.goal)
    zero = Vec3(0.0, 0.0, 0.0)
    across = replace(state, p=Vec3(0.0, 0.0, 150.0), v=zero)
    shut = (0.0,) * 6
    world = World(SETUP)
    period = 2.0 * math.pi / TASK.mean_motion
    for part, is_changed in ((1.0 / 6.0, False), (0.2, True)):
        guard = safety_filter(SETUP, safe_coasts=part * period)
        assert isinstance(guard, SafeCoasts)
        command, changed = guard.admitted(world, across, goal, shut)
        assert bool(changed) == is_changed == any(command)
        one = map_leaves(lambda x: np.array([x]), (across, goal))
        assert bool(guard.safe(world, *one)[0]) != is_changed


def test_within_the_approach_coasts_may_lead_anywhere() -> None:
    """Dock: 19 m before the target everything may lead to it, 25 m before it nothing may."""
    task, craft = Dock(), load_spacecraft("afrl-deputy")
    setup = Setup(craft, task, task.timing)
    start = scenarios(task, craft, seed=4, count=1)
    state, goal = (
        map_leaves(lambda x: float(np.ravel(x)[0]), x) for x in (start.start, start.goal)
    )
    guard = safety_filter(setup, safe_coasts=True)
    for distance, is_changed in ((19.0, False), (25.0, True)):
        here = replace(state, p=Vec3(0.0, 0.0, distance), v=Vec3(0.0, 0.0, -0.1))
        _, changed = guard.admitted(World(setup), here, goal, (0.0,) * 6)
        assert bool(changed) == is_changed
