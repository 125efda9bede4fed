"""Bounds of the impulse through balls: equal to closed forms, and below every flight."""

from __future__ import annotations

import numpy as np
import pytest
from rans_missions.convex.waypoints import Waypoint, least_impulse_through
from scipy.optimize import minimize

SLACK = 1 - 1e-6
"""What is optimal has rounding, and the optimiser 1e-8 of its own."""


def _ball(time: float, place: tuple[float, ...], radius: float, half: float = 0.0) -> Waypoint:
    return Waypoint(time - half, time + half, np.array(place), radius)


def test_impulse_through_balls_by_hand():
    """What balls with spans, halves and lines of them change."""
    here = np.zeros(2)
    # At the latest instant of a span it is the slowest.
    late = [_ball(9.0, (3.0, 0.0), 0.0, 1.0)]
    assert least_impulse_through(5.0, here, late) == pytest.approx(5.0 * 0.3, rel=1e-6)
    # Half of a ball: the craft comes to the plane, 1.5 m from the centre.
    half = [Waypoint(10.0, 10.0, np.array((5.0, 0.0)), 3.0, np.array((1.0, 0.0)), 1.5)]
    assert least_impulse_through(5.0, here, half) == pytest.approx(5.0 * 0.35, rel=1e-6)
    # Across the line x = 3 m, at least 4 m aside.
    x, y = np.eye(2)
    line = [Waypoint(10.0, 10.0, np.array((3.0, 9.0)), 8.0, y, 5.0, x)]
    assert least_impulse_through(5.0, here, line) == pytest.approx(5.0 * 0.5, rel=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_impulse_through_balls_is_that_of_the_best_changes_of_velocity(seed):
    """Least impulse of velocity changes that reach the balls, by another solver: the dual of the bound."""
    random = np.random.default_rng(seed)
    size = 2 + seed % 2
    times = np.cumsum(random.uniform(3.0, 10.0, 3))
    places = random.normal(size=(3, size)) * 2.0
    radii = random.uniform(0.05, 0.5, 3)
    balls = [_ball(t, tuple(p), r) for t, p, r in zip(times, places, radii, strict=True)]
    bound = least_impulse_through(1.0, np.zeros(size), balls)
    begins = np.array([0.0, *times[:-1]])

    def apart(x: np.ndarray) -> np.ndarray:
        changes = x.reshape(3, size)
        lasting = np.maximum(times[:, None] - begins, 0.0)
        return radii**2 - ((lasting @ changes - places) ** 2).sum(axis=1)

    def size_of(x: np.ndarray) -> float:
        return float(np.sqrt((x.reshape(3, size) ** 2).sum(axis=1) + 1e-14).sum())

    first = [places[0] / times[0]]
    for k in (1, 2):
        way = (places[k] - places[k - 1]) / (times[k] - times[k - 1])
        first.append(way - np.sum(first, axis=0))
    found = minimize(
        size_of,
        np.array(first).ravel(),
        constraints={"type": "ineq", "fun": apart},
        options={"ftol": 1e-12, "maxiter": 500},
    )
    assert bound * SLACK <= found.fun <= bound * 1.001
