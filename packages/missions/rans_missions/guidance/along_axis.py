"""Flight along an axis that may turn: a reference moves along it, and LQR keeps craft at the reference.

A corridor of a port, and a way straight to or from a hold point, are such axes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import solve_discrete_are

from rans.extend import ClohessyWiltshire, Vec3

_QUICKENING = 0.004
"""Acceleration of the reference, m/s^2: a fifth of what the thrusters of V-BAR's craft give."""
_PARTS = 64
"""Parts of a control period by whose middles a constant acceleration is integrated: exact to 1e-6 of it."""
_HALF = 0.5
"""Half of the time over which the velocity of the reference is a difference, s."""
_WEIGHTS = np.diag([1.0, 1.0, 1.0, 400.0, 400.0, 400.0])
"""Errors of 1 m count as much as those of 5 cm/s, and as a change of 1.6 cm/s in a period."""
_PRICE = 4e3 * np.eye(3)

Array = np.ndarray
Line = Callable[[float], tuple[Array, Array]]
"""Origins (N, 3), m, and unit directions (N, 3) of axes in W a time, s, from now."""


class AlongAxis:
    """Leads N craft along their axes, at a speed for each distance from the origin.

    Args:
        mean_motion: of the orbit whose Hill frame is W, rad/s.
        period: control period, s.
    """

    def __init__(self, mean_motion: float, period: float) -> None:
        self._period = period
        drift = ClohessyWiltshire(mean_motion)
        # Motion over a control period, and what a change of velocity that is spread over it adds.
        self._a = _transition(drift, period)
        part = np.vstack([np.zeros((3, 3)), np.eye(3) / _PARTS])
        later = [_transition(drift, period * (1.0 - (k + 0.5) / _PARTS)) for k in range(_PARTS)]
        self._b = np.sum(later, axis=0) @ part
        cost = solve_discrete_are(self._a, self._b, _WEIGHTS, _PRICE)
        gain = self._b.T @ cost
        self._gain = np.linalg.solve(_PRICE + gain @ self._b, gain @ self._a)
        self._inverse = np.linalg.pinv(self._b)
        self.reset()

    def reset(self, distance: float | None = None) -> None:
        """Begin flights: references begin at a distance, m; None: where the craft are along their axes."""
        self.distance: Array | None = None if distance is None else np.array([distance])
        """Distance of every reference from its origin, (N,), m; None before the first change."""
        self._fastest: Array = np.zeros(1)
        self._past: Array = np.zeros(1)

    def change(
        self,
        states: Array,
        line: Line,
        speed: Callable[[Array], Array],
        nearest: float = -np.inf,
    ) -> Array:
        """Changes of velocity in W for the next control period, (N, 3), m/s.

        Call it once a period: the references move on.

        Args:
            states: positions, m, and velocities, m/s, in W, (N, 6).
            line: the axes.
            speed: speeds towards the origins for distances (N,), m/s; negative: away from them.
            nearest: distance at which references that come nearer stop, m.
        """
        before = self.distance
        if before is None:
            origin, axis = line(0.0)
            before = ((states[:, :3] - origin) * axis).sum(axis=1)
        # Its speed increases slowly enough for the thrusters to follow.
        advised = speed(before)
        self._fastest = np.minimum(np.abs(advised), self._fastest + _QUICKENING * self._period)
        step = np.copysign(self._fastest, advised) * self._period
        after = before - step
        after = np.where(step > 0.0, np.maximum(after, nearest), after)
        now = _reference(line, 0.0, before, self._past)
        self._past = (after - before) / self._period
        later = _reference(line, self._period, after, self._past)
        self.distance = after
        # The change that leads from reference to reference, and the feedback of the error.
        ahead = (later - now @ self._a.T) @ self._inverse.T
        return ahead - (states - now) @ self._gain.T


def _reference(line: Line, time: float, distance: Array, speed: Array) -> Array:
    """States (N, 6) a time, s, from now on the axes, at distances, m, and speeds along them, m/s.

    A central difference over `_HALF` gives the velocity of a point at rest on an axis that turns.
    """
    places = []
    for instant in (time - _HALF, time, time + _HALF):
        origin, axis = line(instant)
        places.append(origin + distance[:, None] * axis)
    behind, place, ahead = places
    moving = (ahead - behind) / (2.0 * _HALF) + speed[:, None] * line(time)[1]
    return np.concatenate([place, moving], axis=1)


def _transition(drift: ClohessyWiltshire, time: float) -> Array:
    """Transition matrix of position and velocity after a time, (6, 6)."""
    basis = np.eye(6)
    p, v = drift.carry(Vec3(*basis[:3]), Vec3(*basis[3:]), time)
    return np.array([np.broadcast_to(x, 6) for x in (*p.columns(), *v.columns())])
