"""The oblate Earth in axes that do not turn: an oracle of orbits that shares no equation with their drifts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from rans_missions.orbits.earth import EARTH, EARTH_RADIUS, J2
from rans_missions.two_body import Gravity, Target
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class OblateEarth:
    """Gravity with the term J2, and targets on the orbits that are nearest to a circle."""

    inclination: float
    """rad"""
    latitude: np.ndarray
    """Argument of latitude of each target at time 0, rad, (N,)."""

    @property
    def gravity(self) -> Gravity:
        """Gravity whose J2 acts on target and craft."""
        return Gravity(self.acceleration)

    def acceleration(self, r: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Acceleration (N, 3) by J2, m/s^2, at positions (N, 3), z along the Earth's axis."""
        square = np.sum(r**2, axis=1, keepdims=True)
        height = 5.0 * r[:, 2:] ** 2 / square
        factors = np.concatenate([height - 1.0, height - 1.0, height - 3.0], axis=1)
        return 1.5 * J2 * EARTH * EARTH_RADIUS**2 / square**2.5 * factors * r

    def target(self, mean_motion: float) -> Target:
        """Targets with a mean radius (mu / n^2)^(1/3).

        Their radius has the short-period term of J2 alone (D. A. Vallado, "Fundamentals of Astrodynamics and
        Applications", section 9.6), k/6 sin(i)^2 cos 2u, k = 3/2 J2 (R / a)^2, which no choice of the start
        removes.
        """
        size = (EARTH / mean_motion**2) ** (1.0 / 3.0)
        k = 1.5 * J2 * (EARTH_RADIUS / size) ** 2
        tilt = np.sin(self.inclination) ** 2
        swing = k / 6.0 * tilt * np.cos(2.0 * self.latitude)
        climb = -k / 3.0 * tilt * np.sin(2.0 * self.latitude)
        angular = 1.0 + 0.5 * k * (1.0 - 1.5 * tilt) + swing
        angles = np.stack([0.0 * swing, 0.0 * swing + self.inclination, self.latitude], axis=1)
        axes = Rotation.from_euler("ZXZ", angles).as_matrix()
        radius = (size * (1.0 + swing))[:, None]
        along = radius * (mean_motion * angular)[:, None] * axes[:, :, 1]
        along += (size * mean_motion * climb)[:, None] * axes[:, :, 0]
        return radius * axes[:, :, 0], along
