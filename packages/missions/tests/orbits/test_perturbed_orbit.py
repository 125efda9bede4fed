"""Relative motion with an oblate Earth and drag, against two-body gravity in axes that do not turn."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from rans_missions.orbits.earth import EARTH, EARTH_RADIUS, J2
from rans_missions.orbits.perturbed import PerturbedOrbit
from scipy.integrate import solve_ivp

from rans.model.drift import ClohessyWiltshire
from rans.model.fields import Vec3

N = 0.0011068
"""rad/s, a low orbit."""
RADIUS = (EARTH / N**2) ** (1 / 3)


def carried(drift: Any, p: np.ndarray, v: np.ndarray, time: float) -> np.ndarray:
    """Positions (N, 3) after a time."""
    return np.stack(drift.carry(Vec3(*p.T), Vec3(*v.T), time)[0].columns(), axis=1)


def test_coasts_agree_with_both_craft_integrated_by_themselves():
    """Positions of target and craft about the Earth's centre, J2 as the gradient of its potential, and air.

    Nothing is shared with the package but the constants and the start of the target, and the air has one scale
    height.
    """
    tilt, latitude, height = 0.9, 2.1, 63.822e3
    drags = 0.02, 0.05
    k = PerturbedOrbit.around_earth(N, tilt).oblateness
    base = RADIUS - EARTH_RADIUS

    def pull(r, v, drag):
        size = math.sqrt(r @ r)
        # The potential mu/r - mu J2 R^2 (3 z^2 - r^2) / (2 r^5), term by term.
        outer = EARTH * J2 * EARTH_RADIUS**2
        oblate = outer * (7.5 * r[2] ** 2 / size**7 - 1.5 / size**5) * r
        oblate[2] -= outer * 3.0 * r[2] / size**5
        wind = v - 7.292115e-5 * np.array([-r[1], r[0], 0.0])
        air = 6.967e-13 * math.exp((base - (size - EARTH_RADIUS)) / height)
        return -EARTH / size**3 * r + oblate - 0.5 * drag * air * math.sqrt(wind @ wind) * wind

    def slope(_, y):
        r, v, r_2, v_2 = y.reshape(4, 3)
        return np.concatenate([v, pull(r, v, drags[0]), v_2, pull(r_2, v_2, drags[1])])

    def frame(r, v):
        x = r / np.linalg.norm(r)
        z = np.cross(r, v) / np.linalg.norm(np.cross(r, v))
        return np.stack([x, np.cross(z, x), z], axis=1)

    # The target where it is nearest to a circle; the frame turns with it, and tilts by the pull across its plane.
    s_2 = math.sin(tilt) ** 2
    up = math.sin(latitude)
    x = np.array([math.cos(latitude), up * math.cos(tilt), up * math.sin(tilt)])
    y = np.cross([0.0, -math.sin(tilt), math.cos(tilt)], x)
    swing = k / 6.0 * s_2 * math.cos(2.0 * latitude)
    r = RADIUS * (1.0 + swing) * x
    rate = N * (1.0 + 0.5 * k * (1.0 - 1.5 * s_2) + swing)
    v = -RADIUS * N * k / 3.0 * s_2 * math.sin(2.0 * latitude) * x + (r @ x) * rate * y
    axes = frame(r, v)
    across = float(pull(r, v, drags[0]) @ axes[:, 2]) / (rate * float(r @ x))
    twist = axes @ np.array([across, 0.0, rate])
    p = np.array([20.0, -70.0, 40.0])
    begin = np.concatenate([r, v, r + axes @ p, v + np.cross(twist, axes @ p)])
    # Absolute positions have 1e-9 m of rounding; the integration is asked for 1e-6 m.
    end = solve_ivp(slope, (0.0, 2000.0), begin, "DOP853", rtol=1e-13, atol=1e-7).y[:, -1]
    r, v, r_2, _ = end.reshape(4, 3)
    truth = frame(r, v).T @ (r_2 - r)
    wind = N * RADIUS - 7.292115e-5 * RADIUS * math.cos(tilt)
    drag = 0.5 * 6.967e-13 * wind**2 * (drags[1] - drags[0])
    drift = PerturbedOrbit.around_earth(N, tilt, drag, latitude)
    still = 0.0 * p[None]
    ours, without, sphere = (
        float(np.linalg.norm(carried(d, p[None], still, 2000.0) - truth))
        for d in (drift, replace(drift, drag=0.0), ClohessyWiltshire(N))
    )
    # At 80 m gravity's curvature is 1e-5 of 400 m; drag and the second order of k are 3 % of their effects.
    assert ours < 0.06
    assert without > 0.5
    assert sphere > 0.5
