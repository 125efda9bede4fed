"""Relative motion near a target on an elliptic orbit, against SciPy's integrator of equations written here."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, strategies as st
from rans_missions.orbits.earth import EARTH
from rans_missions.orbits.elliptic import EllipticOrbit, eccentric_anomaly, mean_anomaly
from scipy.integrate import solve_ivp

from rans.model.fields import Vec2, Vec3

N = 0.001027
"""rad/s, a low orbit."""
ECCENTRICITIES = [0.05, 0.3, 0.74, 0.9]


def target(eccentricity: float, true_anomaly: float) -> list[float]:
    """Radius, its rate, and the angle of the target at the start, by the equation of a conic section."""
    parameter = (EARTH / N**2) ** (1 / 3) * (1 - eccentricity**2)
    radius = parameter / (1 + eccentricity * math.cos(true_anomaly))
    outwards = math.sqrt(EARTH / parameter) * eccentricity * math.sin(true_anomaly)
    return [radius, outwards, true_anomaly]


def integrated(
    eccentricity: float, true_anomaly: float, start: np.ndarray, time: float, push: Any = None
) -> np.ndarray:
    """Position and velocity (6,) after a time by the equations of Tschauner and Hempel, with the target's own."""
    size = (EARTH / N**2) ** (1 / 3)
    momentum = math.sqrt(EARTH * size * (1 - eccentricity**2))

    def rates(t: float, y: np.ndarray) -> list[float]:
        radius, outwards, _, *motion = y
        x, y, z, *v = motion
        w = momentum / radius**2
        change = -2 * w * outwards / radius
        g = EARTH / radius**3
        pull = np.zeros(3) if push is None else push(t)
        return [
            outwards,
            momentum**2 / radius**3 - EARTH / radius**2,
            w,
            *v,
            (w * w + 2 * g) * x + change * y + 2 * w * v[1] + pull[0],
            (w * w - g) * y - change * x - 2 * w * v[0] + pull[1],
            -g * z + pull[2],
        ]

    begin = [*target(eccentricity, true_anomaly), *start]
    return solve_ivp(rates, (0, time), begin, "DOP853", rtol=1e-12, atol=1e-13).y[3:, -1]


@pytest.mark.parametrize("eccentricity", ECCENTRICITIES)
@pytest.mark.parametrize("time", [1.0, 900.0, 9000.0])
def test_coasts_obey_the_equations_of_tschauner_and_hempel(eccentricity, time):
    rng = np.random.default_rng(round(time))
    true = rng.uniform(-math.pi, math.pi)
    start = np.concatenate([rng.normal(size=3) * 100.0, rng.normal(size=3) * 0.1])
    drift = EllipticOrbit(N, eccentricity, mean_anomaly(true, eccentricity))
    p, v = drift.carry(Vec3(*map(float, start[:3])), Vec3(*map(float, start[3:])), time)
    expected = integrated(eccentricity, true, start, time)
    # The integrator's 1e-12, in a motion that an orbit and a half of 0.9 multiplies by thousands.
    scale = np.maximum(np.abs(expected).reshape(2, 3).max(axis=1), [100.0, 0.1]).repeat(3)
    assert (np.abs([*p.columns(), *v.columns()] - expected) < 1e-9 * scale).all()
    flat, speed = drift.carry(Vec2(*map(float, start[:2])), Vec2(*map(float, start[3:5])), time)
    assert (*flat.columns(), *speed.columns()) == (p.x, p.y, v.x, v.y)


@example(e=0.9, m=-0.1256)  # where a step less leaves 2e-10
@given(e=st.floats(0.0, 0.9), m=st.floats(-20.0, 20.0))
def test_keplers_equation_is_solved(e, m):
    anomaly = eccentric_anomaly(m, e)
    assert anomaly - e * math.sin(anomaly) == pytest.approx(m, abs=1e-13)
    # The true anomaly, by the tangents of halves, and back.
    half = math.sqrt((1 + e) / (1 - e)) * math.tan(0.5 * anomaly)
    back = mean_anomaly(2 * math.atan(half), e)
    # Near an apogee of 0.9 the tangent of a quarter turn loses some digits.
    assert math.remainder(back - m, math.tau) == pytest.approx(0.0, abs=1e-9)
