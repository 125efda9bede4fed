"""Guidance of descents: its time is a root of its polynomial, and its thrust brings a point to rest."""

import math

import numpy as np
import pytest
from rans_missions.guidance.descent import DescentLaw

from rans.model.fields import Vec3

G = 3.7114
"""Gravity of Mars, m/s^2."""


@pytest.mark.slow
def test_the_law_lands_at_rest_after_its_time():
    """A free point under its thrust, in steps of Heun of 5 ms; the thrust it spends is what it says."""
    p = np.array([300.0, -200.0, 400.0])
    v = np.array([20.0, 5.0, -30.0])
    first = DescentLaw.of(Vec3(*p), Vec3(*v), G, 2.0)
    time = float(first.time)
    step = time / 4000
    square = 0.0
    weight = np.array([0.0, 0.0, -G])
    for _ in range(3960):  # to 1 % before the end, where feedback divides by nothing

        def thrust(p, v):
            return np.array(DescentLaw.of(Vec3(*p), Vec3(*v), G, 2.0).thrust.columns())

        now = thrust(p, v)
        ahead = thrust(p + step * v, v + step * (now + weight))
        mean = 0.5 * (now + ahead)
        p = p + step * v + 0.5 * step**2 * (mean + weight)
        v = v + step * (mean + weight)
        square += step * mean @ mean
    left = float(DescentLaw.of(Vec3(*p), Vec3(*v), G, 2.0).time)
    assert left == pytest.approx(0.01 * time, rel=0.01)
    assert np.linalg.norm(p) < 1.0
    assert np.linalg.norm(v) < 1.5
    expected = math.sqrt(time * square)
    # One per cent of the time is missing.
    assert float(first.speed) == pytest.approx(expected, rel=0.01)
