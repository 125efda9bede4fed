"""Coasts beside balls and below speed limits, on straight lines and against a fine search in an orbit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rans_missions.guidance.orbital import FewBurns, SingleImpulse

from rans.model.drift import FREE, ClohessyWiltshire
from rans.model.fields import Vec3
from rans.tasks.shapes import Ball, SpeedLimit

REST = Vec3(0.0, 0.0, 0.0)


def vector(*columns: float) -> Vec3:
    return Vec3(*(np.array([x]) for x in columns))


MISSION: Any = SimpleNamespace(
    speed_reserve=0.1, keep_out_reserve=2.0, most_gain=5.0, shortest_aim=1.0
)


def coasts(*limits: Any, drift: Any = FREE, kind: Any = SingleImpulse) -> Any:
    return kind(MISSION, drift, limits)


def test_in_an_orbit_it_is_that_of_a_fine_search():
    """The line through the nearest of seven points misses the arc by less than 1 m of 100 m."""
    drift = ClohessyWiltshire(0.0011)
    state = SimpleNamespace(p=vector(30.0, -200.0, 10.0), v=vector(0.1, 0.2, 0.0))
    ball = Ball(Vec3(0.0, -100.0, 0.0), REST, 10.0)
    nearest, _ = coasts(drift=drift).nearest(ball, state, state.v, np.array([1500.0]))
    times = np.linspace(0.0, 1500.0, 20_001)
    p, _ = drift.carry(state.p, state.v, times)
    finest = (p - ball.centre).norm().min()
    assert finest <= nearest.norm()[0] < finest + 1.0


def test_a_velocity_goes_around_a_ball():
    """The foot of the perpendicular, 3 m beside the centre, is moved to 12 m: by 9 m in 50 s."""
    state = SimpleNamespace(p=vector(-50.0, 3.0, 0.0), v=vector(1.0, 0.0, 0.0))
    ball = Ball(REST, REST, 10.0)
    around = coasts(ball).within(state, state.v, np.array([120.0]))
    assert [x[0] for x in around.columns()] == pytest.approx([1.0, 9.0 / 50.0, 0.0], abs=1e-9)
    # It now turns away, so that the point moved is not the nearest; repeated pushes clear the ball.
    repeated = coasts(ball, kind=FewBurns).within(state, state.v, np.array([120.0]))
    nearest, _ = coasts().nearest(ball, state, repeated, np.array([120.0]))
    assert nearest.norm()[0] > 11.9
    far = Ball(Vec3(0.0, 30.0, 0.0), REST, 10.0)
    assert coasts(far).within(state, state.v, np.array([120.0])).y[0] == 0.0


def test_a_velocity_stays_below_the_limit_by_its_reserve():
    """0.2 + 0.01 * 50 m/s are allowed 50 m away, less a tenth; a length of zero counts 1 nm/s."""
    state = SimpleNamespace(p=vector(-50.0, 0.0, 0.0), v=vector(1.0, 0.0, 0.0))
    limit = SpeedLimit(REST, 0.2, 0.01)
    slower = coasts(limit).within(state, vector(3.0, 4.0, 0.0), np.array([120.0]))
    assert [x[0] for x in slower.columns()] == pytest.approx([0.378, 0.504, 0.0], rel=1e-8)
    # Without one, up to the largest speed.
    fast = coasts().within(state, vector(30.0, 40.0, 0.0), np.array([120.0]))
    assert fast.norm()[0] == pytest.approx(5.0, rel=1e-12)
