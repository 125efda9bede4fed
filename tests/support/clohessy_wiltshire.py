"""Relative motion near a circular orbit by a matrix exponential, independent of the closed form in `rans`."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm


def transition(mean_motion: float, duration: float) -> np.ndarray:
    """Matrix (9, 9) that moves (p, v, a) for a time, s, while the acceleration a is held.

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
    return expm(rates * duration)


def orbit(n: float) -> np.ndarray:
    """The differential equations of Clohessy and Wiltshire as a matrix, (6, 6)."""
    system = np.zeros((6, 6))
    system[:3, 3:] = np.eye(3)
    system[3, 0], system[3, 4], system[4, 3], system[5, 2] = 3 * n * n, 2 * n, -2 * n, -n * n
    return system
