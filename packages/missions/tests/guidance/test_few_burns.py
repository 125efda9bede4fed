"""Transfers of few burns: flown burn by burn they arrive, and cost no less than the proven bound."""

from __future__ import annotations

import numpy as np
import pytest
from rans_missions.guidance.few_burns import ArrivalTolerance, Transfer, cheapest_transfer

from rans.model.drift import ClohessyWiltshire
from rans.model.fields import Vec3

N = 0.0011
DRIFT = ClohessyWiltshire(N)
POINT = ArrivalTolerance(plane=0.0, across=0.0, speed=0.0)


def transfer(
    p: tuple[float, ...], v: tuple[float, ...], time: float, tolerance: ArrivalTolerance = POINT
) -> Transfer:
    zero = np.zeros(1)
    place, speed = (Vec3(*(zero + x for x in one)) for one in (p, v))
    goal = Vec3(zero, zero - 100.0, zero)
    return cheapest_transfer(N, place, speed, goal, zero + time, tolerance)


def size(v: Vec3) -> float:
    return sum(abs(float(x[0])) for x in v.columns())


def test_a_transfer_at_once_reaches_the_goal():
    """In a plane without anything across; the drift's own solution is the oracle."""
    found = transfer((200.0, 50.0, 0.0), (0.1, -0.2, 0.0), 900.0)
    p, v = DRIFT.carry(Vec3(200.0, 50.0, 0.0), Vec3(0.1, -0.2, 0.0) + found.burn, 900.0)
    np.testing.assert_allclose([p.x, p.y, p.z], [[0.0], [-100.0], [0.0]], atol=1e-6)
    assert found.price[0] == pytest.approx(size(found.burn) + size(v), rel=1e-9)
    assert found.brake[0] == pytest.approx(max(abs(v.x[0]), abs(v.y[0])), rel=1e-9)


def test_across_the_plane_it_waits_for_the_node():
    """At rest 100 m across, a craft comes to the plane at n times 100 m after a quarter of an orbit.

    One burn there stops it. Whoever burns at once pays 1.8 times as much by 1,900 s: 100 m n times the cotangent of
    0.0011 * 1900 and the inverse of its sine.
    """
    angle = N * 1900.0
    at_once = 100.0 * N * (abs(np.cos(angle)) + 1.0) / np.sin(angle)
    found = transfer((0.0, -100.0, 100.0), (0.0, 0.0, 0.0), 1900.0)
    assert found.burn.z[0] == 0.0
    assert 100.0 * N < found.price[0] < 1.1 * 100.0 * N
    assert at_once > 1.7 * found.price[0]


def test_nothing_is_corrected_within_the_tolerances():
    """A craft that drifts through the goal slowly needs no burn."""
    found = transfer((0.5, -101.0, 0.5), (0.0, 0.005, 0.0), 100.0, ArrivalTolerance(3.0, 2.0, 0.03))
    assert size(found.burn) == 0.0
    assert found.price[0] == 0.0
