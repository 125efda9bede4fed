"""Motion of free points in a linear drift, as rows of arrays.

States are (..., 2 d): positions, m, and then velocities, m/s.

Bounds and certificates rest on these matrices: they are the drift's own closed form.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from rans.extend import Drift, Vec2, Vec3
from rans.model.dynamics import RULES
from rans_missions.vectors import components


def carried(drift: Drift, states: np.ndarray, times: Any) -> np.ndarray:
    """States (..., 2 d) after times, s, which broadcast to their rows."""
    shape = np.broadcast_shapes(states.shape[:-1], np.shape(times))
    columns = np.moveaxis(states, -1, 0)
    size = len(columns) // 2
    vector: Any = Vec2 if size == 2 else Vec3
    p, v = drift.carry(vector(*columns[:size]), vector(*columns[size:]), times)
    return np.concatenate([components(x, shape) for x in (p, v)], axis=-1)


def transition(drift: Drift, times: Any, size: int = 3) -> np.ndarray:
    """Matrices (..., 2 d, 2 d) from states, of so many axes d, to those after times (...), s."""
    return np.swapaxes(carried(drift, np.eye(2 * size), np.expand_dims(times, -1)), -1, -2)


def held(drift: Drift, times: Any, size: int = 3) -> np.ndarray:
    """States (..., 2 d, d) after accelerations of 1 m/s^2 along each axis from rest, for times (...), s."""
    parts = (
        weight * transition(drift, (1.0 - node) * times, size)[..., size:]
        for node, weight in RULES[8]
    )
    return np.multiply(sum(parts), np.asarray(times)[..., None, None])


@lru_cache
def _of_period(drift: Drift, time: float) -> tuple[np.ndarray, np.ndarray]:
    return transition(drift, time), held(drift, time)


def pushed(drift: Drift, states: np.ndarray, push: np.ndarray, time: float) -> np.ndarray:
    """States (B, 6) after a time, s, under constant accelerations (B, 3) in W, m/s^2."""
    whole, forced = _of_period(drift, time)
    return states @ whole.T + push @ forced.T
