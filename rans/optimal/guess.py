"""Where the optimiser starts: a smooth motion from the start to the goal that ends at rest there."""

from __future__ import annotations

import math

import numpy as np

from rans.dynamics import State
from rans.fields import Field, Heading, Quat, leaves, wrap
from rans.optimal.allocation import Allocation
from rans.spacecraft import Spacecraft


def rotation_vector(rotation: Heading | Quat) -> np.ndarray:
    """Axis times angle of the shortest equal rotation, rad.

    Args:
        rotation: of floats or arrays (N,).

    Returns:
        (1,) or (1, N) in the plane, (3,) or (3, N) in space.
    """
    if isinstance(rotation, Heading):
        return np.array([wrap(rotation.angle)])
    w, vector = np.asarray(rotation.w), np.array([rotation.x, rotation.y, rotation.z])
    sine = np.linalg.norm(vector, axis=0)
    # angle / sin(angle / 2) tends to 2 where the rotation vanishes
    ratio = np.where(sine > 0, 2.0 * np.arctan2(sine, np.abs(w)) / np.where(sine > 0, sine, 1.0), 2.0)
    return vector * np.where(w < 0, -ratio, ratio)


def rest_to_rest(start: State, goal: State, duration: float, intervals: int,
                 long_way: bool = False) -> np.ndarray:
    """Straight to the goal while turning about one fixed axis, both at the pace 3 s^2 - 2 s^3.

    Args:
        start: of floats; its velocity and spin are not matched.
        goal: of floats.
        duration: s.
        intervals: N equal parts of the duration.
        long_way: turn the other way round, by 2 pi minus the angle.

    Returns:
        (leaves of the state, N): the states at the ends of the intervals.
    """
    s = np.arange(1, intervals + 1) / intervals
    pace, rate = s * s * (3.0 - 2.0 * s), 6.0 * s * (1.0 - s) / duration
    way = np.array((goal.p - start.p).columns())  # type: ignore[operator]
    turn = rotation_vector(start.attitude.to(goal.attitude))  # type: ignore[arg-type]
    if long_way:
        turn = _other_way(turn)
    return np.vstack([
        np.array(start.p.columns())[:, None] + np.outer(way, pace),
        _turned(start.attitude, turn, pace),
        np.outer(way, rate),
        np.outer(turn, rate),  # the axis is the same in W relative to the start and in B throughout
    ])


def _other_way(turn: np.ndarray) -> np.ndarray:
    """The rotation vector that ends in the same attitude the other way round."""
    angle = float(np.linalg.norm(turn))
    axis = turn / angle if angle > 0 else np.eye(len(turn))[-1]
    return axis * (angle - math.tau)


def _turned(attitude: Heading | Quat, turn: np.ndarray, pace: Field) -> np.ndarray:
    """The attitude after each share of a turn: (1, N) heading or (4, N) quaternion."""
    if isinstance(attitude, Heading):
        return np.array([attitude.angle + turn[0] * pace])
    angle = float(np.linalg.norm(turn))
    axis = turn / angle if angle > 0 else turn
    x, y, z = np.outer(axis, np.sin(0.5 * angle * pace))
    return np.array(leaves(attitude.times(Quat(np.cos(0.5 * angle * pace), x, y, z))))


def transfer_time(craft: Spacecraft, start: State, goal: State) -> float:
    """About how long the craft needs from rest to rest, s.

    Constant acceleration and braking take 2 sqrt(way / acceleration); the slower of the translation
    and the turn counts, with a fifth to spare for doing both at once.
    """
    force, torque = Allocation(craft).authority()
    way = float((goal.p - start.p).norm())  # type: ignore[operator]
    turn = float(np.linalg.norm(rotation_vector(start.attitude.to(goal.attitude))))  # type: ignore[arg-type]
    inertia = float(np.linalg.eigvalsh(np.array(craft.inertia))[-1])
    return 1.2 * 2.0 * math.sqrt(max(way * craft.mass / force, turn * inertia / torque, 1e-6))
