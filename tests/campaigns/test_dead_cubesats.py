"""Flights of a craft whose wheels balance its thrusters: numbers worked by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from campaigns.dead_cubesats import Balanced, turn

WAYS = np.vstack([np.eye(3), -np.eye(3)])
"""Directions of six thrusters."""


def craft(arm: float = 0.0, momentum: float = 1e3) -> Balanced:
    """A craft of 1 kg with thrusters of 1 N, whose forces along x pass by its centre of mass at an arm, m."""
    torques = np.zeros((6, 3))
    torques[:, 2] = arm * WAYS[:, 0]
    return Balanced(WAYS, torques, np.full(3, 10.0), np.full(3, momentum))


def test_half_of_the_time_is_for_braking() -> None:
    """1 m at 1 m/s^2: 1 s of thrust, 1 s of braking."""
    assert craft().time(np.array([1.0, 0.0, 0.0]), step=0.1) == pytest.approx(2.0)


def test_full_wheels_limit_the_speed() -> None:
    """Wheels of 0.25 N m s take the torque of 0.25 s of thrust: 4 m at 0.25 m/s, and 0.25 s to reach it."""
    slow = craft(arm=1.0, momentum=0.25).time(np.array([4.0, 0.0, 0.0]), step=0.25)
    assert slow == pytest.approx(4.0 / 0.25 + 0.25)


def test_what_no_thruster_pushes_is_not_reached() -> None:
    lame = craft()._replace(accelerations=WAYS * [1.0, 1.0, 0.0])
    assert math.isinf(lame.time(np.array([0.0, 0.0, 1.0])))


def test_a_turn_is_limited_by_momentum_or_torque() -> None:
    """Half a turn about x with 2 kg m^2: at 0.1 rad/s, reached in 0.1 s; or with 1 rad/s^2 half of the way."""
    rotation = np.diag([1.0, -1.0, -1.0])
    inertia = np.array([2.0, 5.0, 7.0])
    wheels = craft()._replace(torque=np.array([2.0, 0.1, 0.1]))
    slow = wheels._replace(momentum=np.array([0.2, 0.1, 0.1]))
    assert turn(rotation, inertia, slow) == pytest.approx(math.pi / 0.1 + 0.1)
    assert turn(rotation, inertia, wheels) == pytest.approx(2.0 * math.sqrt(math.pi))
    assert turn(np.eye(3), inertia, wheels) == 0.0
