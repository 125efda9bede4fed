"""A Kalman filter of states in space, in W and with quaternions: an oracle of the filters on what is observed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3

_DRIFT = 1e-3
"""Variance by which a velocity wanders in a period, in units of its noise's: little, in a known world."""
_PERIODS = 200
"""After so many the gains no longer change."""


def gains(period: float, drift: float = _DRIFT, count: int = _PERIODS) -> np.ndarray:
    """(count, 2, 2) gains of position and velocity, read with noise of one size, from the first reading on.

    Kalman, "A new approach to linear filtering and prediction problems", 1960: of an axis that moves on as
    its velocity says.
    """
    moves = np.array([[1.0, period], [0.0, 1.0]])
    noise = np.eye(2)
    wander = np.diag([drift * (0.5 * period) ** 2, drift])
    doubt = np.eye(2)
    found = [np.eye(2)]
    for _ in range(count - 1):
        doubt = moves @ doubt @ moves.T + wander
        found.append(doubt @ np.linalg.inv(doubt + noise))
        doubt = (np.eye(2) - found[-1]) @ doubt
    return np.array(found)


def corrected(expected: SpatialState, measured: SpatialState, gain: np.ndarray) -> SpatialState:
    """The state expected, moved towards that measured by these gains (2, 2) of pose and velocity."""
    turn = expected.attitude.inverse().times(measured.attitude)
    side = np.where(
        np.asarray(turn.w) < 0.0, -2.0, 2.0
    )  # twice the vector part, the short way round
    off = (
        (measured.p - expected.p, measured.v - expected.v),
        (Vec3(turn.x * side, turn.y * side, turn.z * side), measured.w - expected.w),
    )
    moved, turned = (
        [pose.scale(row[0]) + velocity.scale(row[1]) for row in gain] for pose, velocity in off
    )
    half = turned[0].scale(0.5)
    small = Quat(np.ones_like(side), *half.columns()).normalised()
    return replace(
        expected,
        p=expected.p + moved[0],
        v=expected.v + moved[1],
        w=expected.w + turned[1],
        attitude=expected.attitude.times(small).normalised(),
    )
