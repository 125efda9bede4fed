"""The search for few pulses in space, compiled: which nozzles by annealing, when by least squares.

A few pulses in a long flight are hard to find one change at a time: moving one by a period turns all that
comes after it. So pulses are taken for impulses at any instant first. What a flight with given nozzles is
off by is then a smooth function of the instants, and Gauss and Newton bring it to zero in some
microseconds wherever that can be done. Annealing changes nozzles only. What comes near is rounded to whole
periods.
"""

from __future__ import annotations

import math

import numpy as np

from rans.optimal.certificate.compiled import compiled
from rans.optimal.certificate.spatial_kernel import exponential, miss, product, rotated, step

_ITERATIONS = 12
"""Of Gauss and Newton after a change."""
_LONGEST = 3.0
"""By which one of them moves a pulse at most, s."""
_NEAR = 0.5
"""Radii off, in the root of the sum of squares, from which on rounding is tried."""
_ROUNDINGS = 3000
"""Changes of a rounding."""


@compiled
def _order(when: np.ndarray, order: np.ndarray) -> None:
    """Indices of pulses from the first to the last, written, by insertion: there are few."""
    for a in range(len(when)):
        b = a
        while b > 0 and when[order[b - 1]] > when[a]:
            order[b] = order[b - 1]
            b -= 1
        order[b] = a


@compiled
def ended(when: np.ndarray, who: np.ndarray, steps: int, wrenches: np.ndarray, start: np.ndarray, h: float,
          rule: np.ndarray, order: np.ndarray, path: np.ndarray) -> np.ndarray:
    """The state (13,) in which pulses end, by the equations of `spatial_kernel.fly`.

    Args:
        when: (K,) periods.
        who: (K,) thrusters.
        steps: control periods.
        wrenches: (thrusters, 6) acceleration and angular acceleration on B.
        start: (13,).
        h: control period, s.
        rule: (2, nodes) places and weights on (0, 1).
        order: (K,), written.
        path: (2, 13), written.
    """
    _order(when, order)
    path[0] = start
    now, a, here = 0, 0, 0
    total = np.zeros(6)
    while True:
        until = when[order[a]] if a < len(order) else steps
        if until > now:
            total[:] = 0.0
            step(path[here], path[1 - here], total, (until - now) * h, rule)
            here = 1 - here
        if a == len(order):
            return path[here]
        total[:] = 0.0
        while a < len(order) and when[order[a]] == until:
            for c in range(6):
                total[c] += wrenches[who[order[a]], c]
            a += 1
        step(path[here], path[1 - here], total, h, rule)
        here, now = 1 - here, until + 1


@compiled
def _off(when: np.ndarray, who: np.ndarray, flight: float, wrenches: np.ndarray, start: np.ndarray,
         goal: np.ndarray, h: float, off: np.ndarray, order: np.ndarray, parts: np.ndarray) -> None:
    """What impulses end off by (9,): p, v and the turn from the goal, in W.

    An impulse is a period's push and twist in its middle. The push has the middle's attitude, which is
    the spin before and h / 8 times the twist ahead.

    Parts, (K, 9), written: push, twist and the spin before, in W.
    """
    _order(when, order)
    q, w, now = (start[3], start[4], start[5], start[6]), start[10:13].copy(), 0.0
    for i in range(3):
        off[i], off[3 + i] = start[i] + flight * start[7 + i] - goal[i], start[7 + i] - goal[7 + i]
    for j in order:
        d, x, now = when[j] - now, wrenches[who[j]], when[j]
        q = product(q, exponential(d * w[0], d * w[1], d * w[2]))
        a, b, c = h * x[3], h * x[4], h * x[5]
        ahead = product(q, exponential(0.125 * h * a, 0.125 * h * b, 0.125 * h * c))
        parts[j, 0], parts[j, 1], parts[j, 2] = rotated(ahead, h * x[0], h * x[1], h * x[2])
        parts[j, 3], parts[j, 4], parts[j, 5] = rotated(q, a, b, c)
        parts[j, 6], parts[j, 7], parts[j, 8] = rotated(q, w[0], w[1], w[2])
        for i in range(3):
            off[i] += (flight - now) * parts[j, i]
            off[3 + i] += parts[j, i]
        w[0], w[1], w[2] = w[0] + a, w[1] + b, w[2] + c
    d = flight - now
    q = product(q, exponential(d * w[0], d * w[1], d * w[2]))
    s, x, y, z = product(q, (goal[3], -goal[4], -goal[5], -goal[6]))
    size = math.sqrt(x * x + y * y + z * z)
    angle = math.copysign(2.0 * math.atan2(size, abs(s)), s) / max(size, 1e-12)
    off[6], off[7], off[8] = angle * x, angle * y, angle * z


