"""Bounds of the impulse through balls: equal to closed forms, and below every flight."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_missions.convex.waypoints import Waypoint, least_impulse_through
from scipy.optimize import minimize

from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2, Vec3
from rans.model.spacecraft_file import load_spacecraft
from tests.support.problems import spatial

PLATFORM = load_spacecraft("floating-platform")
FLYER = load_spacecraft("free-flyer")
SHARED = replace(PLATFORM, thrust_sharing="split")
SLACK = 1 - 1e-6
"""What is optimal has rounding, and the optimiser 1e-8 of its own."""


def planar(v: tuple[float, float] = (0.0, 0.0)) -> PlanarState:
    return PlanarState(Vec2(0.0, 0.0), Heading(0.0), Vec2(*v), 0.0)


def _ball(time: float, place: tuple[float, ...], radius: float, half: float = 0.0) -> Waypoint:
    return Waypoint(time - half, time + half, np.array(place), radius)


def test_impulse_through_balls_by_hand():
    """What balls with spans, halves and lines of them change."""
    mass = PLATFORM.mass
    start = planar()
    # At the latest instant of a span it is the slowest; who coasts there anyway spends nothing.
    late = [_ball(9.0, (3.0, 0.0), 0.0, 1.0)]
    assert least_impulse_through(PLATFORM, start, late) == pytest.approx(mass * 0.3, rel=1e-6)
    # So does who is there at another instant of the span than its middle.
    moving = planar(v=(0.3, 0.1))
    early = [_ball(10.0, (2.7, 0.9), 0.0, 1.0)]
    assert least_impulse_through(PLATFORM, moving, early) == 0.0
    early = [Waypoint(9.0, 11.0, np.array((2.7, 0.0)), 5.0, np.array((-1.0, 0.0)))]
    assert least_impulse_through(PLATFORM, moving, early) == 0.0
    early = [Waypoint(9.0, 11.0, np.array((2.7, 0.0)), 5.0, level=np.array((1.0, 0.0)))]
    assert least_impulse_through(PLATFORM, moving, early) == 0.0
    # Half of a ball: the craft comes to the plane, 1.5 m from the centre.
    half = [Waypoint(10.0, 10.0, np.array((5.0, 0.0)), 3.0, np.array((1.0, 0.0)), 1.5)]
    assert least_impulse_through(PLATFORM, start, half) == pytest.approx(mass * 0.35, rel=1e-6)
    # Across the line x = 3 m, at least 4 m aside of where the start's velocity leads.
    x, y = np.eye(2)
    line = [Waypoint(10.0, 10.0, np.array((3.0, 9.0)), 8.0, y, 5.0, x)]
    assert least_impulse_through(PLATFORM, start, line) == pytest.approx(mass * 0.5, rel=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_impulse_through_balls_is_that_of_the_best_changes_of_velocity(seed):
    """Least impulse of velocity changes that reach the balls, by another solver: the dual of the bound."""
    random = np.random.default_rng(seed)
    size = 2 + seed % 2
    craft = PLATFORM if size == 2 else FLYER
    rest: Any = planar() if size == 2 else spatial()
    vector: Any = Vec2 if size == 2 else Vec3
    speed = random.normal(size=size) * 0.1
    start = replace(rest, p=vector(*[0.0] * size), v=vector(*map(float, speed)))
    times = np.cumsum(random.uniform(3.0, 10.0, 3))
    places = random.normal(size=(3, size)) * 2.0
    radii = random.uniform(0.05, 0.5, 3)
    balls = [_ball(t, tuple(p), r) for t, p, r in zip(times, places, radii, strict=True)]
    bound = least_impulse_through(craft, start, balls)
    begins = np.array([0.0, *times[:-1]])

    def apart(x: np.ndarray) -> np.ndarray:
        changes = x.reshape(3, size)
        lasting = np.maximum(times[:, None] - begins, 0.0)
        return radii**2 - ((times[:, None] * speed + lasting @ changes - places) ** 2).sum(axis=1)

    def size_of(x: np.ndarray) -> float:
        return float(np.sqrt((x.reshape(3, size) ** 2).sum(axis=1) + 1e-14).sum())

    first = [places[0] / times[0] - speed]
    for k in (1, 2):
        way = (places[k] - places[k - 1]) / (times[k] - times[k - 1])
        first.append(way - speed - np.sum(first, axis=0))
    found = minimize(
        size_of,
        np.array(first).ravel(),
        constraints={"type": "ineq", "fun": apart},
        options={"ftol": 1e-12, "maxiter": 500},
    )
    assert bound * SLACK <= craft.mass * found.fun <= bound * 1.001
