"""Frames of robots: RANS's own (ENU-like world, forward-left-up body) and PX4's (NED, forward-right-down).

RANS flies in any right-handed world W with z up and a body B whose axes are those of spacecraft.toml, x forward,
y left, z up. PX4's world is x north, y east, z down, its body x forward, y right, z down. With W as x east, y
north, z up the two differ by fixed rotations: a vector of the world by a swap of x and y and a sign of z, a
vector of the body by the signs of y and z.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from rans.extend import Quat

Vector = Sequence[float] | np.ndarray


class Motion(NamedTuple):
    """Pose and velocities of a body in space; a planar craft moves in z = 0."""

    position: np.ndarray
    """(3,), m, in the world."""
    attitude: np.ndarray
    """(4,), unit quaternion (w, x, y, z): body to world."""
    velocity: np.ndarray
    """(3,), m/s, in the world."""
    spin: np.ndarray
    """(3,), rad/s, in the body."""


_HALF = np.sqrt(0.5)


def swapped(motion: Motion) -> Motion:
    """Motion in RANS's frames as PX4 has it, or PX4's as RANS has it.

    With the half turns q_NED,ENU about (1, 1, 0) and q_FLU,FRD about x the attitude is their product around the
    rotation.
    """
    (x, y, z), (w, a, b, c), (u, v, climb), (roll, pitch, yaw) = motion
    return Motion(
        np.array([y, x, -z], dtype=float),
        np.array([w + c, a + b, a - b, w - c], dtype=float) * _HALF,
        np.array([v, u, -climb], dtype=float),
        np.array([roll, -pitch, -yaw], dtype=float),
    )


def heading_of(quaternion: Vector) -> float:
    """Heading of the body's x axis in the plane, rad in [-pi, pi]."""
    w, x, y, z = quaternion
    return float(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def quaternion_of(heading: float) -> np.ndarray:
    """Unit quaternion (w, x, y, z) of a heading, rad."""
    return np.array([np.cos(heading / 2.0), 0.0, 0.0, np.sin(heading / 2.0)])


def rotation(quaternion: Vector) -> Rotation:
    """Rotation of a unit quaternion (w, x, y, z)."""
    return Rotation.from_quat(quaternion, scalar_first=True)


def small_turns(begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Small rotation (3,), rad, in B, from an attitude (4,) to another."""
    turn = Quat(*begin.tolist()).to(Quat(*end.tolist()))
    return np.array([turn.x, turn.y, turn.z]) * np.copysign(2.0, turn.w)
