"""Kalman filter of position and velocity under a drift, with noisy readings and inexact burns."""

from __future__ import annotations

import math

import numpy as np

from rans.extend import Drift
from rans.model.drift import steady
from rans_missions.orbits.linear import transition

STEADY_TIME = 6000.0
"""Time in which an unknown acceleration becomes another one, s: about that of a low orbit."""


class NavigationFilter:
    """Estimates positions and velocities of N craft from noisy readings of both, one reading a control period.

    Estimate and covariance are carried along the drift, which must be linear in position and velocity, as the
    Clohessy-Wiltshire equations are. A burn that a craft gives is known up to a share of its size. Source: R. E.
    Kalman, "A new approach to linear filtering and prediction problems", Journal of Basic Engineering 82, 1960.

    Args:
        drift: equations of motion between burns.
        dimension: number of axes d, 2 or 3.
        period: time between readings, s.
        position: standard deviation of the noise of every component of a measured position, m.
        velocity: the same of a measured velocity, m/s.
        burns: standard deviation of the change of velocity of a burn, as a share of it.
        acceleration: standard deviation of every component of an unknown acceleration, m/s^2, which is estimated
            too. It is a Gauss-Markov process with a time constant of `STEADY_TIME`. With zero the filter trusts its
            equations more with every reading, and a constant force leads it astray.
    """

    def __init__(
        self,
        drift: Drift,
        dimension: int,
        period: float,
        position: float,
        velocity: float,
        burns: float,
        acceleration: float = 0.0,
    ) -> None:
        d = dimension
        steady(drift, "a navigation filter computes its matrix once")
        half = 0.5 * period
        keeps = math.exp(-half / STEADY_TIME)
        # The drift changes little in half a period, and what an acceleration does with it.
        self._half = np.block(
            [
                [transition(drift, half, d), np.kron([[0.5 * half**2], [half]], np.eye(d))],
                [np.zeros((d, 2 * d)), keeps * np.eye(d)],
            ]
        )
        """Transition over half a period of position, velocity and acceleration, (3 d, 3 d)."""
        self._whole = self._half @ self._half
        # Exact readings have a little noise too, so that no matrix is singular.
        self._deviations = np.repeat((max(position, 1e-6), max(velocity, 1e-9)), d)
        self._noise = np.diag(self._deviations**2)
        self._burns = burns
        self._pushes = np.zeros((3 * d, 3 * d))
        """Covariance of what a period adds, (3 d, 3 d): changes of the acceleration."""
        self._pushes[2 * d :, 2 * d :] = acceleration**2 * (1.0 - keeps**4) * np.eye(d)
        self._acceleration = np.full(d, acceleration)
        self._dimension = d
        self._mean: np.ndarray | None = None
        self._covariance: np.ndarray = np.empty(0)

    def reset(self) -> None:
        """Forget everything: the next reading is the first."""
        self._mean = None

    def read(self, reading: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Estimate (N, 2 d) and covariance (N, 2 d, 2 d) after a reading (N, 2 d): positions, then velocities.

        The first reading begins it.
        """
        read = len(self._deviations)
        size = read + self._dimension
        if self._mean is None:
            self._mean = np.pad(reading, ((0, 0), (0, self._dimension)))
            self._covariance = np.zeros((len(reading), size, size))
            self._covariance[:, :read, :read] = self._noise
            self._covariance[:, read:, read:] = np.diag(self._acceleration**2)
        else:
            before = self._covariance
            # All are symmetric, so that the transposed gain solves this system.
            seen = before[:, :read, :read] + self._noise
            gain = np.linalg.solve(seen, before[:, :read]).transpose(0, 2, 1)
            missed = reading - self._mean[:, :read]
            self._mean = self._mean + (gain @ missed[:, :, None])[:, :, 0]
            complement = np.eye(size) - np.pad(gain, ((0, 0), (0, 0), (0, self._dimension)))
            of_before = complement @ before @ complement.transpose(0, 2, 1)
            of_reading = gain @ self._noise @ gain.transpose(0, 2, 1)
            self._covariance = of_before + of_reading
        return self._mean[:, :read], self._covariance[:, :read, :read]

    def acceleration(self) -> np.ndarray:
        """Estimated acceleration (N, d), m/s^2, after a reading."""
        assert self._mean is not None
        return self._mean[:, 2 * self._dimension :]

    def burn(self, change: np.ndarray) -> None:
        """Carry the estimate to the next reading, with a burn (N, d) in m/s spread evenly over the period.

        Call it after `read`, once a period.
        """
        assert self._mean is not None
        d = self._dimension
        halfway = self._mean @ self._half.T
        halfway[:, d : 2 * d] += change
        self._mean = halfway @ self._half.T
        spread = np.zeros((len(change), 3 * d, 3 * d))
        axes = np.arange(d, 2 * d)
        spread[:, axes, axes] = (self._burns * change) ** 2
        self._covariance = (
            self._whole @ self._covariance @ self._whole.T
            + self._half @ spread @ self._half.T
            + self._pushes
        )
