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
from rans.optimal.certificate.space.impulses_kernel import in_order, refined
from rans.optimal.certificate.space.kernel import miss, step

_NEAR = 0.5
"""Radii off, in the root of the sum of squares, from which on rounding is tried."""
_ROUNDINGS = 3000
"""Changes of a rounding."""


@compiled
def ended(
    when: np.ndarray,
    who: np.ndarray,
    steps: int,
    wrenches: np.ndarray,
    start: np.ndarray,
    h: float,
    rule: np.ndarray,
    order: np.ndarray,
    path: np.ndarray,
) -> np.ndarray:
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
    in_order(when, order)
    path[0] = start
    now = 0
    a = 0
    here = 0
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
        here = 1 - here
        now = until + 1


@compiled
def _twice(when: np.ndarray, who: np.ndarray) -> bool:
    """Whether a thruster would have to open twice in a period."""
    for a in range(len(when)):
        for b in range(a):
            if when[a] == when[b] and who[a] == who[b]:
                return True
    return False


@compiled
def rounded(
    instants: np.ndarray,
    who: np.ndarray,
    steps: int,
    wrenches: np.ndarray,
    start: np.ndarray,
    goal: np.ndarray,
    radii: np.ndarray,
    quantum: float,
    h: float,
    rule: np.ndarray,
    random: np.random.Generator,
    best_when: np.ndarray,
) -> float:
    """Whole periods near impulses' instants, written, that end as near to the goal set as is found.

    Annealing from 0.5 to 0.05 radii moves one to three pulses by a period. Returns the miss of `miss`.
    """
    count = len(who)
    order = np.empty(count, np.int64)
    path = np.empty((2, 13))
    when = np.empty(count, np.int64)
    for j in range(count):
        when[j] = min(steps - 1, max(0, round(instants[j] / h - 0.5)))
    new = when.copy()
    value = 1e9
    best = 1e9
    for attempt in range(_ROUNDINGS):
        if not _twice(new, who):
            state = ended(new, who, steps, wrenches, start, h, rule, order, path)
            changed = miss(state, goal, radii, quantum)
            heat = 0.5 * 0.1 ** (attempt / _ROUNDINGS)
            if changed <= value or random.random() < math.exp((value - changed) / heat):
                value = changed
                when[:] = new
                if value < best:
                    best = value
                    best_when[:] = when
                    if best <= 0.0:
                        break
        new[:] = when
        for _ in range(1 + int(3.0 * random.random())):
            j = int(count * random.random())
            new[j] = min(steps - 1, max(0, new[j] + (1 if random.random() < 0.5 else -1)))
    return best


@compiled
def _changed(
    when: np.ndarray,
    who: np.ndarray,
    products: np.ndarray,
    flight: float,
    random: np.random.Generator,
) -> bool:
    """Another flight of as many pulses and, nearly always, with the same spin at the end; whether it is one.

    A thruster gives way to one of the same torque, two change places, a pair of opposite torques gives way
    to another, or a pulse moves; seldom a thruster gives way to any.
    """
    count = len(who)
    thrusters = len(products)
    kind = random.random()
    a = int(count * random.random())
    b = int(count * random.random())
    i = int(thrusters * random.random())
    j = int(thrusters * random.random())
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
        who[a] = i
        who[b] = j
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
def fewest_pulses(
    now: np.ndarray,
    now_who: np.ndarray,
    steps: int,
    wrenches: np.ndarray,
    products: np.ndarray,
    start: np.ndarray,
    goal: np.ndarray,
    radii: np.ndarray,
    inner: np.ndarray,
    quantum: float,
    h: float,
    rule: np.ndarray,
    tries: int,
    random: np.random.Generator,
    when: np.ndarray,
    who: np.ndarray,
) -> float:
    """Look for pulses that end in the goal set, from some; written are periods (K,) and thrusters (K,).

    Annealing from 0.8 to 0.08 radii over what least squares leave; see the module. A quantum of spin that
    is left counts as 5. Returns the miss, 0 within the set.

    Args:
        now: (K,) instants of the first pulses, s, written over.
        now_who: (K,) their thrusters, written over.
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
    flight = steps * h
    best = 1e9
    value = 1e9
    spin = np.empty(3)
    new = now.copy()
    new_who = now_who.copy()
    periods = np.empty(len(now), np.int64)
    for attempt in range(tries):
        if attempt > 0:
            new[:] = now
            new_who[:] = now_who
            if not _changed(new, new_who, products, flight, random):
                continue
        for c in range(3):
            spin[c] = start[10 + c] - goal[10 + c]
            for j in new_who:
                spin[c] += h * wrenches[j, 3 + c]
        left = math.sqrt(spin[0] ** 2 + spin[1] ** 2 + spin[2] ** 2)
        changed = refined(new, new_who, flight, wrenches, start, goal, h, inner)
        changed += 5.0 * left / quantum if left > radii[3] else 0.0
        heat = 0.8 * 0.1 ** (attempt / tries)
        if changed <= value or random.random() < math.exp((value - changed) / heat):
            value = changed
            now[:] = new
            now_who[:] = new_who
            if value < _NEAR:
                off = rounded(
                    now,
                    now_who,
                    steps,
                    wrenches,
                    start,
                    goal,
                    radii,
                    quantum,
                    h,
                    rule,
                    random,
                    periods,
                )
                if off < best:
                    best = off
                    when[:] = periods
                    who[:] = now_who
                    if best <= 0.0:
                        break
    return best
