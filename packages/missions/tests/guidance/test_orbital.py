"""Guidance to a position on an orbit: it arrives, brakes, and burns across the plane when that is cheapest."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rans_missions.guidance.orbital import FewBurns, OrbitalGuidance, SingleImpulse
from rans_missions.tasks import Dock, Hold

from rans.model.drift import ClohessyWiltshire
from rans.model.fields import Vec3
from rans.tasks.shapes import Ball, SpeedLimit

N = 0.001027
DRIFT = ClohessyWiltshire(N)
PERIOD = 10.0
REST = Vec3(0.0, 0.0, 0.0)


def vector(*columns: float) -> Vec3:
    return Vec3(*(np.array([x]) for x in columns))


def guidance(
    kind: type[OrbitalGuidance], *limits: Any, velocity_tolerance: float = 0.2
) -> OrbitalGuidance:
    settings = {"position_tolerance": 2.0, "velocity_tolerance": velocity_tolerance}
    mission = Hold if kind is FewBurns else Dock
    return kind(
        mission(mean_motion=N, braking_time=20.0, shortest_aim=PERIOD, **settings), DRIFT, limits
    )


def flown(
    law: OrbitalGuidance, p: Vec3, goal: Vec3, time: float, beyond: float = 0.0
) -> tuple[np.ndarray, np.ndarray, float]:
    """Positions and velocities at the end of every period, and the sum of all burns along the axes, m/s."""
    v = vector(0.0, 0.0, 0.0)
    target: Any = SimpleNamespace(p=goal, v=vector(0.0, 0.0, 0.0))
    positions, velocities, spent = [], [], 0.0
    for left in np.arange(time, -beyond, -PERIOD):
        state: Any = SimpleNamespace(p=p, v=v)
        left_now = np.array([left])
        new = law.velocity(state, target, left_now, left_now + 20.0)
        spent += sum(abs(float(x[0])) for x in (new - v).columns())
        p, v = DRIFT.carry(p, new, PERIOD)
        positions.append([float(x[0]) for x in p.columns()])
        velocities.append([float(x[0]) for x in v.columns()])
    return np.array(positions), np.array(velocities), spent


@pytest.mark.parametrize(("left", "waits"), [(1700.0, True), (1400.0, False)])
def test_the_burn_across_the_plane_waits_for_a_quarter_of_an_orbit(left, waits):
    """A quarter is 1,530 s. In the plane the burn is that of the Clohessy-Wiltshire matrix, written out here."""
    law = guidance(SingleImpulse, velocity_tolerance=1e3)
    x, y, z = 40.0, -90.0, 30.0
    state = SimpleNamespace(p=vector(x, y, z), v=vector(0.0, 0.0, 0.0))
    goal = SimpleNamespace(p=vector(0.0, 0.0, 0.0), v=vector(0.0, 0.0, 0.0))
    time = np.array([left])
    burn = law.velocity(state, goal, time, time)
    a = N * left
    s, c = np.sin(a), np.cos(a)
    response = np.array([[s, 2.0 * (1.0 - c)], [-2.0 * (1.0 - c), 4.0 * s - 3.0 * a]]) / N
    coast = np.array([x * (4.0 - 3.0 * c), y + 6.0 * x * (s - a)])
    np.testing.assert_allclose([burn.x[0], burn.y[0]], np.linalg.solve(response, -coast), atol=1e-9)
    assert burn.z[0] == pytest.approx(0.0 if waits else -z * N * c / s)


@pytest.mark.slow
def test_few_burns_arrive_around_a_ball_and_brake():
    """From before the target to behind it: never inside its ball, and within both tolerances around the arrival."""
    law = guidance(FewBurns, Ball(REST, REST, 50.0))
    goal = vector(0.0, -100.0, 0.0)
    positions, velocities, _ = flown(law, vector(20.0, 200.0, 10.0), goal, 1500.0, 30.0)
    assert np.linalg.norm(positions, axis=1).min() > 50.0
    near = np.linalg.norm(positions - [0.0, -100.0, 0.0], axis=1) < 2.0
    slow = np.linalg.norm(velocities, axis=1) < 0.2
    assert np.any((near & slow)[-5:])


def test_a_craft_that_comes_too_late_keeps_the_speed_limit_and_the_ball():
    """40 m from the goal three periods after the planned arrival: it would go at 1 m/s."""
    limits = Ball(REST, REST, 20.0), SpeedLimit(REST, 0.1, 0.0041)
    law = guidance(FewBurns, *limits)
    goal = SimpleNamespace(p=vector(0.0, -30.0, 0.0), v=REST)
    p, v = vector(0.0, 15.0, 30.0), vector(0.0, 0.0, 0.0)
    for step in range(80):
        left = np.array([-PERIOD * (3 + step)])
        v = law.velocity(SimpleNamespace(p=p, v=v), goal, left, left + 2000.0)
        distance = p.norm()[0]
        # Half a percent for rounding of the scale: the reserve of guidance is 3 %.
        assert v.norm()[0] < 0.975 * (0.1 + 0.0041 * distance)
        p, v = DRIFT.carry(p, v, PERIOD)
        assert p.norm()[0] > 20.0
        if (goal.p - p).norm()[0] < 2.0:
            return
    raise AssertionError("it did not come to the goal within 800 s")


def test_nobody_beside_a_ball_is_faster_than_is_allowed():
    """From 2,000 states near a ball, at 0.3 to 0.4 m/s where 0.32 to 0.36 m/s are allowed; a goal is behind it."""
    limits = Ball(REST, REST, 53.0), SpeedLimit(REST, 0.2, 0.0022)
    law = guidance(FewBurns, *limits)
    random = np.random.default_rng(0)
    directions = random.normal(size=(2, 3, 2000))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    p = Vec3(*(directions[0] * random.uniform(54.0, 75.0, 2000)))
    v = Vec3(*(directions[1] * random.uniform(0.3, 0.4, 2000)))
    goal = SimpleNamespace(p=vector(0.0, -62.6, 0.0), v=REST)
    left = np.full(2000, 900.0)
    flown = law.velocity(SimpleNamespace(p=p, v=v), goal, left, left + 300.0)
    assert (flown.norm() < 0.2 + 0.0022 * p.norm()).all()


@pytest.mark.parametrize("kind", [SingleImpulse, FewBurns])
def test_the_plan_is_no_dearer_than_the_latest_arrival(kind):
    law = guidance(kind)
    start = SimpleNamespace(p=vector(60.0, -90.0, 30.0), v=vector(0.1, 0.1, 0.0))
    goal = SimpleNamespace(p=vector(0.0, 0.0, 0.0), v=vector(0.0, 0.0, 0.0))
    deadline = np.array([2000.0])
    arrival = law.arrival(start, goal, deadline)
    latest = np.array([1980.0 if law.mission.brakes else 2000.0])
    assert arrival[0] <= latest[0]
    assert arrival[0] % PERIOD == 0.0
    planned, at_latest = (law.price(start, goal, time)[0] for time in (arrival, latest))
    assert planned <= at_latest
