"""Bounds of docking at a port: attacks by flights that may change their velocity at once."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_missions.bounds.ports import least_to_dock, port_waypoints
from rans_missions.tasks import DockPort

from rans.episode.scenario import scenario
from rans.model.spacecraft_file import load_spacecraft

PLATFORM = load_spacecraft("floating-platform")


@pytest.mark.parametrize(("rate", "episode"), [(0.0, 0), (15.0, 2)])
def test_no_change_of_velocity_docks_below_the_bound(rate, episode):
    """From the start to a point of the cone's mouth at any instant, and from there to the port as it is later.

    The cheapest of many such flights is above the bound, and not far above it if the port is slow.
    """
    task = replace(DockPort(), port_rate=(math.radians(rate),) * 2)
    one: Any = scenario(task, 2, 7, episode)
    bound = least_to_dock(PLATFORM, task, one, task.timing)
    # Places are complex numbers.
    at_first, goal = (complex(float(end.p.x), float(end.p.y)) for end in (one.start, one.goal))
    random = np.random.default_rng(episode)
    count = 200_000
    dock = random.uniform(2.0, 40.0, count)
    enter = dock * random.uniform(0.05, 1.0, count)
    aside = np.radians(random.uniform(-30.0, 30.0, count))
    spin = 1j * float(one.goal.w)
    outwards = goal / abs(goal)
    mouth = outwards * (0.55 + np.exp(1j * aside)) * np.exp(spin * enter)
    first = (mouth - at_first) / enter
    second = (goal * np.exp(spin * dock) - mouth) / (dock - enter)
    spent = PLATFORM.mass * (np.abs(first) + np.abs(second - first))
    # All who are within 2 cm of the port have docked.
    cheapest = float(spent.min())
    assert bound <= cheapest
    assert rate > 3.0 or bound >= 0.6 * cheapest


def test_from_ahead_of_a_port_the_bound_is_that_of_the_straight_way():
    """As slowly as the episode of 40 s allows, from 3 m before the port to 2 cm."""
    task = replace(DockPort(), port_rate=(0.0, 0.0))
    one: Any = scenario(task, 2, 7, 0)
    ahead = replace(one.start, p=one.goal.p.scale(3.65 / 0.65))
    bound = least_to_dock(PLATFORM, task, replace(one, start=ahead), task.timing)
    assert bound == pytest.approx(PLATFORM.mass * 2.98 / 40.0, rel=1e-6)


@pytest.mark.parametrize("dimension", [2, 3])
def test_spans_contain_the_mouth_and_the_port(dimension):
    """Random points of the mouth, or up to 2.5 cm behind it, and near the docked position, at any instant.

    Port and cone are those of the task at that instant. In the plane none of the three margins is generous.
    """
    task = replace(DockPort(), port_rate=(math.radians(9.0),) * 2)
    goal: Any = scenario(task, dimension, 7, 1).goal
    mouths, ports = port_waypoints(task, goal, task.timing)
    random = np.random.default_rng(dimension)
    tightest = np.full(3, np.inf)
    count = 300
    for mouth, port in zip(mouths, ports, strict=True):
        assert mouth.ahead is not None
        time = random.uniform(*mouth[:2], count)
        time[::3], time[1::3] = mouth[:2]
        then: Any = task.later(goal, time)
        cone: Any = task.scenery(then)[0]
        apex, axis, docked = (_rows(v, count) for v in (cone.apex, cone.axis, then.p))
        aside = random.normal(size=(count, dimension))
        aside -= axis * np.sum(aside * axis, axis=1, keepdims=True)
        aside /= np.linalg.norm(aside, axis=1, keepdims=True)
        angle = math.radians(30.0) * np.where(random.random(count) < 0.5, 1.0, random.random(count))
        ray = np.cos(angle)[:, None] * axis + np.sin(angle)[:, None] * aside
        point = apex + (1.0 - 0.025 * random.integers(2, size=(count, 1))) * ray
        spare = np.array(
            [
                mouth.radius - np.linalg.norm(point - mouth.position, axis=1),
                mouth.behind + (point - mouth.position) @ mouth.ahead,
                port.radius - np.linalg.norm(docked + 0.02 * aside - port.position, axis=1),
            ]
        )
        assert (spare >= -1e-9).all()
        tightest = np.minimum(tightest, spare.min(axis=1))
    assert dimension == 3 or (tightest < 0.05).all()


def _rows(vector: Any, count: int) -> np.ndarray:
    """(count, d)"""
    return np.stack([np.broadcast_to(x, count) for x in vector.columns()], axis=1)
