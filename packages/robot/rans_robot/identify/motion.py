"""Predicted motion of a spacecraft whose forces, mass properties and delays are to be identified.

Between the instants of a fine grid the thrust is constant in B. Forces follow commands after a latency and a linear
rise, which is the command convolved with a box: an own formulation beside `rans.randomization.valves`, for whole
windows of a log at once. `tests/identify/test_motion.py` compares it with the engine, whose equations it does not
use.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rans.extend import ConfigError, Quat, Spacecraft, Vec3, Wrench, leaves
from rans.model.dynamics import thrust
from rans_robot.identify.log import SIZES, FlightLog

STEP = 0.02
"""s: longest step of the grid, in which thrust is constant. A valve that opens within one errs by a h^2 / 8:
2e-4 rad under 4 rad/s^2, far below the noise of readings but in quiet logs, where it is an error of the rise."""
_BRISK = 1e-4
"""s: a rise below it counts as a delay of half of it, since a mean over no time is rounding."""
_AFTER = 10.0
"""Control periods after the last command of a log, at which its last reading is past: that is within two periods
of when the command was recorded, which may be some periods after it was given."""


@dataclass(frozen=True)
class Physics:
    """Parameters of the motion for K windows."""

    gain: np.ndarray
    """(K, n), factors on the force of each thruster."""
    inertia: np.ndarray
    """(K, 1), kg m^2; in space (K, 6): xx, xy, xz, yy, yz and zz."""
    centre: np.ndarray
    """(K, d), m: centre of mass from the designed one."""
    disturbance: Wrench
    """Constant force of fields (K,), N, and torque (K, 1 or 3), N m, in W."""
    latency: np.ndarray
    """(K, 1), s from a command until the force begins to change."""
    rise: np.ndarray
    """(K, 1), s of the linear change of the force."""


@dataclass(frozen=True)
class Thrust:
    """Forces that thrusters of designed strength would give at once: steps in time, and their integrals."""

    times: np.ndarray
    """(E,), s: instants of change."""
    first: np.ndarray
    """(E, n): integral of the shares of full force up to each instant, s."""
    second: np.ndarray
    """(E, n): integral of that, s^2."""
    shares: np.ndarray
    """(E, n): shares of full force from each instant on."""

    @classmethod
    def of(cls, craft: Spacecraft, logs: Sequence[FlightLog]) -> Thrust:
        """Shares of full force by the commands of logs in the order of time, with pulses and the supply's limit.

        The integrals are exact for steps of thrust, so that they can be shifted by any delay without a grid. Those
        of a log begin at 0, and no thruster pushes between two logs.
        """
        tables = []
        for log in logs:
            times = []
            shares = []
            periods = np.diff(log.command_times, append=log.command_times[-1] + log.period)
            periods = np.minimum(periods, log.period)  # a pulse is a share of the control period
            for time, command, period in zip(log.command_times, log.commands, periods, strict=True):
                gone = 0.0
                for part, levels in craft.actuators.pulses(tuple(map(float, command))):
                    if part <= 0.0:
                        continue
                    times.append(time + gone)
                    shares.append([float(x) for x in thrust(craft, tuple(levels))])
                    gone += float(part) * period
            t = np.array(times)
            u = np.array(shares)
            steps = np.diff(t)[:, None]
            first = np.zeros_like(u)
            second = np.zeros_like(u)
            first[1:] = np.cumsum(u[:-1] * steps, axis=0)
            second[1:] = np.cumsum(first[:-1] * steps + 0.5 * u[:-1] * steps**2, axis=0)
            none = np.zeros_like(u[:1])
            tables += [(t, first, second, u), ([t[-1] + _AFTER * log.period], none, none, none)]
        return cls(*(np.concatenate(parts) for parts in zip(*tables, strict=True)))

    def _integrals(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First and second integral of the shares at times t of any shape (s): (..., n) each, s and s^2.

        From the first command on; before it both are 0.
        """
        index = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, None)
        since = np.maximum(t - self.times[index], 0.0)[..., None]  # nothing acts before the log
        first = self.first[index] + self.shares[index] * since
        second = (
            self.second[index] + self.first[index] * since + 0.5 * self.shares[index] * since**2
        )
        return first, second

    def delivered(self, t: np.ndarray, latency: np.ndarray, rise: np.ndarray) -> np.ndarray:
        """Integral of the delayed shares up to times t (K, S), s: (K, S, n), s.

        A share that rises linearly is the mean of the commanded one over the rise time before. Delays (K, 1).
        """
        is_brisk = rise < _BRISK
        first, second = self._integrals(t - latency - np.where(is_brisk, 0.5 * rise, 0.0))
        _, before = self._integrals(t - latency - rise)
        ramp = np.maximum(rise, _BRISK)[..., None]
        return np.where(is_brisk[..., None], first, (second - before) / ramp)


