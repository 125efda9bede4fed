"""Descents of a craft that turns: geometry by hand, and the descent whose optimum is known in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rans_missions.convex.landing import Descent, Lander, landing
from rans_missions.convex.steered_landing import (
    SteeredLandings,
    angular_velocity,
    attitude_of,
    roll_of,
    tilt_of,
    tilt_rate,
)

LANDER = Lander(1905.0, 400.0, 4972.0, 13258.0, 1966.0)
DESCENT = Descent(position_tolerance=0.5, velocity_tolerance=0.25)


def test_a_tilt_is_a_rotation_vector() -> None:
    """Tilted by 30 degrees about y of W, thrust points to +x; about x, to -y."""
    angle = math.radians(30.0)
    to_x = np.array([math.sin(angle), 0.0, math.cos(angle)])
    to_y = np.array([0.0, math.sin(angle), math.cos(angle)])
    np.testing.assert_allclose(tilt_of(to_x), [0.0, angle], atol=1e-12)
    np.testing.assert_allclose(tilt_of(to_y), [-angle, 0.0], atol=1e-12)
    # Turning about an axis across thrust at 0.2 rad/s; turning about thrust itself moves nothing.
    np.testing.assert_allclose(tilt_rate(to_x, np.array([0.0, 0.2, 0.0])), [0.0, 0.2], atol=1e-9)
    np.testing.assert_allclose(tilt_rate(to_x, 0.3 * to_x), [0.0, 0.0], atol=1e-9)


def test_roll_comes_before_tilt() -> None:
    """Rolled by 90 degrees, x of the craft is along y; tilted by 30 degrees about x then, it points upwards."""
    turned = attitude_of(np.array([math.radians(30.0), 0.0]), math.radians(90.0))
    np.testing.assert_allclose(turned[:, 0], [0.0, math.sqrt(0.75), 0.5], atol=1e-12)
    np.testing.assert_allclose(turned[:, 2], [0.0, -0.5, math.sqrt(0.75)], atol=1e-12)
    assert roll_of(turned) == pytest.approx(math.radians(90.0))


def test_circling_at_a_constant_tilt() -> None:
    """On a cone of half angle a, at a rate q about the vertical z, thrust n has w = q (z - (z . n) n)."""
    a, q = 0.6, 0.2
    n = np.array([math.sin(a), 0.0, math.cos(a)])
    z = np.array([0.0, 0.0, 1.0])
    found = angular_velocity(np.array([0.0, a]), np.array([-a * q, 0.0]))
    np.testing.assert_allclose(found, q * (z - (z @ n) * n), atol=1e-6)


def test_a_descent_straight_down_has_the_convex_optimum() -> None:
    """Nothing is to be turned there, so that both programs are the same but for the mass within a period."""
    start = np.array([0.0, 0.0, 300.0]), np.array([0.0, 0.0, -30.0])
    count = 50
    plan = landing(LANDER, DESCENT, start, 25.0)
    assert plan is not None
    landings = SteeredLandings(LANDER, DESCENT, 0.4, 0.5)
    state = np.concatenate([*start, np.zeros(4), [1905.0]])
    found = landings.from_convex(state, plan, count)
    assert found is not None
    assert found.propellant == pytest.approx(plan.propellant, rel=2e-3)
    # The gains know how the end is missed: a state on the plan misses nothing, one beside it little.
    end = found.states[-1]
    assert np.linalg.norm(end[:3]) <= 0.5 + 1e-6
    assert np.linalg.norm(end[3:6]) <= 0.25 + 1e-6
    beside = np.zeros(11)
    beside[0] = 1.0
    assert np.linalg.norm(found.misses[0][:3] @ beside) < 0.1
