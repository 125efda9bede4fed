"""Where the optimiser starts: a smooth motion from the start to where the task wants the spacecraft.

Arrays are (columns, T), and s (T,) is the elapsed share of the duration; a guess decides which optimum is found.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from functools import cache
from typing import Any

import numpy as np

from rans.control.allocation import Allocation
from rans.extend import (
    Heading,
    Quat,
    Spacecraft,
    State,
    inertia,
    leaves,
    map_leaves,
    rotation_vector,
)

_STEP = 1e-4
"""Share of the duration over which rates are differences: they are wrong by 1e-8 of the largest."""
_BOW = 0.3
"""Sideways, of the way to go: standard deviation over the further guesses."""
_OFF_AXIS = 0.6
"""Sideways, rad: standard deviation about every axis over the further guesses."""


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
    path = _path(aims, start, goal, duration, number)
    p, attitude = path(s)
    # Rates are central differences, as exact as a guess can use.
    (before, first), (after, last) = (path(s + step) for step in (-_STEP, _STEP))
    kind: Any = type(start.attitude)
    turned = rotation_vector(kind(*first).to(kind(*last)))
    time = 2.0 * _STEP * duration
    return np.vstack([p, attitude, (after - before) / time, turned / time])


def _path(
    aims: Collection[str], start: State, goal: State, duration: float, number: int
) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Position (2 or 3, T) and attitude (1 or 4, T) over the elapsed share of the duration, s, (T,).

    Positions are cubic in time (Hermite), or of constant acceleration without a goal position. Turns to an attitude
    are about one axis at the pace 3 s^2 - 2 s^3; the rates of start and goal are not matched. Other turns have
    constant angular acceleration. Guesses of one number are the same in every process.
    """
    p0, p1, v0, v1 = (np.array(x.columns())[:, None] for x in (start.p, goal.p, start.v, goal.v))
    if "velocity" not in aims:
        v1 = v0
    if "position" not in aims:
        p1 = p0 + 0.5 * duration * (v0 + v1)
    offset, first, last = p1 - p0, duration * v0, duration * v1
    random = np.random.default_rng(number)
    sideways = np.zeros((len(p0), 1))
    if number >= 2:
        sideways = random.normal(size=sideways.shape) * _BOW * np.linalg.norm(offset)

    spins = [np.array(x.spin()) for x in (start, goal if "spin" in aims else start)]
    turns_freely = number > 0 and not {"attitude", "spin"} & set(aims)
    turn = np.zeros(len(spins[0]))
    if turns_freely:
        axis = np.array([(-1.0) ** number])
        if len(turn) == 3:
            axis = np.random.default_rng(number).normal(size=3)
        turn = axis / np.linalg.norm(axis) * math.pi / 4.0 * ((number + 1) // 2)
    elif "attitude" in aims:
        turn = rotation_vector(start.attitude.to(goal.attitude))
        if number % 2 == 1:
            angle = float(np.linalg.norm(turn))
            turn = (turn / angle if angle > 0 else np.eye(len(turn))[-1]) * (angle - math.tau)
    aside = np.zeros(len(turn))
    if number > 0 and not turns_freely:
        aside = random.normal(size=len(turn)) * _OFF_AXIS

    def path(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        square = 3.0 * offset - 2.0 * first - last
        cube = first + last - 2.0 * offset
        # A bow vanishes at both ends, and so does its rate.
        bow = 16.0 * (s * (1 - s)) ** 2
        p = p0 + s * (first + s * (square + s * cube)) + sideways * bow
        # A free turn is done after a third of the time.
        share = np.clip(3.0 * s, 0.0, 1.0) if turns_freely else s
        vectors = np.outer(turn, share * share * (3.0 - 2.0 * share))
        if not turns_freely and "attitude" not in aims:
            rates = np.outer(spins[0], s) + np.outer(spins[1] - spins[0], 0.5 * s * s)
            vectors = rates * duration
        return p, _turned(start.attitude, vectors, np.outer(aside, bow))

    return path


def _turned(attitude: Any, *turns: np.ndarray) -> np.ndarray:
    """Heading (1, N) or quaternion (4, N) after turns by vectors (1 or 3, N), rad, in the axes of an attitude."""
    if isinstance(attitude, Heading):
        return np.array([attitude.angle + sum(turn[0] for turn in turns)])
    for turn in turns:
        angle = np.linalg.norm(turn, axis=0)
        x, y, z = turn * 0.5 * np.sinc(angle / math.tau)
        attitude = attitude.times(Quat(np.cos(0.5 * angle), x, y, z))
    return np.array(leaves(attitude))


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
def allocation_of(craft: Spacecraft) -> Allocation:
    """The allocation of a craft, see there."""
    return Allocation(craft)


@cache
def _accelerations(craft: Spacecraft) -> tuple[float, float]:
    """Least accelerations along and about the axes of B, m/s^2 and rad/s^2; 0 about them if it cannot turn."""
    force, torque = allocation_of(craft).authority()
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
