"""Velocities from poses: a Kalman filter of bodies that are pushed at random."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from rans_robot.frames import Motion, rotation

_LONGEST_GAP = 1.0
"""s without a pose after which the filter begins anew."""


class VelocityFilter:
    """Position, attitude and velocities of a stream of poses at irregular times.

    Every axis is a body whose acceleration is white noise, measured with white noise: the constant-velocity Kalman
    filter (Bar-Shalom, Li, Kirubarajan 2001, section 6.2.2). Attitudes are filtered by their rotation vector from
    the predicted one, in the body frame.

    Args:
        acceleration: what the craft can do, m/s^2, and angular, rad/s^2: spectral density of the noise, per
            axis and second.
        noise: standard deviation of a pose, m and rad.
    """

    def __init__(self, acceleration: tuple[float, float], noise: tuple[float, float]) -> None:
        self._linear = _Axis(acceleration[0], noise[0])
        self._angular = _Axis(acceleration[1], noise[1])
        self._time = 0
        self._motion: Motion | None = None

    def begin(self) -> None:
        """Forget what came before, as where times are those of another clock."""
        self._motion = None

    def update(self, time: int, position: np.ndarray, attitude: np.ndarray) -> Motion:
        """Motion after a pose that was measured at a time, ns; attitude as a unit quaternion (w, x, y, z).

        Remembers motion, time and gains; positions are (3,) in W.
        """
        last = self._motion
        step = (time - self._time) * 1e-9
        if last is None or not 0.0 < step < _LONGEST_GAP:
            if last is not None and step == 0.0:
                return last
            self._linear.begin()
            self._angular.begin()
            still = np.zeros(3)
            self._time = time
            self._motion = Motion(position.copy(), attitude.copy(), still, still)
            return self._motion

        # Translation.
        to_position, to_velocity = self._linear.gains(step)
        predicted = last.position + step * last.velocity
        off = position - predicted

        # Rotation: what turns the predicted attitude into the measured one, in the body frame.
        to_attitude, to_spin = self._angular.gains(step)
        turned = rotation(last.attitude) * Rotation.from_rotvec(step * last.spin)
        amiss = (turned.inv() * rotation(attitude)).as_rotvec()
        corrected = turned * Rotation.from_rotvec(to_attitude * amiss)

        self._time = time
        self._motion = Motion(
            predicted + to_position * off,
            corrected.as_quat(scalar_first=True),
            last.velocity + to_velocity * off,
            last.spin + to_spin * amiss,
        )
        return self._motion


class _Axis:
    """Covariance of one axis, the same for all three."""

    def __init__(self, acceleration: float, noise: float) -> None:
        self._density = acceleration**2
        self._noise = noise**2
        self.begin()

    def begin(self) -> None:
        """After the first pose: the velocity may be anything that a laboratory sees."""
        self._covariance = np.diag([self._noise, 1.0])

    def gains(self, step: float) -> tuple[float, float]:
        """Kalman gains on position (1) and velocity (1/s) of the pose that comes a step, s, later."""
        move = np.array([[1.0, step], [0.0, 1.0]])
        push = np.array([[step**3 / 3.0, step**2 / 2.0], [step**2 / 2.0, step]])
        ahead = move @ self._covariance @ move.T + self._density * push
        gain = ahead[:, 0] / (ahead[0, 0] + self._noise)
        self._covariance = ahead - np.outer(gain, ahead[0])
        return float(gain[0]), float(gain[1])
