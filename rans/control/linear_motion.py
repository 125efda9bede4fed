"""Translation under a drift as a linear map, for controllers that compute gains of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from rans.model.drift import Drift
from rans.model.dynamics import RULES
from rans.model.fields import Vec2, Vec3

_RULE = RULES[8]
"""Nodes and weights of the quadrature of a constant acceleration through a drift."""


@dataclass(frozen=True)
class LinearMotion:
    """Position and velocity in W, one after the other as x = (p, v), after a time.

    x(t) = matrix x(0) + effect a + offset, where a is an acceleration, m/s^2, constant in W for that time. It
    is exact for every drift of `rans.model.drift`: all are affine in position and velocity.
    """

    matrix: np.ndarray
    """(2 d, 2 d) in d = 2 or 3 dimensions."""
    effect: np.ndarray
    """(2 d, d)"""
    offset: np.ndarray
    """(2 d,) where a point at rest at W's origin goes: zero unless gravity is uniform."""

    @classmethod
    def free(cls, axes: int, time: float) -> LinearMotion:
        """The motion of double integrators, of so many axes, over a time (s)."""
        unit = np.eye(axes)
        return cls(
            np.kron([[1.0, time], [0.0, 1.0]], unit),
            np.kron([[0.5 * time * time], [time]], unit),
            np.zeros(2 * axes),
        )

    @classmethod
    def of(cls, drift: Drift, dimension: Literal[2, 3], time: float) -> LinearMotion:
        """The motion of one drift over a time (s): matrices of (2 d,) states, exact for thrust held over it.

        It stands for one instant of the drift: where the drift changes, controllers refuse it (`steady`).
        """
        vector: Any = Vec2 if dimension == 2 else Vec3

        def carried(x: np.ndarray, duration: float) -> np.ndarray:
            p, v = drift.carry(
                vector(*map(float, x[:dimension])), vector(*map(float, x[dimension:])), duration
            )
            return np.array([*p.columns(), *v.columns()], dtype=float)

        def columns(duration: float) -> tuple[np.ndarray, np.ndarray]:
            offset = carried(np.zeros(2 * dimension), duration)
            unit = np.eye(2 * dimension)
            return np.column_stack([carried(x, duration) - offset for x in unit]), offset

        matrix, offset = columns(time)
        if drift.in_straight_lines:
            return replace(cls.free(dimension, time), offset=offset)
        effect = sum(
            weight * time * columns((1.0 - node) * time)[0][:, dimension:] for node, weight in _RULE
        )
        return cls(matrix, np.asarray(effect), offset)

    def after(self, p: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position and velocity, (d, N) each, of free points."""
        x = self.matrix @ np.vstack([p, v]) + self.offset[:, None]
        return x[: len(p)], x[len(p) :]

    def holding(self, p: np.ndarray, v: np.ndarray, later: np.ndarray) -> np.ndarray:
        """Acceleration, (d, N) m/s^2, with which points at p that move with v have the velocity ``later``.

        All are (d, N), in W.
        """
        _, drifted = self.after(p, v)
        return np.linalg.solve(self.effect[len(p) :], later - drifted)
