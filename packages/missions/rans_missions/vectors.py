"""Vectors of fields as arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

from rans.extend import leaves


def numbers(vector: Any) -> np.ndarray:
    """Components (d,) of a vector of numbers, or of arrays of one number."""
    return np.array([float(np.squeeze(x)) for x in leaves(vector)])


def components(vector: Any, shape: int | tuple[int, ...]) -> np.ndarray:
    """Components of a vector as the last axis, (*shape, d), of fields that broadcast to this shape."""
    return np.stack([np.broadcast_to(x, shape) for x in leaves(vector)], axis=-1)


def motion_of(state: Any) -> np.ndarray:
    """Positions (m) and velocities (m/s) of states as the last axis, (..., 2 d)."""
    return np.stack([*leaves(state.p), *leaves(state.v)], axis=-1)
