"""Passively safe approach of a hold point, in a simulation of its own: matrix exponentials, and many coasts."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from rans_missions.control.passive_approach import PassiveApproach
from rans_missions.tasks import Hold
from rans_missions.tasks.hold import HoldPlan

from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from tests.support.clohessy_wiltshire import transition

TASK = Hold()
N = TASK.mean_motion
PERIOD = 10.0
PARTS = 5
"""Instants of each period at which thrusters shut in the test."""
MASS = 500.0
# At rest ahead of the target, below and behind it, and where a coast from the start falls into the ball.
STARTS = np.array([[-172.0, 46.0, 1.0], [-92.0, -238.0, -35.0], [5.0, 30.0, 180.0]])
GOAL = np.array([0.0, -100.0, 0.0])
DEADLINE = 1200.0

STEP = transition(N, PERIOD / PARTS)
COAST = transition(N, 2.0 * math.pi / N / 200.0)[:6, :6]


def state_of(x: np.ndarray) -> SpatialState:
    zero = np.zeros(len(x))
    level = Quat(zero + 1.0, zero, zero, zero)
    return SpatialState(Vec3(*x[:, :3].T), level, Vec3(*x[:, 3:6].T), Vec3(zero, zero, zero))


def goal_at(now: float, count: int) -> SpatialState:
    zero = np.zeros(count)
    goal = state_of(np.tile([*GOAL, 0.0, 0.0, 0.0], (count, 1)))
    left = zero + DEADLINE - now
    return SpatialState(
        goal.p, goal.attitude, goal.v, goal.w, notes=HoldPlan(left, left, zero, held=zero - 1.0)
    )


def flown(pilot: Any, until: float) -> tuple[np.ndarray, np.ndarray]:
    """States (K, N, 6) at all instants at which thrusters shut, and changes of velocity (T, N), m/s."""
    count = len(STARTS)
    x = np.concatenate([STARTS, np.zeros((count, 3))], axis=1)
    # Forces of the craft in the order of its commands.
    directions = np.array([thruster.direction for thruster in pilot.craft.thrusters])
    forces = np.array([thruster.force for thruster in pilot.craft.thrusters])
    pilot.reset(count)
    states, changes = [x], []
    for k in range(int(until / PERIOD)):
        command = pilot.act(state_of(x), goal_at(k * PERIOD, count), np.zeros((count, 1)))
        assert command.min() >= 0.0
        assert command.max() <= 1.0
        push = command * forces @ directions / MASS
        changes.append(np.abs(push).sum(axis=1) * PERIOD)
        for _ in range(PARTS):
            x = (np.concatenate([x, push], axis=1) @ STEP.T)[:, :6]
            states.append(x)
    return np.array(states), np.array(changes)


@pytest.mark.slow
def test_every_coast_keeps_out_and_the_craft_holds() -> None:
    states, changes = flown(PassiveApproach("vbar-chaser", TASK), 3000.0)
    # Coasts of an orbit from every instant until it has held, but for the first period of the start that falls.
    coasting = states[: int((DEADLINE + 600.0) / PERIOD) * PARTS + 1].copy()
    nearest = np.linalg.norm(coasting[..., :3], axis=-1)
    for _ in range(200):
        coasting = coasting @ COAST.T
        nearest = np.minimum(nearest, np.linalg.norm(coasting[..., :3], axis=-1))
    assert nearest[0, 2] < 50.0
    assert nearest[:, :2].min() > 50.0
    assert nearest[PARTS:, 2].min() > 50.0
    # It arrives before the deadline, and stays within the tolerances long after it has held.
    after = states[int(DEADLINE / PERIOD) * PARTS :]
    assert np.linalg.norm(after[..., :3] - GOAL, axis=-1).max() < TASK.position_tolerance
    assert np.linalg.norm(after[..., 3:], axis=-1).max() < TASK.velocity_tolerance
    # The cheapest of the plans drawn that are safe, m/s.
    assert (changes.sum(axis=0) < [1.56, 0.40, 1.0]).all()
    # Holding for 1,700 s costs less than braking from the tolerance once.
    assert changes[int((DEADLINE + 100.0) / PERIOD) :].sum(axis=0).max() < TASK.velocity_tolerance