def check_identifiable(craft: Spacecraft) -> None:
    """Refuse craft whose motion this module does not predict.

    Raises:
        ConfigError: the craft has no thruster, reaction wheels, burns propellant, has a mass that moves in it, or
            effectors of other kinds.
    """
    reasons = {
        "has no thruster": not craft.thrusters,
        "has reaction wheels": bool(craft.wheels),
        "burns propellant": craft.propellant is not None,
        "has a mass that moves in it": not craft.is_rigid,
        "has effectors of other kinds": bool(craft.further_effectors),
    }
    for reason, holds in reasons.items():
        if holds:
            raise ConfigError(
                f"{craft.name!r} {reason}, and only rigid spacecraft of constant mass that thrusters alone move "
                "can be identified from a log."
            )


def windows_of(log: FlightLog, length: float) -> list[slice]:
    """Slices of the readings into windows of about a length (s), each of which begins with a pose.

    A window ends before a gap longer than itself: readings after it, up to the next pose, are in none.
    """
    has_pose = ~np.isnan(log.position).any(axis=1)
    has_pose &= ~np.isnan(log.attitude.reshape(len(log.times), -1)).any(axis=1)
    edges = np.arange(log.times[0], log.times[-1], length)
    if len(edges) > 1 and log.times[-1] - edges[-1] < 0.5 * length:
        edges = edges[:-1]
    starts = []
    for edge in edges:
        after = np.flatnonzero((log.times >= edge - 1e-9) & has_pose)
        if len(after) and (not starts or after[0] > starts[-1]):
            starts.append(int(after[0]))
    gaps = np.flatnonzero(np.diff(log.times) > length) + 1
    ends = []
    for begin, end in zip(starts, [*starts[1:], len(log.times)], strict=True):
        after = gaps[(gaps > begin) & (gaps < end)]
        ends.append(int(after[0]) if len(after) else end)
    return [slice(begin, end) for begin, end in zip(starts, ends, strict=True)]


def predicted(
    craft: Spacecraft,
    thrusts: Thrust,
    physics: Physics,
    start: np.ndarray,
    times: np.ndarray,
    longest: float = STEP,
) -> np.ndarray:
    """States at the readings of K windows of M readings each: columns (K, M, 6 or 13).

    They are x, y, heading, vx, vy, spin, or p, quaternion, v, w.

    Args:
        craft: spacecraft as designed.
        thrusts: forces that were commanded.
        physics: parameters.
        start: (K, 6 or 13), states at the first readings of the windows.
        times: (K, M), s, times of the readings, ascending.
        longest: s, longest step of the grid.
    """
    # Readings lie on the grid: between its instants velocities have kinks where thrusters open.
    gaps = np.diff(times, axis=1)
    counts = np.maximum(1, np.ceil(np.max(gaps, axis=0) / longest - 1e-9).astype(int))
    step = np.repeat(np.maximum(gaps, 1e-12) / counts, counts, axis=1)
    grid = _summed(times[:, :1], step[..., None])[..., 0]
    delivered = thrusts.delivered(grid, physics.latency, physics.rise)
    step = step[..., None]
    wrench = np.diff(delivered, axis=1) / step * physics.gain[:, None] @ craft.wrenches
    # The motion about the centre of mass, and the force in W in the middle of each step.
    d = craft.dimension
    position, attitude, velocity, spin = np.split(start, np.cumsum(SIZES[d][:-1]), axis=1)
    turned = _turned if d == 2 else _turned_in_space
    attitudes, spins, pushed = turned(
        physics, attitude, spin, wrench[..., :d], wrench[..., d:], step
    )
    push = np.stack(physics.disturbance.force.columns(), axis=-1)
    acceleration = (pushed + push[:, None]) / craft.mass
    velocities = _summed(velocity, acceleration * step)
    positions = _summed(position, velocities[:, :-1] * step + 0.5 * acceleration * step**2)
    states = np.concatenate([positions, attitudes, velocities, spins], axis=-1)
    return states[:, np.append(0, np.cumsum(counts))]


