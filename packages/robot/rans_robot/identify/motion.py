"""Predicted motion of a spacecraft whose forces, mass properties and delays are to be identified.

Between the instants of a fine grid the thrust is constant in B. Forces follow commands after a latency and a linear
rise, which is the command convolved with a box: an own formulation beside `rans.randomization.valves`, for whole
windows of a log at once. `tests/identify/test_motion.py` compares it with the engine, whose equations it does not
use.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from rans.extend import Body, ConfigError, Quat, Spacecraft, Vec3, Wrench
from rans.model.dynamics import thrust
from rans_robot.identify.log import FlightLog

STEP = 0.02
"""s: longest step of the grid, in which thrust is constant. A valve that opens within one errs by a h^2 / 8:
2e-4 rad under 4 rad/s^2, far below the noise of readings."""


_FEW_WINDOWS = 4
"""Up to so many windows in space are predicted one after the other, in floats: a step of floats takes a quarter of
the time of one of arrays, however few their entries are."""


class Physics(NamedTuple):
    """Parameters of the motion for K windows, as fields (K,)."""

    body: Body
    """Mass properties, and a factor on the force of each thruster."""
    disturbance: Wrench
    """Constant force and torque in W, N and N m."""
    latency: np.ndarray
    """(K,), s from a command until the force begins to change."""
    rise: np.ndarray
    """(K,), s of the linear change of the force."""


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
    def of(cls, craft: Spacecraft, log: FlightLog) -> Thrust:
        """Shares of full force by a log's commands, with pulses and the supply's limit, as if nothing were late.

        The integrals are exact for steps of thrust, so that they can be shifted by any delay without a grid.
        """
        times = []
        shares = []
        periods = np.diff(log.command_times, append=log.command_times[-1] + log.period)
        periods = np.minimum(periods, log.period * 1.5)  # a pulse is a share of the control period
        for time, command, period in zip(log.command_times, log.commands, periods, strict=True):
            gone = 0.0
            for part, levels in craft.actuators.pulses(tuple(map(float, command))):
                if part <= 0.0:
                    continue
                times.append(time + gone)
                shares.append([float(x) for x in thrust(craft, tuple(levels))])
                gone += float(part) * min(period, log.period)
        t = np.array(times)
        u = np.array(shares)
        steps = np.diff(t)[:, None]
        first = np.zeros_like(u)
        second = np.zeros_like(u)
        first[1:] = np.cumsum(u[:-1] * steps, axis=0)
        second[1:] = np.cumsum(first[:-1] * steps + 0.5 * u[:-1] * steps**2, axis=0)
        return cls(t, first, second, u)

    def _integrals(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First and second integral of the shares at times t of any shape (s): (..., n) each, s and s^2.

        From the log's first command on; before it both are 0.
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

        A share that rises linearly is the mean of the commanded one over the rise time before. Delays are (K,), s.
        """
        late = t - latency[:, None]
        first, second = self._integrals(late)
        _, before = self._integrals(late - rise[:, None])
        ramp = np.maximum(rise, 1e-6)[:, None, None]
        return np.where(rise[:, None, None] > 1e-6, (second - before) / ramp, first)


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
    begin: np.ndarray,
    times: np.ndarray,
    longest: float = STEP,
) -> np.ndarray:
    """States at the readings of K windows of M readings each: columns (K, M, 6 or 13).

    They are x, y, heading, vx, vy, spin, or p, quaternion, v, w.

    Args:
        craft: spacecraft as designed.
        thrusts: forces that were commanded.
        physics: parameters.
        start: (K, 6 or 13), states at the beginnings of the windows.
        begin: (K,), s, the beginnings.
        times: (K, M), s, times of the readings, ascending.
        longest: s, longest step of the grid.
    """
    # Readings lie on the grid: between its instants velocities have kinks where thrusters open.
    gaps = np.diff(np.concatenate([begin[:, None], times], axis=1), axis=1)
    counts = np.maximum(1, np.ceil(np.max(gaps, axis=0) / longest - 1e-9).astype(int))
    step = np.repeat(np.maximum(gaps, 1e-12) / counts, counts, axis=1)
    grid = begin[:, None] + np.concatenate(
        [np.zeros((len(begin), 1)), np.cumsum(step, axis=1)], axis=1
    )
    delivered = thrusts.delivered(grid, physics.latency, physics.rise)
    gain = np.stack([np.broadcast_to(g, len(times)) for g in physics.body.gain], axis=-1)
    fractions = np.diff(delivered, axis=1) / step[..., None] * gain[:, None]
    wrenches = fractions @ craft.wrenches
    move = _planar if craft.dimension == 2 else _spatial
    return move(craft, physics, start, wrenches, step)[:, np.cumsum(counts)]


