"""Pulses in space as impulses at any instant, compiled: moved by least squares until they arrive."""

from __future__ import annotations

import math

import numpy as np

from rans.optimal.certificate.compiled import compiled
from rans_space_certificates.kernel import (
    quaternion_product,
    rotated_vector,
    rotation_quaternion,
)

_ITERATIONS = 12
"""Iterations of Gauss and Newton."""
_LONGEST = 3.0
"""Time by which one iteration moves a pulse at most, s."""


@compiled
def pulse_order(instants: np.ndarray, order: np.ndarray) -> None:
    """Indices of pulses from the first to the last, written, by insertion: there are few."""
    for a in range(len(instants)):
        b = a
        while b > 0 and instants[order[b - 1]] > instants[a]:
            order[b] = order[b - 1]
            b -= 1
        order[b] = a


@compiled
def _off(
    instants: np.ndarray,
    thrusters: np.ndarray,
    flight: float,
    wrenches: np.ndarray,
    start: np.ndarray,
    goal: np.ndarray,
    h: float,
    errors: np.ndarray,
    order: np.ndarray,
    parts: np.ndarray,
) -> None:
    """Errors (9,) at the end of impulses: p, v and the rotation from the goal, in W.

    An impulse is a period's push and twist in its middle. The push has the middle's attitude, which is
    the spin before and h / 8 times the twist ahead.

    Parts, (K, 9), written: push, twist and the spin before, in W.
    """
    pulse_order(instants, order)
    q = (start[3], start[4], start[5], start[6])
    w = start[10:13].copy()
    now = 0.0
    for i in range(3):
        errors[i] = start[i] + flight * start[7 + i] - goal[i]
        errors[3 + i] = start[7 + i] - goal[7 + i]
    for j in order:
        d = instants[j] - now
        x = wrenches[thrusters[j]]
        now = instants[j]
        q = quaternion_product(q, rotation_quaternion(d * w[0], d * w[1], d * w[2]))
        a = h * x[3]
        b = h * x[4]
        c = h * x[5]
        ahead = quaternion_product(
            q, rotation_quaternion(0.125 * h * a, 0.125 * h * b, 0.125 * h * c)
        )
        parts[j, 0], parts[j, 1], parts[j, 2] = rotated_vector(ahead, h * x[0], h * x[1], h * x[2])
        parts[j, 3], parts[j, 4], parts[j, 5] = rotated_vector(q, a, b, c)
        parts[j, 6], parts[j, 7], parts[j, 8] = rotated_vector(q, w[0], w[1], w[2])
        for i in range(3):
            errors[i] += (flight - now) * parts[j, i]
            errors[3 + i] += parts[j, i]
        w[0], w[1], w[2] = w[0] + a, w[1] + b, w[2] + c
    d = flight - now
    q = quaternion_product(q, rotation_quaternion(d * w[0], d * w[1], d * w[2]))
    s, x, y, z = quaternion_product(q, (goal[3], -goal[4], -goal[5], -goal[6]))
    size = math.sqrt(x * x + y * y + z * z)
    angle = math.copysign(2.0 * math.atan2(size, abs(s)), s) / max(size, 1e-12)
    errors[6] = angle * x
    errors[7] = angle * y
    errors[8] = angle * z


@compiled
def _slopes(
    instants: np.ndarray, flight: float, order: np.ndarray, parts: np.ndarray, slopes: np.ndarray
) -> None:
    """Slopes (9, K), written, of what impulses end off by, by their instants; parts as `_off` leaves them.

    A pulse that comes dt later leaves all after it turned back by its twist times dt, and is itself turned
    on by the spin before.
    """
    # sum and first moment of the pushes after a pulse
    ex = 0.0
    ey = 0.0
    ez = 0.0
    mx = 0.0
    my = 0.0
    mz = 0.0
    for j in order[::-1]:
        f0 = parts[j, 0]
        f1 = parts[j, 1]
        f2 = parts[j, 2]
        t0 = parts[j, 3]
        t1 = parts[j, 4]
        t2 = parts[j, 5]
        w0 = parts[j, 6]
        w1 = parts[j, 7]
        w2 = parts[j, 8]
        left = flight - instants[j]
        c0 = w1 * f2 - w2 * f1
        c1 = w2 * f0 - w0 * f2
        c2 = w0 * f1 - w1 * f0
        slopes[0, j] = left * c0 - f0 - t1 * mz + t2 * my
        slopes[1, j] = left * c1 - f1 - t2 * mx + t0 * mz
        slopes[2, j] = left * c2 - f2 - t0 * my + t1 * mx
        slopes[3, j] = c0 - t1 * ez + t2 * ey
        slopes[4, j] = c1 - t2 * ex + t0 * ez
        slopes[5, j] = c2 - t0 * ey + t1 * ex
        slopes[6, j] = -t0
        slopes[7, j] = -t1
        slopes[8, j] = -t2
        ex = ex + f0
        ey = ey + f1
        ez = ez + f2
        mx = mx + left * f0
        my = my + left * f1
        mz = mz + left * f2