@compiled
def _slopes(when: np.ndarray, flight: float, order: np.ndarray, parts: np.ndarray,
            slopes: np.ndarray) -> None:
    """Slopes (9, K), written, of what impulses end off by, by their instants; parts as `_off` leaves them.

    A pulse that comes dt later leaves all after it turned back by its twist times dt, and is itself turned
    on by the spin before.
    """
    # sum and first moment of the pushes after a pulse
    ex, ey, ez, mx, my, mz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in order[::-1]:
        f0, f1, f2, t0, t1, t2 = parts[j, 0], parts[j, 1], parts[j, 2], parts[j, 3], parts[j, 4], parts[j, 5]
        w0, w1, w2, left = parts[j, 6], parts[j, 7], parts[j, 8], flight - when[j]
        c0, c1, c2 = w1 * f2 - w2 * f1, w2 * f0 - w0 * f2, w0 * f1 - w1 * f0
        slopes[0, j] = left * c0 - f0 - t1 * mz + t2 * my
        slopes[1, j] = left * c1 - f1 - t2 * mx + t0 * mz
        slopes[2, j] = left * c2 - f2 - t0 * my + t1 * mx
        slopes[3, j] = c0 - t1 * ez + t2 * ey
        slopes[4, j] = c1 - t2 * ex + t0 * ez
        slopes[5, j] = c2 - t0 * ey + t1 * ex
        slopes[6, j], slopes[7, j], slopes[8, j] = -t0, -t1, -t2
        ex, ey, ez = ex + f0, ey + f1, ez + f2
        mx, my, mz = mx + left * f0, my + left * f1, mz + left * f2


@compiled
def _beyond(off: np.ndarray, radii: np.ndarray) -> float:
    """Sum of the squares of what is outside the balls, in radii."""
    value = 0.0
    for g in range(3):
        size = math.sqrt(off[3 * g] ** 2 + off[3 * g + 1] ** 2 + off[3 * g + 2] ** 2)
        value += max(0.0, size / radii[g] - 1.0) ** 2
    return value