def _summed(start: np.ndarray, changes: np.ndarray) -> np.ndarray:
    """Values (K, S + 1, c) that begin at (K, c) and change by (K, S, c)."""
    return np.cumsum(np.concatenate([start[:, None], changes], axis=1), axis=1)


def _turned(
    physics: Physics,
    attitude: np.ndarray,
    spin: np.ndarray,
    force: np.ndarray,
    torque: np.ndarray,
    step: np.ndarray,
) -> tuple[np.ndarray, ...]:
    """Headings (K, S + 1, 1), spins (K, S + 1, 1) and forces in W (K, S, 2), as cumulative sums.

    They are some hundred times as fast as the engine's steps, one after the other. The force has the heading in the
    middle of each step: the error is of third order in its turn, 1e-6 of the thrust at 1 rad/s.
    """
    x, y = physics.centre.T[..., None, None]
    fx, fy = force[..., :1], force[..., 1:]
    rate = torque - (x * fy - y * fx) + physics.disturbance.torque[:, None]
    rate = rate / physics.inertia[:, None]
    spins = _summed(spin, rate * step)
    headings = _summed(attitude, spins[:, :-1] * step + 0.5 * rate * step**2)
    middle = headings[:, :-1] + 0.5 * step * spins[:, :-1] + 0.125 * step**2 * rate
    cos = np.cos(middle)
    sin = np.sin(middle)
    return headings, spins, np.concatenate([cos * fx - sin * fy, sin * fx + cos * fy], axis=-1)


def _turned_in_space(
    physics: Physics,
    attitude: np.ndarray,
    spin: np.ndarray,
    force: np.ndarray,
    torque: np.ndarray,
    step: np.ndarray,
) -> tuple[np.ndarray, ...]:
    """Attitudes (K, S + 1, 4), spins (K, S + 1, 3) and forces in W (K, S, 3), by the midpoint rule.

    The fit takes finite differences of results: no choice by the value of a parameter, which would make steps.
    """
    inertia = physics.inertia[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
    inverse = _fields(np.linalg.inv(inertia))
    inertia = _fields(inertia)
    twist = Vec3(*_fields(physics.disturbance.torque))
    torque = torque - np.cross(physics.centre[:, None], force)

    def rate(w: Vec3, q: Quat, torque: Vec3) -> Vec3:
        """Angular acceleration in B, rad/s^2: Euler's equations."""
        total = torque + q.inverse().rotate(twist) - w.cross(_product(inertia, w))
        return _product(inverse, total)

    # Euler's equations at the beginning and in the middle of each step.
    q = Quat(*_fields(attitude))
    w = Vec3(*_fields(spin))
    path = [(*leaves(q), *leaves(w), *leaves(q))]
    for h, load in zip(_fields(step[..., 0]), _fields(torque), strict=True):
        halfway = w + rate(w, q, Vec3(*load)).scale(0.5 * h)
        middle = _after(q, (w + halfway).scale(0.25 * h))
        w = w + rate(halfway, middle, Vec3(*load)).scale(h)
        q = _after(q, halfway.scale(h))
        path.append((*leaves(q), *leaves(w), *leaves(middle)))
    states = np.moveaxis(np.array(path).reshape(len(path), 11, -1), -1, 0)
    pushed = Quat(*states[:, 1:, 7:].T).rotate(Vec3(*force.T))
    return states[..., :4], states[..., 4:7], np.array(pushed.columns()).T


def _fields(table: np.ndarray) -> list[Any]:
    """Entries of a table (K, ...) as lists of arrays (K,), or of floats where K is 1."""
    if len(table) == 1:
        return table[0].tolist()
    return list(np.ascontiguousarray(np.moveaxis(table, 0, -1)))


def _product(matrix: Sequence[Sequence[Any]], vector: Vec3) -> Vec3:
    """Product of a matrix of fields, three rows of three, and a vector."""
    return Vec3(*(a * vector.x + b * vector.y + c * vector.z for a, b, c in matrix))


def _after(q: Quat, turn: Vec3) -> Quat:
    """Unit quaternion after a rotation vector in B, rad, by a series whose error is 1e-6 rad for 1 rad."""
    squared = turn.dot(turn)
    cosine = 1.0 - squared * (0.125 - squared / 384.0)
    factor = 0.5 - squared * (1.0 / 48.0 - squared / 3840.0)
    scale = (cosine * cosine + factor * factor * squared) ** -0.5
    return q.times(Quat(cosine * scale, *turn.scale(factor * scale).columns()))
