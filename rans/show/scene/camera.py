"""Poses of a camera from which all points are in the picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np


class Camera(NamedTuple):
    """Camera that stands upright, in W, m."""

    position: np.ndarray
    """(3,)."""
    target: np.ndarray
    """(3,): in the middle of the picture."""

    @property
    def axes(self) -> np.ndarray:
        """(3, 3): unit vectors by row, to the right, up, and from the target to the camera."""
        return _axes(self.position - self.target)


def fitted_camera(
    points: np.ndarray, direction: Sequence[float], upright: float, aspect: float
) -> Camera:
    """The nearest camera in this direction that sees all points.

    A point stands x to the right, y up and z towards the viewer. It is in a picture whose half width is
    t = tan(half angle) at distance 1 if |x - s| <= t (d - z), the camera standing at s and d. Over all points
    that is d >= max(z + x / t) - s / t and d >= max(z - x / t) + s / t, and d is least where both are equal;
    the same of y.

    Args:
        points: (K, 3) m in W.
        direction: from the points to the camera, not along z.
        upright: the whole angle from the lower to the upper edge of the picture, rad.
        aspect: width over height of the picture.
    """
    axes = _axes(np.array(direction))
    x, y, z = axes @ points.T
    shifts = []
    distances = []
    for along, tangent in ((x, aspect * math.tan(upright / 2.0)), (y, math.tan(upright / 2.0))):
        front = float(np.max(z + along / tangent))
        back = float(np.max(z - along / tangent))
        shifts.append(tangent * (front - back) / 2.0)
        distances.append((front + back) / 2.0)
    middle = float(z.min() + z.max()) / 2.0
    target = axes.T @ [*shifts, middle]
    return Camera(target + (max(distances) - middle) * axes[2], target)


def _axes(back: np.ndarray) -> np.ndarray:
    back = back / np.linalg.norm(back)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    return np.stack((right, np.cross(back, right), back))
