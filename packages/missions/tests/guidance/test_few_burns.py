"""Transfers of few burns: flown burn by burn they arrive, and cost no less than the proven bound."""

from __future__ import annotations

import numpy as np
import pytest
from rans_missions.guidance.few_burns import INTERVALS, ArrivalTolerance, Coast, KeepOut, _Burn

from rans.model.drift import ClohessyWiltshire
from rans.model.fields import Vec3

N = 0.0011
DRIFT = ClohessyWiltshire(N)
POINT = ArrivalTolerance(plane=0.0, across=0.0, speed=0.0)


def coast(
    p: tuple[float, ...], v: tuple[float, ...], time: float, tolerance: ArrivalTolerance = POINT
) -> Coast:
    zero = np.zeros(1)
    place, speed = (Vec3(*(zero + x for x in one)) for one in (p, v))
    goal = Vec3(zero, zero - 100.0, zero)
    return Coast(N, place, speed, goal, zero + time, tolerance, acceleration=0.02)


def size(v: Vec3) -> float:
    return sum(abs(float(x[0])) for x in v.columns())


def test_a_transfer_at_once_reaches_the_goal() -> None:
    """In a plane without anything across; the drift's own solution is the oracle."""
    one = coast((200.0, 50.0, 0.0), (0.1, -0.2, 0.0), 900.0)
    found = one.burning_now()
    p, v = DRIFT.carry(one.p, one.v + found.burn, 900.0)
    np.testing.assert_allclose([p.x, p.y, p.z], [[0.0], [-100.0], [0.0]], atol=1e-6)
    assert found.price[0] == pytest.approx(size(found.burn) + size(v), rel=1e-9)
    assert found.brake[0] == pytest.approx(max(abs(v.x[0]), abs(v.y[0])), rel=1e-9)


def test_across_the_plane_it_waits_for_the_node() -> None:
    """At rest 100 m across, a craft comes to the plane at n times 100 m after a quarter of an orbit.

    One burn there stops it. Whoever burns at once pays 1.8 times as much by 1,900 s: 100 m n times the cotangent of
    0.0011 * 1900 and the inverse of its sine.
    """
    angle = N * 1900.0
    at_once = 100.0 * N * (abs(np.cos(angle)) + 1.0) / np.sin(angle)
    one = coast((0.0, -100.0, 100.0), (0.0, 0.0, 0.0), 1900.0)
    found = one.burning_now()
    assert found.burn.z[0] == 0.0
    assert 100.0 * N < found.price[0] < 1.1 * 100.0 * N
    assert at_once > 1.7 * found.price[0]


def test_nothing_is_corrected_within_the_tolerances() -> None:
    """A craft that drifts through the goal slowly needs no burn."""
    found = coast(
        (0.5, -101.0, 0.5), (0.0, 0.005, 0.0), 100.0, ArrivalTolerance(3.0, 2.0, 0.03)
    ).cheapest()
    assert size(found.burn) == 0.0
    assert found.price[0] == 0.0


@pytest.mark.parametrize("across", [0.0, 2000.0], ids=["burns across", "coasts across"])
def test_a_detour_is_priced_by_the_nearest_point_of_the_flight(across: float) -> None:
    """Two burns and perhaps one across the plane, flown by the drift's own solution, beside a ball off the origin.

    Halfway between two of the points that are compared, the flight may be nearer by half the straight way of an
    interval, which the radius has to include.
    """
    tolerance = ArrivalTolerance(plane=0.0, across=across, speed=10.0)
    one = coast((-40.0, 200.0, 30.0), (0.05, -0.1, 0.06), 500.0, tolerance)
    ball = KeepOut(Vec3(*(np.zeros(1) + x for x in (-60.0, 40.0, 25.0))), 54.0)
    upward, _, _, heights = one._across()
    assert bool(upward[0]) == (across == 0.0)
    burns = _Burn(1, np.array([-0.4]), 0), _Burn(0, np.array([-0.03]), 3)
    clearances = one._clearances(ball, heights)
    found = one._detour(ball, clearances, burns)
    p, v = one.p, one.v + Vec3(np.zeros(1), np.array([-0.4]), upward)
    half_way = np.array([40.0, -300.0, -30.0]) / (2 * INTERVALS)
    centre = np.array([-60.0, 40.0, 25.0])
    inside = 0.0
    for k in range(1, INTERVALS + 1):
        p, v = DRIFT.carry(p, v, 500.0 / INTERVALS)
        distance = np.array([x[0] for x in p.columns()]) - centre
        inside = max(inside, 54.0**2 + half_way @ half_way - distance @ distance)
        if k == 3:
            v = v + Vec3(np.array([-0.03]), np.zeros(1), np.zeros(1))
    assert inside > 1000.0
    # 8 m/s times s for every metre, of which there are (r^2 - d^2) / 2 r, over the time.
    assert found[0] == pytest.approx(8.0 * inside / (2.0 * 54.0) / 500.0, rel=1e-6)


def test_a_postponed_burn_saves_impulse() -> None:
    """From between the target and the goal by 1,900 s, one burn along the track is cheaper later."""
    one = coast((7.7, -15.8, 0.0), (0.0, 0.0, 0.0), 1900.0)
    assert one.cheapest().price[0] <= one.burning_now().price[0] * (1.0 - 0.005)
