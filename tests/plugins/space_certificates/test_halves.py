"""Levels of pulses that are excluded by halves: never one that a flight reaches, and some that none does."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_bounds.goal_set import GoalSet
from rans_space_certificates.halves import HalfTrajectories
from rans_space_certificates.halves_kernel import gained
from rans_space_certificates.reach import SpinLattice

from rans import Spacecraft, Thruster
from rans.model.body import Body
from rans.model.dynamics import advance, wrench
from rans.model.fields import Quat, Vec3, leaves, unflatten
from tests.support.space_reach import PERIOD, REST, craft_with, near
from tests.support.states import spatial

SET = GoalSet(0.01, 0.02, 0.05, 0.1)
STEPS = 8
STILL = spatial()


def corners() -> Spacecraft:
    """Two nozzles ahead and two back, each of one quantum about the same axis or another."""
    return craft_with(
        "corners",
        (
            Thruster((0.0, 0.2, 0.0), (1.0, 0.0, 0.0), 1.0),
            Thruster((0.0, -0.2, 0.0), (1.0, 0.0, 0.0), 1.0),
            Thruster((0.0, 0.0, 0.2), (-1.0, 0.0, 0.0), 1.0),
            Thruster((0.0, 0.0, -0.2), (-1.0, 0.0, 0.0), 1.0),
        ),
    )


CRAFT = corners()
LATTICE = SpinLattice(CRAFT, PERIOD)


def every(pulses: int, steps: int) -> tuple[np.ndarray, Any]:
    """Commands (M, N, 4) of all flights of so many pulses from STILL, and their ends by the engines."""
    slots = np.array(list(itertools.combinations(range(4 * steps), pulses)))
    commands = np.zeros((len(slots), 4 * steps))
    np.put_along_axis(commands, slots, 1.0, axis=1)
    commands = commands.reshape(-1, steps, 4)
    state: Any = unflatten(STILL, [np.full(len(commands), x) for x in leaves(STILL)])
    for k in range(steps):
        state = advance(state, wrench(CRAFT, tuple(commands[:, k].T)), Body.of(CRAFT), PERIOD, 4)
    return commands, state


@pytest.fixture(scope="module")
def flown() -> Any:
    """All 35,960 of four pulses in eight periods."""
    return every(4, STEPS)[1]


def arrives(final: Any, goal: Any) -> bool:
    errors = [
        np.linalg.norm((getattr(final, x) - getattr(goal, x)).columns(), axis=0) for x in "pvw"
    ]
    return bool(
        (
            near(final, goal, SET.heading)
            & (errors[0] <= SET.position)
            & (errors[1] <= SET.velocity)
            & (errors[2] <= SET.spin)
        ).any()
    )


def turned(angle: float, about: int) -> Quat:
    axis = math.sin(0.5 * angle) * np.eye(3)[about]
    return Quat(math.cos(0.5 * angle), *axis.tolist())


@pytest.mark.slow
def test_no_level_is_excluded_that_a_flight_reaches(flown):
    """Goals 12 to 20 cm ahead, turned or not: what no flight reaches is excluded unless most pulses may be
    wasted, as below 16 cm."""
    answers = []
    for far, angle, about in itertools.product(
        np.linspace(0.12, 0.2, 9), (0.0, 0.12, 0.24, 0.6), (1, 2)
    ):
        goal = replace(STILL, p=Vec3(float(far), 0.0, 0.0), attitude=turned(angle, about))
        reached = arrives(flown, goal)
        excluded = HalfTrajectories(LATTICE, REST, STILL, goal, SET, STEPS).exclude(4)
        assert not (reached and excluded)
        assert reached or excluded or far < 0.155
        answers.append(reached)
    assert 20 < sum(answers) < 52  # of 72


@pytest.mark.parametrize("lean", [0.0, 0.4])
def test_all_halves_are_listed_that_gain_enough(lean):
    """All 560 of three pulses in four periods, flown by the engines, that gain six tenths of the most."""
    goal = replace(STILL, p=Vec3(0.17, 0.05, 0.0))
    halves = HalfTrajectories(LATTICE, REST, STILL, goal, SET, STEPS)
    end = halves._ends[0]
    commands, final = every(3, STEPS // 2)
    states = np.column_stack([np.broadcast_to(x, len(commands)) for x in leaves(final)])
    gains = np.array([gained(x, 0.8, end.direction, 1.6, 0.0, lean) for x in states])
    enough = states[gains >= 0.6 * gains.max() + 1e-5]
    listed = halves._halves(end, 3, lean, 0.6 * float(gains.max()))
    assert 10 < len(enough) < 500
    for state in enough:  # the kernel is good to 1e-5
        assert np.abs(listed - state).max(axis=1).min() < 1e-4
    assert halves._most_gained(end, 3, lean) == pytest.approx(gains.max(), abs=1e-5)


def test_too_many_halves_prove_nothing(monkeypatch):
    goal = replace(STILL, p=Vec3(0.17, 0.0, 0.0), attitude=turned(0.24, 1))
    assert HalfTrajectories(LATTICE, REST, STILL, goal, SET, STEPS).exclude(4)
    monkeypatch.setattr("rans_space_certificates.halves._MOST_HALVES", 3)
    assert not HalfTrajectories(LATTICE, REST, STILL, goal, SET, STEPS).exclude(4)
