"""Relative motion near a circular orbit by a matrix exponential, independent of the closed form in `rans`."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm


def orbit_rates(mean_motion: float) -> np.ndarray:
    """Matrix (9, 9) whose exponential moves (p, v, a) by a second, while the acceleration a is held.

    x points away from the planet, y along the orbit, z completes the frame (Clohessy and Wiltshire, Journal of the
    Aerospace Sciences 27, 1960); the first six rows and columns are those of a coast.
    """
    rates = np.zeros((9, 9))
    rates[:3, 3:6] = np.eye(3)
    rates[3:6, 6:] = np.eye(3)
    rates[3, 0] = 3.0 * mean_motion**2
    rates[3, 4] = 2.0 * mean_motion
    rates[4, 3] = -2.0 * mean_motion
    rates[5, 2] = -(mean_motion**2)
    return rates


def transition(mean_motion: float, duration: float) -> np.ndarray:
    """Matrix (9, 9) that moves (p, v, a) for a time, s."""
    return expm(orbit_rates(mean_motion) * duration)


def orbit(n: float) -> np.ndarray:
    """The differential equations of Clohessy and Wiltshire as a matrix, (6, 6)."""
    return orbit_rates(n)[:6, :6]
