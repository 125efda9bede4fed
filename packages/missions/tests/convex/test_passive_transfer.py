"""Transfers with safe coasts, in a simulation of its own: matrix exponentials, and coasts from many instants."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from rans_missions.convex.passive_transfer import passive_transfer
from rans_missions.convex.rendezvous import Meeting, least_impulse
from rans_missions.tasks import Dock

from rans.model.fields import map_leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import scenarios
from tests.support.clohessy_wiltshire import transition

TASK = Dock()
N = TASK.mean_motion
PERIOD, PARTS, PERIODS, ENTRY = 10.0, 5, 34, 22
CRAFT = load_spacecraft("afrl-deputy")
START = np.array([0.0, -60.0, 15.0, 0.0, 0.0, 0.0])


def meeting() -> Meeting:
    start = scenarios(TASK, CRAFT, seed=0, count=1)
    goal = map_leaves(lambda x: np.ravel(x)[0], start.goal)
    timing = replace(TASK.timing, episode_steps=PERIODS)
    return replace(Meeting.of(CRAFT, TASK, goal), timing=timing)


def flown(commands: np.ndarray) -> np.ndarray:
    """States (K, 6) at every second part of a period."""
    directions = np.array([thruster.direction for thruster in CRAFT.thrusters])
    step = transition(N, PERIOD / PARTS)
    states = [START]
    for command in commands:
        push = command @ directions / CRAFT.mass
        for _ in range(PARTS):
            states.append((step @ np.concatenate([states[-1], push]))[:6])
    return np.array(states)


def least_coast_distance(states: np.ndarray) -> float:
    """Least distance, m, of coasts of an orbit from states before the approach, at 1,200 instants each."""
    step = transition(N, 2.0 * math.pi / N / 1200.0)[:6, :6]
    coasting = states[: ENTRY * PARTS + 1].T
    least = math.inf
    for _ in range(1200):
        coasting = step @ coasting
        least = min(least, float(np.linalg.norm(coasting[:3], axis=0).min()))
    return least


@pytest.mark.slow
def test_coasts_keep_out_of_the_zone_and_the_craft_arrives_below_the_limit() -> None:
    task = meeting()
    zone = TASK.coast_zone
    assert zone is not None
    commands = passive_transfer(task, START, zone, 0.3, ENTRY, PERIODS)
    assert commands is not None
    states = flown(commands)
    distance = np.linalg.norm(states[:, :3], axis=1)
    speed = np.linalg.norm(states[:, 3:], axis=1)
    assert least_coast_distance(states) > zone.radius
    assert distance[ENTRY * PARTS] < zone.approach
    assert distance[-1] < TASK.position_tolerance
    assert speed[-1] < TASK.velocity_tolerance
    assert (speed < 0.2 + 2.0 * N * (distance - 0.5))[1:].all()
    # The cheapest transfer that ignores coasts has unsafe ones, and costs less.
    ignoring = least_impulse(task, START, PERIODS * task.timing.checks)
    assert ignoring is not None
    assert least_coast_distance(flown(ignoring.commands)) < zone.radius
    spent = float((commands @ task.price).sum())
    assert ignoring.impulse < spent < 1.5 * ignoring.impulse


@pytest.mark.slow
def test_there_is_no_transfer_that_is_too_fast_for_the_limit() -> None:
    zone = TASK.coast_zone
    assert zone is not None
    assert passive_transfer(meeting(), START, zone, 0.3, 6, 9) is None