@compiled
def _projected(off: np.ndarray, radii: np.ndarray, slopes: np.ndarray) -> None:
    """What is outside the balls, in radii, and its slopes: both written over what they were.

    Of d it is (1 - r / |d|) d, whose slope is that share of d's and r / |d| times the part along d.
    """
    for g in range(0, 9, 3):
        r = radii[g // 3]
        size = math.sqrt(off[g] ** 2 + off[g + 1] ** 2 + off[g + 2] ** 2)
        share = max(0.0, 1.0 - r / max(size, 1e-12))
        n0, n1, n2 = 0.0, 0.0, 0.0
        if share > 0.0:
            n0, n1, n2 = off[g] / size, off[g + 1] / size, off[g + 2] / size
        for j in range(slopes.shape[1]):
            along = (1.0 - share) * (n0 * slopes[g, j] + n1 * slopes[g + 1, j] + n2 * slopes[g + 2, j])
            slopes[g, j] = (share * slopes[g, j] + along * n0) / r
            slopes[g + 1, j] = (share * slopes[g + 1, j] + along * n1) / r
            slopes[g + 2, j] = (share * slopes[g + 2, j] + along * n2) / r
        for i in range(g, g + 3):
            off[i] *= share / r


@compiled
def _solved(slopes: np.ndarray, off: np.ndarray, damping: float, a: np.ndarray, y: np.ndarray) -> None:
    """Write (J J' + damping)^-1 off to y, by Cholesky, in a."""
    n = len(off)
    for i in range(n):
        for j in range(i + 1):
            x = damping if i == j else 0.0
            for k in range(slopes.shape[1]):
                x += slopes[i, k] * slopes[j, k]
            for k in range(j):
                x -= a[i, k] * a[j, k]
            a[i, j] = math.sqrt(max(x, 1e-12)) if i == j else x / a[j, j]
    for i in range(n):
        y[i] = off[i]
        for k in range(i):
            y[i] -= a[i, k] * y[k]
        y[i] /= a[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            y[i] -= a[k, i] * y[k]
        y[i] /= a[i, i]


@compiled
def refined(when: np.ndarray, who: np.ndarray, flight: float, wrenches: np.ndarray, start: np.ndarray,
            goal: np.ndarray, h: float, radii: np.ndarray) -> float:
    """Move impulses' instants (K,) until they end within the balls, by Levenberg and Marquardt.

    Returns the root of the sum of squares of what is left outside, in radii of position, velocity and angle.
    """
    count = len(when)
    off, slopes, parts = np.empty(9), np.empty((9, count)), np.empty((count, 9))
    order, a, y, trial = np.empty(count, np.int64), np.empty((9, 9)), np.empty(9), np.empty(count)
    _off(when, who, flight, wrenches, start, goal, h, off, order, parts)
    value, damping, fresh = _beyond(off, radii), 1.0, False
    for _ in range(_ITERATIONS):
        if value < 1e-4 or damping > 1e5:
            break
        if not fresh:
            _slopes(when, flight, order, parts, slopes)
            _projected(off, radii, slopes)
        _solved(slopes, off, damping, a, y)
        for j in range(count):
            move = 0.0
            for i in range(9):
                move -= slopes[i, j] * y[i]
            trial[j] = min(flight - 0.5 * h,
                           max(0.5 * h, when[j] + min(_LONGEST, max(-_LONGEST, move))))
        before = off.copy()
        _off(trial, who, flight, wrenches, start, goal, h, off, order, parts)
        new = _beyond(off, radii)
        fresh = new >= value
        if fresh:  # as it was, more carefully
            off[:], damping = before, 8.0 * damping
        else:
            when[:], value, damping = trial, new, max(1e-3, 0.2 * damping)
    return math.sqrt(value)


@compiled
def _twice(when: np.ndarray, who: np.ndarray) -> bool:
    """Whether a thruster would have to open twice in a period."""
    for a in range(len(when)):
        for b in range(a):
            if when[a] == when[b] and who[a] == who[b]:
                return True
    return False


@compiled
def rounded(instants: np.ndarray, who: np.ndarray, steps: int, wrenches: np.ndarray, start: np.ndarray,
            goal: np.ndarray, radii: np.ndarray, quantum: float, h: float, rule: np.ndarray,
            random: np.random.Generator, best_when: np.ndarray) -> float:
    """Whole periods near impulses' instants, written, that end as near to the goal set as is found.

    Annealing from 0.5 to 0.05 radii moves one to three pulses by a period. Returns the miss of `miss`.
    """
    count = len(who)
    order, path, when = np.empty(count, np.int64), np.empty((2, 13)), np.empty(count, np.int64)
    for j in range(count):
        when[j] = min(steps - 1, max(0, round(instants[j] / h - 0.5)))
    new, value, best = when.copy(), 1e9, 1e9
    for attempt in range(_ROUNDINGS):
        if not _twice(new, who):
            state = ended(new, who, steps, wrenches, start, h, rule, order, path)
            changed, heat = miss(state, goal, radii, quantum), 0.5 * 0.1 ** (attempt / _ROUNDINGS)
            if changed <= value or random.random() < math.exp((value - changed) / heat):
                value, when[:] = changed, new
                if value < best:
                    best, best_when[:] = value, when
                    if best <= 0.0:
                        break
        new[:] = when
        for _ in range(1 + int(3.0 * random.random())):
            j = int(count * random.random())
            new[j] = min(steps - 1, max(0, new[j] + (1 if random.random() < 0.5 else -1)))
    return best


@compiled
def _changed(when: np.ndarray, who: np.ndarray, products: np.ndarray, flight: float,
             random: np.random.Generator) -> bool:
    """Another flight of as many pulses and, nearly always, with the same spin at the end; whether it is one.

    A thruster gives way to one of the same torque, two change places, a pair of opposite torques gives way
    to another, or a pulse moves; seldom a thruster gives way to any.
    """
    count, thrusters, kind = len(who), len(products), random.random()
    a, b = int(count * random.random()), int(count * random.random())
    i, j = int(thrusters * random.random()), int(thrusters * random.random())
    if kind < 0.3:
        if who[a] == i or products[who[a], who[a]] + products[i, i] != 2 * products[who[a], i]:
            return False
        who[a] = i
    elif kind < 0.5:
        if who[a] == who[b]:
            return False
        who[a], who[b] = who[b], who[a]
    elif kind < 0.8:
        if a == b or not _opposite(products, who[a], who[b]) or not _opposite(products, i, j):
            return False
        who[a], who[b] = i, j
        if random.random() < 0.3:
            when[a] = when[b] = flight * random.random()
    elif kind < 0.98:
        when[a] = flight * random.random()
    else:
        who[a] = i
    return True


@compiled
def _opposite(products: np.ndarray, i: int, j: int) -> bool:
    return products[i, i] + products[j, j] == -2 * products[i, j]


@compiled
def few(count: int, steps: int, wrenches: np.ndarray, products: np.ndarray, start: np.ndarray,
        goal: np.ndarray, radii: np.ndarray, inner: np.ndarray, quantum: float, h: float, rule: np.ndarray,
        tries: int, random: np.random.Generator, when: np.ndarray, who: np.ndarray) -> float:
    """Look for so many pulses that end in the goal set; written are periods (K,) and thrusters (K,).

    Annealing from 1.5 to 0.15 radii over what least squares leave; see the module. A quantum of spin that
    is left counts as 5. Returns the miss, 0 within the set.

    Args:
        count: K.
        steps: control periods.
        wrenches: (thrusters, 6) acceleration and angular acceleration on B.
        products: (thrusters, thrusters) inner products of torques, in squared quanta.
        start: (13,), see `spatial_kernel.fly`.
        goal: (13,).
        radii: (4,) of position, velocity, attitude and spin.
        inner: (3,) of the first three, smaller by what rounding moves.
        quantum: of spin, rad/s.
        h: control period, s.
        rule: (2, nodes) places and weights on (0, 1).
        tries: changes.
        random: generator.
        when: written.
        who: written.
    """
    flight, best, value = steps * h, 1e9, 1e9
    now, now_who, spin = np.empty(count), np.empty(count, np.int64), np.empty(3)
    for a in range(count):
        now[a], now_who[a] = flight * random.random(), int(len(products) * random.random())
        for _ in range(64 * (a % 2)):  # opposite to the one before, if that is soon found
            if _opposite(products, now_who[a - 1], now_who[a]):
                break
            now_who[a] = int(len(products) * random.random())
    new, new_who, periods = now.copy(), now_who.copy(), np.empty(count, np.int64)
    for attempt in range(tries):
        if attempt > 0:
            new[:], new_who[:] = now, now_who
            if not _changed(new, new_who, products, flight, random):
                continue
        for c in range(3):
            spin[c] = start[10 + c] - goal[10 + c]
            for j in new_who:
                spin[c] += h * wrenches[j, 3 + c]
        left = math.sqrt(spin[0] ** 2 + spin[1] ** 2 + spin[2] ** 2)
        changed = refined(new, new_who, flight, wrenches, start, goal, h, inner)
        changed += 5.0 * left / quantum if left > radii[3] else 0.0
        heat = 1.5 * 0.1 ** (attempt / tries)
        if changed <= value or random.random() < math.exp((value - changed) / heat):
            value, now[:], now_who[:] = changed, new, new_who
            if value < _NEAR:
                off = rounded(now, now_who, steps, wrenches, start, goal, radii, quantum, h, rule, random,
                              periods)
                if off < best:
                    best, when[:], who[:] = off, periods, now_who
                    if best <= 0.0:
                        break
    return best
