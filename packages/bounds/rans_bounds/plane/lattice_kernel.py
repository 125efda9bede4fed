"""Dynamic programming over the lattice of spins and headings, compiled: the only loops that cost time.

A point is a control period k, a spin index n and a heading index a. A pattern of open thrusters with the net torque
t leads from (k, n, a) to (k + 1, n + t, a + n). Tables have a row i for the spin n = i - `Tables.spin_origin` and a
column for the heading. Only the columns low[k, i] <= a < high[k, i] are searched. A value is infinite where no
pattern leads on.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rans_bounds.compiled import compiled


class Tables(NamedTuple):
    """Constants of a lattice: P patterns in ascending order of their T net torques."""

    cosine: np.ndarray
    """(headings,) cosine of the angle of each heading index."""
    sine: np.ndarray
    """(headings,) its sine."""
    thrust: np.ndarray
    """(P,) sum of the thrusts of each pattern, N."""
    force: np.ndarray
    """(P,) force of each pattern on B as a complex number x + i y, N."""
    first_pattern: np.ndarray
    """(T + 1,) number of the first pattern of each net torque, and P."""
    least_torque: int
    """The smallest net torque, in steps of the spin."""
    spin_origin: int
    """Row of n = 0."""
    heading_origin: int
    """Column of a = 0."""


class Costs(NamedTuple):
    """Costs of the patterns under a costate, and where paths may lead, over N periods and S spins."""

    fuel: float
    """Price of a newton of thrust over one period."""
    turns: np.ndarray
    """(N, S, T) complex: the price of a force on B is the real part of its product with the force and exp(i heading
    angle)."""
    tables: Tables
    low: np.ndarray
    """(N + 1, S) first columns."""
    high: np.ndarray
    """(N + 1, S) columns after the last ones."""
    allowed: np.ndarray
    """(N, P) whether a pattern may be used in a period."""


@compiled
def cheapest_of_torque(
    costs: Costs, k: int, i: int, t: int, begin: int, end: int, row: np.ndarray
) -> None:
    """Write the least cost of a pattern of net torque ``t`` at headings begin to end into ``row``; inf: none."""
    tables = costs.tables
    for a in range(begin, end):
        row[a] = np.inf
    for p in range(tables.first_pattern[t], tables.first_pattern[t + 1]):
        if not costs.allowed[k, p]:
            continue
        turned = costs.turns[k, i, t] * tables.force[p]
        real = turned.real
        imaginary = turned.imag
        fuel = costs.fuel * tables.thrust[p]
        for a in range(begin, end):
            cost = fuel + (real * tables.cosine[a] - imaginary * tables.sine[a])
            row[a] = cost if cost < row[a] else row[a]


@compiled
def bellman(costs: Costs, value: np.ndarray, ahead: bool) -> None:
    """Least cost from every point to the end, or from the start to every point (Bellman's recursion).

    The value, (N + 1, S, headings), is filled from its end, or ahead from its start, which has its values already.

    `cheapest_patterns` and `shrink` look up its values at the same indices, and take infinity for "no path".
    """
    tables = costs.tables
    low = costs.low
    high = costs.high
    steps, spins, torques = costs.turns.shape
    row = np.empty(value.shape[2])
    for step in range(steps):
        k = step if ahead else steps - 1 - step
        # No path is known yet to the points that this period fills.
        filled = k + 1 if ahead else k
        for i in range(spins):
            for a in range(low[filled, i], high[filled, i]):
                value[filled, i, a] = np.inf
        for i in range(spins):
            n = i - tables.spin_origin
            for t in range(torques):
                # From row i to row j, for headings that both windows hold.
                j = i + tables.least_torque + t
                if j < 0 or j >= spins:
                    continue
                begin = max(low[k, i], low[k + 1, j] - n)
                end = min(high[k, i], high[k + 1, j] - n)
                if begin >= end:
                    continue
                cheapest_of_torque(costs, k, i, t, begin, end, row)
                if ahead:
                    for a in range(begin, end):
                        cost = row[a] + value[k, i, a]
                        value[k + 1, j, a + n] = min(value[k + 1, j, a + n], cost)
                else:
                    for a in range(begin, end):
                        cost = row[a] + value[k + 1, j, a + n]
                        value[k, i, a] = min(value[k, i, a], cost)


@compiled
def cheapest_patterns(costs: Costs, value: np.ndarray) -> np.ndarray:
    """Numbers (N,) of the cheapest patterns from n = a = 0 on, by the values to the end of `bellman`.

    The path costs what the values say: the ascent takes a supergradient of the bound from it.
    """
    tables = costs.tables
    low = costs.low
    high = costs.high
    steps, spins, torques = costs.turns.shape
    chosen = np.zeros(steps, dtype=np.int64)
    i = tables.spin_origin
    a = tables.heading_origin
    for k in range(steps):
        # The heading after this period is the same for every pattern.
        n = i - tables.spin_origin
        after = a + n
        best = np.inf
        best_row = i
        for t in range(torques):
            j = i + tables.least_torque + t
            if j < 0 or j >= spins or after < low[k + 1, j] or after >= high[k + 1, j]:
                continue
            for p in range(tables.first_pattern[t], tables.first_pattern[t + 1]):
                if not costs.allowed[k, p]:
                    continue
                turned = costs.turns[k, i, t] * tables.force[p]
                real = turned.real * tables.cosine[a] - turned.imag * tables.sine[a]
                cost = costs.fuel * tables.thrust[p] + real
                cost += value[k + 1, j, after]
                if cost < best:
                    best = cost
                    best_row = j
                    chosen[k] = p
        i = best_row
        a = after
    return chosen


@compiled
def shrink(
    before: np.ndarray, after: np.ndarray, limit: float, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Windows that hold every point through which a path costs at most the limit.

    Args:
        before: least cost from the start to every point.
        after: least cost from every point to the end.
        limit: largest cost of a path.
        low: (N + 1, S) first columns of the windows.
        high: (N + 1, S) columns after the last ones.
    """
    steps, spins = low.shape
    new_low = np.zeros_like(low)
    new_high = np.zeros_like(high)
    for k in range(steps):
        for i in range(spins):
            begin = low[k, i]
            end = high[k, i]
            # A sum that is not a number is no path: "not <=" drops it.
            while begin < end and not before[k, i, begin] + after[k, i, begin] <= limit:
                begin += 1
            while end > begin and not before[k, i, end - 1] + after[k, i, end - 1] <= limit:
                end -= 1
            new_low[k, i] = begin
            new_high[k, i] = end
    return new_low, new_high