def _planar(
    craft: Spacecraft,
    physics: Physics,
    start: np.ndarray,
    wrench: np.ndarray,
    step: np.ndarray,
) -> np.ndarray:
    """States (K, S + 1, 6) in the plane, as cumulative sums with the heading at the middle of each step.

    They are some hundred times as fast as the engine's steps, one after the other; the error of a step is of third
    order in its turn, 1e-6 of the thrust at 1 rad/s.
    """
    force = wrench[..., :2]
    x, y = (np.asarray(c)[:, None] for c in physics.body.centre)
    push = physics.disturbance
    torque = wrench[..., 2] - (x * force[..., 1] - y * force[..., 0])
    torque = torque + np.asarray(push.torque)[:, None]
    rate = torque / np.asarray(physics.body.inertia[0])[:, None]
    # Spin, heading, then velocity and position, each a sum of the one before.
    h = step
    spin = _summed(start[:, 5], rate * h)
    heading = _summed(start[:, 2], spin[:, :-1] * h + 0.5 * rate * h**2)
    middle = heading[:, :-1] + 0.5 * h * spin[:, :-1] + 0.125 * h**2 * rate
    cos = np.cos(middle)
    sin = np.sin(middle)
    pushed = (
        cos * force[..., 0] - sin * force[..., 1] + np.asarray(push.force.x)[:, None],
        sin * force[..., 0] + cos * force[..., 1] + np.asarray(push.force.y)[:, None],
    )
    columns = []
    for j, component in enumerate(pushed):
        acceleration = component / craft.mass
        velocity = _summed(start[:, 3 + j], acceleration * h)
        position = _summed(start[:, j], velocity[:, :-1] * h + 0.5 * acceleration * h**2)
        columns.append((position, velocity))
    (x, vx), (y, vy) = columns
    return np.stack([x, y, heading, vx, vy, spin], axis=-1)


def _summed(start: np.ndarray, changes: np.ndarray) -> np.ndarray:
    """Values (K, S + 1) that begin at (K,) and change by (K, S)."""
    return start[:, None] + np.concatenate(
        [np.zeros((len(start), 1)), np.cumsum(changes, axis=1)], axis=1
    )


def _spatial(
    craft: Spacecraft,
    physics: Physics,
    start: np.ndarray,
    wrench: np.ndarray,
    step: np.ndarray,
) -> np.ndarray:
    """States (K, S + 1, 13) by the midpoint rule, of starts (K, 13) and wrenches (K, S, 6) in B."""
    body = physics.body
    force = wrench[..., :3]
    torque = wrench[..., 3:] - np.cross(_stacked(body.centre)[:, None], force)
    xx, xy, xz, yy, yz, zz = (np.asarray(x) for x in body.inertia)
    inertia = np.stack(
        [_stacked(row) for row in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))], axis=1
    )
    push = _stacked(physics.disturbance.force.columns()) / craft.mass
    twist = _stacked(physics.disturbance.torque.columns())
    constant = start, inertia, np.linalg.inv(inertia), push, twist
    acting = step, force / craft.mass, torque
    parts = [slice(None)]
    if len(start) <= _FEW_WINDOWS:
        parts = [slice(k, k + 1) for k in range(len(start))]
    return np.concatenate(
        [_midpoints([x[part] for x in constant], [x[part] for x in acting]) for part in parts]
    )


def _midpoints(constant: Sequence[np.ndarray], acting: Sequence[np.ndarray]) -> np.ndarray:
    """States (K, S + 1, 13) of the midpoint rule.

    The fit takes finite differences of results: no choice by the value of a parameter, which would make steps.

    Args:
        constant: start (K, 13), inertia and its inverse (K, 3, 3), acceleration (K, 3) and torque (K, 3) in W.
        acting: length of each step (K, S), s, and what acts in it (K, S, 3): thrust per mass and torque in B.
    """
    columns, inertia, inverse, *loads = (_fields(x) for x in constant)
    p, q, v, w = Vec3(*columns[:3]), Quat(*columns[3:7]), Vec3(*columns[7:10]), Vec3(*columns[10:])
    push, twist = (Vec3(*x) for x in loads)

    def rate(w: Vec3, q: Quat, torque: Vec3) -> Vec3:
        """Angular acceleration in B, rad/s^2: Euler's equations."""
        total = torque + q.inverse().rotate(twist) - w.cross(_product(inertia, w))
        return _product(inverse, total)

    # Euler's equations at the beginning and in the middle of each step.
    path = [columns]
    for h, *loads in zip(*(_fields(x) for x in acting), strict=True):
        force, torque = (Vec3(*x) for x in loads)
        halfway = w + rate(w, q, torque).scale(0.5 * h)
        middle = _after(q, (w + halfway).scale(0.25 * h))
        acceleration = middle.rotate(force) + push
        p = p + (v + acceleration.scale(0.5 * h)).scale(h)
        v = v + acceleration.scale(h)
        w = w + rate(halfway, middle, torque).scale(h)
        q = _after(q, halfway.scale(h))
        path.append([*p.columns(), q.w, q.x, q.y, q.z, *v.columns(), *w.columns()])
    return np.moveaxis(np.array(path).reshape(len(path), 13, -1), -1, 0)


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


def _fields(table: np.ndarray) -> list[Any]:
    """Entries of a table (K, ...) as lists of arrays (K,), or of floats where K is 1."""
    if len(table) == 1:
        return table[0].tolist()
    return list(np.ascontiguousarray(np.moveaxis(table, 0, -1)))


def _stacked(fields: Iterable[Any]) -> np.ndarray:
    """Fields (K,) as columns (K, n)."""
    return np.stack([np.asarray(x) for x in fields], axis=-1)