@compiled
def _beyond(errors: np.ndarray, radii: np.ndarray) -> float:
    """Sum of the squares of what is outside the balls, in radii."""
    value = 0.0
    for g in range(3):
        size = math.sqrt(errors[3 * g] ** 2 + errors[3 * g + 1] ** 2 + errors[3 * g + 2] ** 2)
        value += max(0.0, size / radii[g] - 1.0) ** 2
    return value


@compiled
def _projected(errors: np.ndarray, radii: np.ndarray, slopes: np.ndarray) -> None:
    """Errors beyond the balls, in radii, and their slopes, both written in place.

    Of d it is (1 - r / |d|) d, whose slope is that share of d's and r / |d| times the part along d.
    """
    for g in range(0, 9, 3):
        r = radii[g // 3]
        size = math.sqrt(errors[g] ** 2 + errors[g + 1] ** 2 + errors[g + 2] ** 2)
        shrink = max(0.0, 1.0 - r / max(size, 1e-12))
        n0 = 0.0
        n1 = 0.0
        n2 = 0.0
        if shrink > 0.0:
            n0 = errors[g] / size
            n1 = errors[g + 1] / size
            n2 = errors[g + 2] / size
        for j in range(slopes.shape[1]):
            along = (1.0 - shrink) * (
                n0 * slopes[g, j] + n1 * slopes[g + 1, j] + n2 * slopes[g + 2, j]
            )
            slopes[g, j] = (shrink * slopes[g, j] + along * n0) / r
            slopes[g + 1, j] = (shrink * slopes[g + 1, j] + along * n1) / r
            slopes[g + 2, j] = (shrink * slopes[g + 2, j] + along * n2) / r
        for i in range(g, g + 3):
            errors[i] *= shrink / r


@compiled
def _solved(
    slopes: np.ndarray, errors: np.ndarray, damping: float, a: np.ndarray, y: np.ndarray
) -> None:
    """Write (J J' + damping)^-1 off to y, by Cholesky, in a."""
    n = len(errors)
    for i in range(n):
        for j in range(i + 1):
            x = damping if i == j else 0.0
            for k in range(slopes.shape[1]):
                x += slopes[i, k] * slopes[j, k]
            for k in range(j):
                x -= a[i, k] * a[j, k]
            a[i, j] = math.sqrt(max(x, 1e-12)) if i == j else x / a[j, j]
    for i in range(n):
        y[i] = errors[i]
        for k in range(i):
            y[i] -= a[i, k] * y[k]
        y[i] /= a[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            y[i] -= a[k, i] * y[k]
        y[i] /= a[i, i]


@compiled
def refined(
    instants: np.ndarray,
    thrusters: np.ndarray,
    flight: float,
    wrenches: np.ndarray,
    start: np.ndarray,
    goal: np.ndarray,
    h: float,
    radii: np.ndarray,
) -> float:
    """Move impulses' instants (K,) until they end within the balls, by Levenberg and Marquardt.

    Returns the root of the sum of squares of what is left outside, in radii of position, velocity and angle.
    """
    count = len(instants)
    errors = np.empty(9)
    slopes = np.empty((9, count))
    parts = np.empty((count, 9))
    order = np.empty(count, np.int64)
    a = np.empty((9, 9))
    y = np.empty(9)
    trial = np.empty(count)
    _off(instants, thrusters, flight, wrenches, start, goal, h, errors, order, parts)
    value = _beyond(errors, radii)
    damping = 1.0
    fresh = False
    for _ in range(_ITERATIONS):
        if value < 1e-4 or damping > 1e5:
            break
        if not fresh:
            _slopes(instants, flight, order, parts, slopes)
            _projected(errors, radii, slopes)
        _solved(slopes, errors, damping, a, y)
        for j in range(count):
            move = 0.0
            for i in range(9):
                move -= slopes[i, j] * y[i]
            trial[j] = min(
                flight - 0.5 * h, max(0.5 * h, instants[j] + min(_LONGEST, max(-_LONGEST, move)))
            )
        before = errors.copy()
        _off(trial, thrusters, flight, wrenches, start, goal, h, errors, order, parts)
        new = _beyond(errors, radii)
        fresh = new >= value
        if fresh:  # as it was, more carefully
            errors[:] = before
            damping = 8.0 * damping
        else:
            instants[:], value, damping = trial, new, max(1e-3, 0.2 * damping)
    return math.sqrt(value)
