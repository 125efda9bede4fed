"""Coordinates of a state around another, such as its goal: 6 in the plane, 12 in space.

They are the position in W, the rotation as angle or vector in the other body's frame, the velocity in W and the
angular velocity.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rans.model.dynamics import PlanarState, SpatialState
from rans.model.fields import (
    Attitude,
    Field,
    Heading,
    Quat,
    Vec2,
    Vec3,
    atan2,
    cos,
    leaves,
    sin,
    sqrt,
    wrap,
)

_TINY = 1e-24
"""Added to squared lengths whose root is taken: it has no gradient at zero."""


def around(goal: Any, coordinates: Any) -> Any:
    """The state that has these coordinates around the goal, given as 6 or 12 fields.

    MPC plans in these coordinates, and differentiates this function.
    """
    if len(coordinates) == 6:
        px, py, turn, vx, vy, w = coordinates
        return PlanarState(
            goal.p + Vec2(px, py),
            Heading(goal.attitude.angle + turn),
            goal.v + Vec2(vx, vy),
            goal.w + w,
        )
    p, turn, v, w = (Vec3(*coordinates[i : i + 3]) for i in (0, 3, 6, 9))
    return SpatialState(goal.p + p, goal.attitude.times(_quaternion(turn)), goal.v + v, goal.w + w)


def _quaternion(turn: Vec3) -> Quat:
    angle = sqrt(turn.dot(turn) + _TINY)
    axis = turn.scale(sin(0.5 * angle) / angle)
    return Quat(cos(0.5 * angle), axis.x, axis.y, axis.z)


def coordinates(state: Any, goal: Any) -> tuple[Field, ...]:
    """The coordinates of a state, smooth up to a full turn from the goal: what `around` inverts."""
    turn = goal.attitude.to(state.attitude)
    vector = (turn.angle,) if isinstance(turn, Heading) else _rotation_vector(turn)
    spin = (a - b for a, b in zip(state.spin(), goal.spin(), strict=True))
    return (*(state.p - goal.p).columns(), *vector, *(state.v - goal.v).columns(), *spin)


def _rotation_vector(turn: Quat) -> tuple[Field, ...]:
    axis = Vec3(turn.x, turn.y, turn.z)
    sine = sqrt(axis.dot(axis) + _TINY)
    return axis.scale(2.0 * atan2(sine, turn.w) / sine).columns()


def rotation_vector(rotation: Attitude) -> np.ndarray:
    """Axis times angle (rad) of the shortest equal rotation, of floats or arrays (N,).

    (1,) or (1, N) in the plane, (3,) or (3, N) in space.
    """
    if isinstance(rotation, Heading):
        return np.array([wrap(rotation.angle)])
    w, *xyz = map(np.asarray, leaves(rotation))
    vector = np.array(xyz)
    sine = np.linalg.norm(vector, axis=0)
    # angle / sin(angle / 2) tends to 2 where the rotation vanishes
    ratio = np.where(
        sine > 0, 2.0 * np.arctan2(sine, np.abs(w)) / np.where(sine > 0, sine, 1.0), 2.0
    )
    return vector * np.where(w < 0, -ratio, ratio)
