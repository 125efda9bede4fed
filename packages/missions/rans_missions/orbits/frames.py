"""Frames of ellipses and of orbits around an oblate planet in Drake's plant, without the drifts' equations."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from rans.extend import ConfigError, DrakeFrame
from rans.reference.frames import SPHERE

_KEPLER_STEPS = 50
"""Steps of Newton's method for Kepler's equation; ten are enough up to an eccentricity of 0.9."""


class UnevenFrame(DrakeFrame):
    """The frame of an orbit along which motion changes."""

    def angle(self, drift: Any) -> Any:
        """Where targets are at time 0, rad; a drift that differs in more is refused (`ConfigError`)."""
        own = self.orbit
        if type(drift) is not type(own) or own != replace(drift, angle=own.angle):
            raise ConfigError(f"the plant was built for {own!r}, got {drift!r}.")
        return drift.angle


class EllipticFrame(UnevenFrame):
    """An ellipse, whose rate and gravity follow from Kepler's equation at the time; angles are mean anomalies."""

    def motion(self, angles: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rate (N, 3), change of rate (N, 3) and gradient (N, 3, 3) of the frame at angles (N,) and a time.

        See `DrakeFrame.motion`.
        """
        n, e = self.orbit.mean_motion, self.orbit.eccentricity
        rate, change = np.zeros((2, len(angles), 3))
        # Kepler's equation by Newton's method, which converges from pi (Battin 1999, section 5.4).
        mean = np.mod(angles + n * time, 2.0 * np.pi)
        anomaly = np.full(mean.shape, np.pi)
        for _ in range(_KEPLER_STEPS):
            step = (anomaly - e * np.sin(anomaly) - mean) / (1.0 - e * np.cos(anomaly))
            anomaly = anomaly - step
            if np.abs(step).max() < 1e-15:
                break
        radius = 1.0 - e * np.cos(anomaly)
        rate[:, 2] = n * np.sqrt(1.0 - e * e) / radius**2
        change[:, 2] = -2.0 * rate[:, 2] * n * e * np.sin(anomaly) / radius**2
        return rate, change, (n * n / radius**3)[:, None, None] * SPHERE


class PerturbedFrame(UnevenFrame):
    """The orbit around an oblate planet that is nearest to a circle; angles are arguments of latitude.

    The angular velocity tilts with the plane of the orbit, and the gradient has the part of J2.
    J2 pulls with K (5 (r.a)^2 r / r^7 - r / r^5 - 2 (r.a) a / r^5) for the planet's axis a, and the gradient is the
    derivative of this vector. `rans_missions.orbits.perturbed` has the matrix of its components.
    """

    @property
    def drag(self) -> float:
        """Drag of the orbit's drift, m/s^2."""
        return float(self.orbit.drag)

    def motion(self, angles: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rate (N, 3), change of rate (N, 3) and gradient (N, 3, 3) of the frame at angles (N,) and a time.

        See `DrakeFrame.motion`.
        """
        orbit = self.orbit
        n, k = orbit.mean_motion, orbit.oblateness
        si, ci = np.sin(orbit.inclination), np.cos(orbit.inclination)
        # The plane's angle grows by the frame's rate, less what the node moves back.
        mean = n * (1.0 + 0.5 * k * (1.0 - 1.5 * si**2))
        u = angles + (mean + n * k * ci**2) * time
        rate, change = np.zeros((2, len(u), 3))
        rate[:, 0] = -2.0 * k * n * si * ci * np.sin(u)
        change[:, 0] = -2.0 * k * n**2 * si * ci * np.cos(u)
        rate[:, 2] = mean + n * k / 6.0 * si**2 * np.cos(2.0 * u)
        change[:, 2] = -(n**2) * k / 3.0 * si**2 * np.sin(2.0 * u)
        radius = 1.0 + k / 6.0 * si**2 * np.cos(2.0 * u)
        # The planet's axis in the Hill frame, and its component along the radius e.
        axis = np.stack([si * np.sin(u), si * np.cos(u), np.full(len(u), ci)], axis=1)
        e, one = np.array([1.0, 0.0, 0.0]), np.eye(3)
        z = axis[:, :1, None]
        along, across = axis[:, None, :], axis[:, :, None]
        both = e[:, None] * along + across * e
        oblate = 10.0 * z * both + (5.0 * z**2 - 1.0) * one
        oblate = oblate + (5.0 - 35.0 * z**2) * np.outer(e, e) - 2.0 * across * along
        sphere = n * n / radius[:, None, None] ** 3 * SPHERE
        return rate, change, sphere + k * n * n * oblate
