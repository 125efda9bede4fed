"""Passively safe docking, in a simulation of its own: matrix exponentials, and coasts from many instants."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_missions.control.passive_entry import PassiveEntry, _Plan
from rans_missions.tasks import Dock
from rans_missions.tasks.orbital import Plan

from rans.errors import ConfigError
from tests.support.clohessy_wiltshire import transition

from .test_passive_approach import state_of

TASK = Dock()
N = TASK.mean_motion
PERIOD = 10.0
PARTS = 10
"""Instants of each period at which thrusters shut in the test, a second apart."""
MASS = 12.0
STARTS = np.array([[28.0, -7.0, 120.0, 0.0, 0.1, 0.0], [-90.0, 60.0, -40.0, 0.1, 0.0, 0.05]])
DEADLINE = 800.0

STEP = transition(N, PERIOD / PARTS)
COAST = transition(N, 2.0 * math.pi / N / 400.0)[:6, :6]


def flown() -> np.ndarray:
    """States (K, N, 6) at every second until the deadline."""
    pilot = PassiveEntry("afrl-deputy", TASK)
    x = STARTS
    goal = state_of(np.zeros_like(x))
    zero = np.zeros(len(x))
    planned = TASK.plan(state_of(x), goal, zero + DEADLINE)
    directions = np.array([thruster.direction for thruster in pilot.craft.thrusters])
    pilot.reset(len(x))
    states = [x]
    for k in range(int(DEADLINE / PERIOD)):
        now = TASK.later(planned, k * PERIOD)
        command = pilot.act(state_of(x), now, np.zeros((len(x), 1)))
        # Thrusters of 1 N.
        push = command @ directions / MASS
        for _ in range(PARTS):
            x = (np.concatenate([x, push], axis=1) @ STEP.T)[:, :6]
            states.append(x)
    return np.array(states)


@pytest.mark.slow
def test_coasts_miss_the_target_until_it_docks_on_purpose() -> None:
    states = flown()
    distance = np.linalg.norm(states[..., :3], axis=-1)
    speed = np.linalg.norm(states[..., 3:], axis=-1)
    for row in range(len(STARTS)):
        docked = (distance[:, row] < 0.5) & (speed[:, row] < 0.2)
        assert docked.any()
        until = int(np.argmax(docked))
        allowed = 0.2 + 2.0 * N * (distance[:until, row] - 0.5)
        assert (speed[:until, row] < allowed).all()
        # The approach begins at the end of a control period within 20 m.
        inside = int(np.argmax(distance[::PARTS, row] < 20.0)) * PARTS
        coasting = states[:inside, row]
        nearest = np.linalg.norm(coasting[:, :3], axis=-1)
        for _ in range(400):
            coasting = coasting @ COAST.T
            nearest = np.minimum(nearest, np.linalg.norm(coasting[:, :3], axis=-1))
        assert nearest.min() > 5.0


@pytest.mark.slow
def test_a_first_coast_may_turn_where_no_other_is_safe() -> None:
    """From this start, of evaluation start 226, one burn leads into the zone or breaks the speed limit."""
    pilot = PassiveEntry("afrl-deputy", "dock")
    start = np.array([-9.906, 21.243, 135.843, -0.008, -0.017, -0.172])
    points, ends, is_safe = pilot._plan(start, 607.66)
    assert is_safe
    assert np.linalg.norm(points[0]) > 20.0 > np.linalg.norm(points[1])
    assert 0.0 < ends[0] < ends[1] < 607.66
    # The plan by itself: impulses, and coasts of an orbit from a hundred instants and eleven parts of a burn.
    state, least = start, math.inf
    instants = [5.0, *ends]
    orbit = 2.0 * math.pi / pilot.task.mean_motion
    matrices = [transition(pilot.task.mean_motion, t)[:6, :6] for t in np.linspace(0, orbit, 400)]
    for k, point in enumerate(points):
        state = (
            transition(pilot.task.mean_motion, instants[k] - (instants[k - 1] if k else 0.0))[
                :6, :6
            ]
            @ state
        )
        response = transition(pilot.task.mean_motion, instants[k + 1] - instants[k])[:3, :6]
        velocity = np.linalg.solve(response[:, 3:], point - response[:, :3] @ state[:3])
        for part in np.linspace(0.0, 1.0, 11):
            shut = np.concatenate([state[:3], state[3:] + part * (velocity - state[3:])])
            least = min(least, *(float(np.linalg.norm((m @ shut)[:3])) for m in matrices))
        state = np.concatenate([state[:3], velocity])
    assert least > 5.0


def test_it_flies_to_targets_only() -> None:
    with pytest.raises(ConfigError, match="Hold is not one"):
        PassiveEntry("vbar-chaser", "hold")


def test_each_start_flies_its_cheapest_plan_that_stays_inside_the_cone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Plans whose coast ends after more than 500 s leave the cone here; the last start has no other."""
    pilot = PassiveEntry("arpod-chaser", "rendezvous")
    ends = {-1.0: [600.0, 700.0, 400.0], -2.0: [300.0], -3.0: [900.0] * 20}
    asked = []

    def plan(start: Any, deadline: float, excluded: Any = ()) -> _Plan:
        end = np.full(2, ends[start[0]][len(excluded)])
        return _Plan(np.full((2, 3), float(len(excluded))), end, True)

    def arrives(self: PassiveEntry, states: Any, state: Any, goal: Any) -> np.ndarray:
        asked.append(state.p.x.tolist())
        return self._ends[:, 1] <= 500.0

    monkeypatch.setattr(pilot, "_plan", plan)
    monkeypatch.setattr(PassiveEntry, "_arrives", arrives)
    x = np.repeat([[-1.0], [-2.0], [-3.0]], 6, axis=1)
    goal = replace(state_of(x), notes=Plan(*(np.full(3, x) for x in (5000.0, 5000.0, 0.0))))
    plans = pilot._planned(x, state_of(x), goal)
    assert [plan.ends[1] for plan in plans] == [400.0, 300.0, 900.0]
    assert asked[:3] == [[-1.0, -2.0, -3.0], [-1.0, -3.0], [-1.0, -3.0]]
    assert set(map(tuple, asked[3:])) == {(-3.0,)}
