"""Where the optimiser starts: a smooth motion from the start to where the task wants the spacecraft.

Arrays are (columns, T), and s (T,) is the elapsed share of the duration; a guess decides which optimum is found.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from functools import cache
from typing import Any

import numpy as np

from rans.model.dynamics import State
from rans.model.fields import (
    Attitude,
    Field,
    Heading,
    Quat,
    Vec3,
    leaves,
    map_leaves,
    wrap,
)
from rans.model.spacecraft import Spacecraft
from rans.optimal.trajectory.allocation import Allocation, inertia

_BOW = 0.3
"""Sideways, of the way to go: standard deviation over the further guesses."""
_OFF_AXIS = 0.6
"""Sideways, rad: standard deviation about every axis over the further guesses."""


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


def guess(
    aims: Collection[str],
    start: State,
    goal: State,
    duration: float,
    intervals: int,
    number: int = 0,
) -> np.ndarray:
    """A motion that meets the aims (`rans.tasks.goal_set.aims`) and leaves all else alone.

    It is (leaves of the state, N): the states at the ends of N equal intervals of the duration, s. Guesses of
    odd numbers turn the other way round, by 2 pi minus the angle (in space: to the other of the two
    quaternions of the goal's attitude); from 1 on the turn is bowed off its axis at random, and from 2 on the path
    too. By symmetry a turn about one axis may be a stationary point that is no minimum, which no gradient
    leads away from. Where neither an attitude nor a
    spin is asked for, further guesses turn into other attitudes on the way, in the plane by 45 degrees either
    way, then 90: a craft that pushes harder along some of its axes may gain by it, and from an attitude midway
    between two of these no gradient says which one.
    """
    s = np.arange(1, intervals + 1) / intervals
    p, v = _translation(aims, start, goal, duration, s)
    # A bow vanishes at both ends, and so does its rate.
    bow = 16.0 * (s * (1 - s)) ** 2
    rate = 32.0 * s * (1 - s) * (1 - 2 * s) / duration
    random = np.random.default_rng(number)
    if number >= 2:
        size = _BOW * np.linalg.norm(p[:, -1] - np.array(start.p.columns()))
        sideways = random.normal(size=(len(p), 1)) * size
        p = p + sideways * bow
        v = v + sideways * rate
    if number > 0 and not {"attitude", "spin"} & set(aims):
        attitude, w = _turning(start, duration, s, number)
    else:
        attitude, w = _rotation(aims, start, goal, duration, s, long_way=number % 2 == 1)
        if number > 0:
            attitude, w = _bowed(attitude, w, random.normal(size=len(w)) * _OFF_AXIS, bow, rate)
    return np.vstack([p, attitude, v, w])


def _translation(
    aims: Collection[str], start: State, goal: State, duration: float, s: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Cubic in time (Hermite), or constant acceleration without a goal position: p and v, (d, T).

    `s` (T,) is the elapsed share of the duration (s).
    """
    p0, p1, v0, v1 = (np.array(x.columns())[:, None] for x in (start.p, goal.p, start.v, goal.v))
    if "velocity" not in aims:
        v1 = v0
    if "position" not in aims:
        p1 = p0 + 0.5 * duration * (v0 + v1)
    offset = p1 - p0
    before = duration * v0
    after = duration * v1
    square = 3.0 * offset - 2.0 * before - after
    cube = before + after - 2.0 * offset
    return (
        p0 + s * (before + s * (square + s * cube)),
        (before + s * (2.0 * square + s * 3.0 * cube)) / duration,
    )


def _rotation(
    aims: Collection[str], start: State, goal: State, duration: float, s: np.ndarray, long_way: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Attitude and w of a turn about one axis at the pace 3 s^2 - 2 s^3, or with constant angular acceleration.

    Where an attitude is asked for, the rates of start and goal are not matched. `s` (T,) is the elapsed share of
    the duration (s); results are (2 or 4, T) and (1 or 3, T).
    """
    if "attitude" in aims:
        turn = rotation_vector(start.attitude.to(goal.attitude))
        if long_way:
            angle = float(np.linalg.norm(turn))
            turn = (turn / angle if angle > 0 else np.eye(len(turn))[-1]) * (angle - math.tau)
        pace = s * s * (3.0 - 2.0 * s)
        rate = 6.0 * s * (1.0 - s) / duration
        # the axis is the same in W relative to the start and in B throughout
        return _turned(start.attitude, turn, pace), np.outer(turn, rate)
    first, last = (np.array(x.spin()) for x in (start, goal if "spin" in aims else start))
    attitude = start.attitude
    columns = []
    for fraction in s - 0.5 / len(s):  # each interval with its mean rate
        step = (first + fraction * (last - first)) * duration / len(s)
        columns.append(_turned(attitude, step, np.ones(1))[:, 0])
        attitude = type(attitude)(*columns[-1])
    return np.array(columns).T, first[:, None] + np.outer(last - first, s)


def _bowed(
    attitude: np.ndarray, w: np.ndarray, sideways: np.ndarray, bow: np.ndarray, rate: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Attitude and w of a turn with a further one at every instant.

    Args:
        attitude: (1, N) headings or (4, N) quaternions of the turn.
        w: (1, N) or (3, N) its angular velocities, rad/s.
        sideways: (1,) or (3,) axis in B times angle of the further turn at its largest, rad.
        bow: (N,) size of the further turn, 0 at both ends.
        rate: (N,) its derivative, 1/s.
    """
    if len(w) == 1:
        return attitude + np.outer(sideways, bow), w + np.outer(sideways, rate)
    before = Quat(*attitude)
    further = Quat(*_turned(Quat(1.0, 0.0, 0.0, 0.0), sideways, bow))
    # Rates add in the axes of the body, which has turned further.
    spin = further.inverse().rotate(Vec3(*w))
    return (
        np.array(leaves(before.times(further))),
        np.array(spin.columns()) + np.outer(sideways, rate),
    )


def _turning(
    start: State, duration: float, s: np.ndarray, number: int
) -> tuple[np.ndarray, np.ndarray]:
    """Attitude and w over shares s (T,) of a turn that is done after a third of the time, to anywhere.

    Guesses of one number are the same in every process, so that multi-start results are repeatable.
    """
    if isinstance(start.attitude, Heading):
        turn = np.array([(-1.0) ** number * math.pi / 4.0 * ((number + 1) // 2)])
    else:
        axis = np.random.default_rng(number).normal(size=3)
        turn = axis / np.linalg.norm(axis) * math.pi / 4.0 * ((number + 1) // 2)
    fraction = np.minimum(3.0 * s, 1.0)
    pace = fraction * fraction * (3.0 - 2.0 * fraction)
    rate = 18.0 * fraction * (1.0 - fraction) / duration
    return _turned(start.attitude, turn, pace), np.outer(turn, rate)


def _turned(attitude: Any, turn: np.ndarray, pace: Field) -> np.ndarray:
    """The attitude after each share of a turn: (1, N) heading or (4, N) quaternion."""
    if isinstance(attitude, Heading):
        return np.array([attitude.angle + turn[0] * pace])
    angle = float(np.linalg.norm(turn))
    axis = turn / angle if angle > 0 else turn
    x, y, z = np.outer(axis, np.sin(0.5 * angle * pace))
    return np.array(leaves(attitude.times(Quat(np.cos(0.5 * angle * pace), x, y, z))))


def needed_wrenches(craft: Spacecraft, path: Any, period: float) -> np.ndarray:
    """Wrenches (T, 3 or 6) on B, N and N m, that move a spacecraft along a path, but for gyroscopic torques.

    The path is a `State` of arrays (T + 1,), a control period (s) apart.

    Only for guesses: transcriptions begin with the commands that give these.
    """
    before = map_leaves(lambda x: x[:-1], path)
    identity = Heading(0.0) if craft.dimension == 2 else Quat(1.0, 0.0, 0.0, 0.0)
    push = (map_leaves(lambda x: x[1:], path.v) - before.v).scale(craft.mass / period)
    force = before.attitude.to(identity).rotate(push)
    torque = inertia(craft) @ np.diff(np.array(path.spin()), axis=1) / period
    return np.vstack([leaves(force), torque]).T


def transfer_time(craft: Spacecraft, aims: Collection[str], start: State, goal: State) -> float:
    """Estimated time that the craft needs to its aims, s.

    Constant acceleration and braking take 2 sqrt(way / acceleration), a change of speed its size over the
    acceleration; the slower of translation and rotation counts, with a fifth to spare for doing both.

    Raises:
        ConfigError: the thrusters cannot push the spacecraft in every direction, or turn it about some axes
            only.
    """
    push, turn_up = _accelerations(craft)
    offset, speed = (np.array(x.columns()) for x in (goal.p - start.p, goal.v - start.v))
    turn = rotation_vector(start.attitude.to(goal.attitude))
    spin = np.array(goal.spin()) - np.array(start.spin())
    translation = _time(aims, ("position", offset), ("velocity", speed), push)
    return 1.2 * max(translation, _time(aims, ("attitude", turn), ("spin", spin), turn_up), 1e-3)


@cache
def _accelerations(craft: Spacecraft) -> tuple[float, float]:
    """Least accelerations along and about the axes of B, m/s^2 and rad/s^2; 0 about them if it cannot turn."""
    force, torque = Allocation(craft).authority()
    return force / craft.mass, torque / float(np.linalg.eigvalsh(np.array(craft.inertia))[-1])


def _time(
    aims: Collection[str],
    offset: tuple[str, np.ndarray],
    rate: tuple[str, np.ndarray],
    acceleration: float,
) -> float:
    """Time (s) to cross an offset (k,) from rest to rest and to cancel a rate (k,), at an acceleration."""
    far, fast = (float(np.linalg.norm(x)) if name in aims else 0.0 for name, x in (offset, rate))
    if far == fast == 0.0:
        return 0.0
    return 2.0 * math.sqrt(far / acceleration) + fast / acceleration
