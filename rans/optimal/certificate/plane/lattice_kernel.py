"""Dynamic programming over the lattice, compiled: the only loops that cost time.

All take windows ``low`` and ``high``, whole numbers (N + 1, spins): of spin n at period k only the
indices low[k, n] <= a < high[k, n] are looked at. A value is infinite where no pattern leads on.
"""

from __future__ import annotations

import numpy as np

from rans.optimal.certificate.compiled import compiled

Tables = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, int, int, int]
"""Cosine and sine of the heading indices' angles (headings,); per pattern thrust (P,) and complex force
(P,), N; the first pattern of each net torque (torques + 1,); the smallest net torque; and the index of
n = 0 and of a = 0."""


@compiled
def price_row(
    price: float,
    turn: complex,
    tables: Tables,
    first: int,
    last: int,
    allowed: np.ndarray,
    begin: int,
    end: int,
    row: np.ndarray,
) -> None:
    """Write the cheapest pattern of one net torque for all headings of one spin into ``row``."""
    cosine, sine, thrust, force = tables[:4]
    for a in range(begin, end):
        row[a] = np.inf
    for p in range(first, last):
        if not allowed[p]:
            continue
        c = turn * force[p]
        real = c.real
        imaginary = c.imag
        fuel = price * thrust[p]
        for a in range(begin, end):
            cost = fuel + (real * cosine[a] - imaginary * sine[a])
            row[a] = cost if cost < row[a] else row[a]


@compiled
def sweep(
    fuel: float,
    turns: np.ndarray,
    tables: Tables,
    low: np.ndarray,
    high: np.ndarray,
    allowed: np.ndarray,
    value: np.ndarray,
    ahead: bool,
) -> None:
    """Least cost from every point to the end, or from the start to every point (Bellman's recursion).

    The fuel is the price of a newton of thrust over one period; the turns, complex (N, spins, torques), are
    what the costate makes of a force on B at heading index 0; allowed are the patterns that may be used,
    (N, P). The value, (N + 1, spins, headings), is filled from its end, or ahead from its start, given there.
    """
    steps = turns.shape[0]
    spins = turns.shape[1]
    firsts, least, reach = tables[4:7]
    row = np.empty(value.shape[2])
    for step in range(steps):
        k = step if ahead else steps - 1 - step
        filled = k + 1 if ahead else k
        for i in range(spins):
            for a in range(low[filled, i], high[filled, i]):
                value[filled, i, a] = np.inf
        for i in range(spins):
            n = i - reach
            for t in range(turns.shape[2]):
                j = i + least + t
                if j < 0 or j >= spins:
                    continue
                begin = max(low[k, i], low[k + 1, j] - n)
                end = min(high[k, i], high[k + 1, j] - n)
                if begin >= end:
                    continue
                price_row(
                    fuel,
                    turns[k, i, t],
                    tables,
                    firsts[t],
                    firsts[t + 1],
                    allowed[k],
                    begin,
                    end,
                    row,
                )
                for a in range(begin, end):
                    if ahead:
                        value[k + 1, j, a + n] = min(
                            value[k + 1, j, a + n], row[a] + value[k, i, a]
                        )
                    else:
                        value[k, i, a] = min(value[k, i, a], row[a] + value[k + 1, j, a + n])


@compiled
def trace(
    fuel: float,
    turns: np.ndarray,
    tables: Tables,
    low: np.ndarray,
    high: np.ndarray,
    allowed: np.ndarray,
    value: np.ndarray,
) -> np.ndarray:
    """The cheapest patterns from n = a = 0 on, by the values of `sweep`: (N,) indices."""
    steps = turns.shape[0]
    spins = turns.shape[1]
    cosine, sine, thrust, force, firsts, least, reach, origin = tables
    chosen = np.zeros(steps, dtype=np.int64)
    i = reach
    a = origin
    # In each period the pattern with the least cost now and afterwards, among those within the limits.
    for k in range(steps):
        best = np.inf
        n = i - reach
        best_j = i
        for t in range(turns.shape[2]):
            j = i + least + t
            if j < 0 or j >= spins or a + n < low[k + 1, j] or a + n >= high[k + 1, j]:
                continue
            for p in range(firsts[t], firsts[t + 1]):
                if not allowed[k, p]:
                    continue
                c = turns[k, i, t] * force[p]
                cost = fuel * thrust[p] + (c.real * cosine[a] - c.imag * sine[a])
                cost += value[k + 1, j, a + n]
                if cost < best:
                    best = cost
                    best_j = j
                    chosen[k] = p
        i = best_j
        a = a + n
    return chosen


@compiled
def shrink(
    before: np.ndarray, after: np.ndarray, limit: float, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Windows that hold every point through which a path costs at most the limit."""
    steps, spins = low.shape
    new_low = np.zeros_like(low)
    new_high = np.zeros_like(high)
    for k in range(steps):
        for i in range(spins):
            begin = low[k, i]
            end = high[k, i]
            while begin < end and not before[k, i, begin] + after[k, i, begin] <= limit:
                begin += 1
            while end > begin and not before[k, i, end - 1] + after[k, i, end - 1] <= limit:
                end -= 1
            new_low[k, i] = begin
            new_high[k, i] = end
    return new_low, new_high
