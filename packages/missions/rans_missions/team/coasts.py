"""Passive safety of a team: how near deputies come to one another after a failure of all thrusters."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import solve_ivp

from rans_missions.orbits.earth import EARTH

_STEP = 20.0
"""Time between instants of coasts, s."""


def coasts_apart(mean_motion: float, states: np.ndarray) -> float:
    """Least distance between deputies if all thrusters shut at any of T instants, for an orbit in two-body gravity.

    It is that at instants 20 s apart, m; infinite for one deputy, and without instants.

    Args:
        mean_motion: mean motion n of the target's orbit, rad/s.
        states: states in the Hill frame, (T, D, 6).
    """
    # From the Hill frame to axes that do not turn, where the target is at (r, 0, 0) with n r along y.
    radius = (EARTH / mean_motion**2) ** (1.0 / 3.0)
    p = states[..., :3] + np.array([radius, 0.0, 0.0])
    v = states[..., 3:] + np.cross([0.0, 0.0, mean_motion], p)
    pairs = np.triu_indices(states.shape[1], 1)
    if not len(pairs[0]) or not len(p):
        return math.inf

    def motion(_: float, both: np.ndarray) -> np.ndarray:
        p, v = both.reshape(2, -1, 3)
        pull = -EARTH * p / np.linalg.norm(p, axis=1, keepdims=True) ** 3
        return np.concatenate([v, pull], axis=None)

    period = 2.0 * math.pi / mean_motion
    coasts = solve_ivp(
        motion,
        (0.0, period),
        np.concatenate([p, v], axis=None),
        "DOP853",
        np.arange(0.0, period, _STEP),
        rtol=1e-10,
        atol=1e-6,
    )
    flown = coasts.y[: p.size].reshape(*p.shape, -1)
    return float(np.linalg.norm(flown[:, pairs[0]] - flown[:, pairs[1]], axis=2).min())
