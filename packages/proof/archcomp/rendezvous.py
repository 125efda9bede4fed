"""Decide ARCH-COMP's rendezvous (category AFF): nine are proved and checked, two are refuted by a flight.

`python packages/proof/archcomp/rendezvous.py` needs no file; names of problems after it choose some. What is flown
and kept is in `rendezvous.toml`. `rans_proof.hybrid` searches for a certificate, `rans_proof.check_hybrid` judges
it in ball arithmetic, and 100,000 random flights are compared with it. Certificates are written below
`archcomp-results`.

SRU01 aborts 260 min after the start, and the chaser then drifts into the square of 0.4 m around the target, by
a flight in ball arithmetic. Each mode is linear, x' = A x, so that its flight is the exponential of A. The
instant of the switch at x = -100 m is a ball that holds it. SRU02 may be aborted at any time up to 260 min, so
that the same flight refutes it.
"""

from __future__ import annotations

import functools
import json
import math
import sys
import time
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from flint import arb, arb_mat, ctx
from rans_proof.check_hybrid import check
from rans_proof.hybrid import search
from scipy.linalg import expm

from rans.extend import Terminal

PROBLEM = tomllib.loads((Path(__file__).parent / "rendezvous.toml").read_text())
APPROACH, ATTEMPT = (tuple(map(tuple, mode["rates"][2:])) for mode in PROBLEM["mode"])
"""Rows of vx' and vy' by x, y (m), vx, vy (m/min); x' = vx and y' = vy in every mode."""
PASSIVE = tuple(map(tuple, PROBLEM["passive"]["rates"][2:]))
ABORT, HORIZON = 260, 300
"""min."""
EDGE = -100
"""x at which the attempt begins, m."""
HALF = PROBLEM["passive"]["half"]
"""Half a side of the square that a chaser must never be in, m."""
SAFE: dict[str, tuple[str, ...]] = {
    "SRNA01": (),
    "SRA01": ("120", "120"),
    "SRA02": ("120", "125"),
    "SRA03": ("120", "145"),
    "SRA04": ("240", "240"),
    "SRA05": ("235", "240"),
    "SRA06": ("230", "240"),
    "SRA07": ("50", "150"),
    "SRA08": ("0", "240"),
}
"""First and last time of the abort, min; (): never."""
CELLS = (2, 1, 1, 1)
"""Cells of the starts along each state."""
FLIGHTS = 100_000


class Flight(NamedTuple):
    """A flight into the square."""

    start: tuple[float, float]
    """x and y at the start, m."""
    switch: Any
    """Ball around the time of the switch to the attempt, min."""
    coast: float
    """Time from the abort to the instant at which it is in the square, min."""
    position: tuple[Any, Any]
    """Balls around the position then, m."""

    @property
    def is_inside(self) -> bool:
        """Whether the chaser is in the square for sure."""
        return all(bool(abs(p) < arb(HALF)) for p in self.position)


def matrix(rows: tuple[tuple[str, ...], ...]) -> Any:
    """Matrix of a mode's rates."""
    top = [[arb(0), arb(0), arb(1), arb(0)], [arb(0), arb(0), arb(0), arb(1)]]
    return arb_mat(top + [[arb(x) for x in row] for row in rows])


def numbers(rows: tuple[tuple[str, ...], ...]) -> np.ndarray:
    """Matrix of a mode's rates in double precision, (4, 4)."""
    return np.array(
        [[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], *([float(x) for x in row] for row in rows)]
    )


def switch_time(first: Any) -> Any:
    """Ball that holds the first time at which an approach from rest is at the edge.

    Time is cut into steps. Through each the chaser is far from the edge, or vx is above 0, so that the edge is
    passed once, in the step at whose end x is beyond it.

    Raises:
        ArithmeticError: that is not sure.
    """
    mode = matrix(APPROACH)
    step = arb(1) / 8
    through, after = (mode * step.union(0)).exp(), (mode * step).exp()
    state, time = first, arb(0)
    while True:
        during, end = through * state, after * state
        rises = bool(during[2, 0] > 0)
        if rises and end[0, 0] > EDGE:
            break
        if not ((rises or during[0, 0] < EDGE) and end[0, 0] < EDGE and time < HORIZON):
            raise ArithmeticError("it is not sure when the chaser passes the edge.")
        state = end
        time += step
    low, high = arb(0), step
    for _ in range(80):
        middle = arb(((low + high) / 2).mid())
        x = ((mode * middle).exp() * state)[0, 0]
        if x < EDGE:
            low = middle
        elif x > EDGE:
            high = middle
        else:
            break
    return time + low.union(high)


def fly(start: tuple[float, float], coast: float) -> Flight:
    """The flight from a start at rest, at a time after its abort, in balls."""
    first = arb_mat([[arb(start[0])], [arb(start[1])], [arb(0)], [arb(0)]])
    switch = switch_time(first)
    state = (matrix(APPROACH) * switch).exp() * first
    # In the attempt's octagon, whose slanted sides end at |y| = 41.1 m at the edge, at the switch and every minute.
    if not abs(state[1, 0]) < arb("41.1"):
        raise ArithmeticError("the chaser is not in the octagon of the attempt.")
    minute = matrix(ATTEMPT).exp()
    state = (matrix(ATTEMPT) * (math.ceil(float(switch.upper())) - switch)).exp() * state
    for _ in range(math.ceil(float(switch.upper())), ABORT):
        if not (state[0, 0] > EDGE and abs(state[1, 0]) < arb("41.1") and state[0, 0] < 0):
            raise ArithmeticError("the chaser leaves the octagon of the attempt.")
        state = minute * state
    state = (matrix(PASSIVE) * arb(coast)).exp() * state
    return Flight(start, switch, coast, (state[0, 0], state[1, 0]))


def nearest(start: tuple[float, float]) -> tuple[float, float]:
    """Least largest coordinate after the abort of a flight in double precision, and the time after the abort."""
    approach, attempt, passive = (numbers(rows) for rows in (APPROACH, ATTEMPT, PASSIVE))
    state = np.array([*start, 0.0, 0.0])
    step = expm(0.01 * approach)
    time = 0.0
    while state[0] < EDGE:
        state = step @ state
        time += 0.01
    state = expm((ABORT - time) * attempt) @ state
    step = expm(0.1 * passive)
    states = [state]
    for _ in range(10 * (HORIZON - ABORT)):
        states.append(step @ states[-1])
    far = np.abs(np.array(states)[:, :2]).max(axis=1)
    return float(far.min()), 0.1 * int(far.argmin())


def refute() -> Flight:
    """The flight of the corner or middle of the starts that comes nearest, in balls."""
    starts = [(x, y) for x in (-925.0, -900.0, -875.0) for y in (-425.0, -400.0, -375.0)]
    best = min(starts, key=lambda start: nearest(start)[0])
    return fly(best, nearest(best)[1])


def certificate(name: str) -> bytes:
    """Certificate of a safe problem."""
    problem = PROBLEM | ({"abort": list(SAFE[name])} if SAFE[name] else {})
    table = {"format": 1, "problem": problem, "cells": CELLS, "proofs": search(problem, CELLS)}
    return json.dumps(table).encode()


def broken(name: str, count: int, seed: int = 0) -> int:
    """Number of random flights of a safe problem that break a function of the attempt, or are in the square.

    Flights are exact at 100 random instants of the attempt and 100 of the passive flight, half of the starts at
    the ends of each state's range.
    """
    random = np.random.default_rng(seed)
    low, high = (np.array(PROBLEM["start"][end], float) for end in ("lower", "upper"))
    part = random.random((count, 4))
    part = np.where(random.random((count, 1)) < 0.5, part.round(), part)
    start = low + (high - low) * part
    # The instant of the switch: the last whole minute before it, and from there Newton's steps.
    x = np.stack([start @ m[0] for m in _powers(APPROACH)[::16]])
    begun = (x > EDGE).argmax(axis=0) - 1.0
    states = _moved(APPROACH, start, begun)
    switch = begun.copy()
    for _ in range(6):
        at = _moved(APPROACH, states, switch - begun)
        switch -= (at[:, 0] - EDGE) / at[:, 2]
    at_edge = _moved(APPROACH, states, switch - begun)
    abort = [float(t) for t in SAFE[name]] or [HORIZON, HORIZON]
    ends = abort[0] + (abort[1] - abort[0]) * random.random(count)
    rows = np.array(PROBLEM["mode"][1]["keep"], float)
    bad = np.zeros(count, bool)
    for _ in range(100):
        elapsed = np.maximum(ends - switch, 0.0) * random.random(count) ** 2
        kept = _moved(ATTEMPT, at_edge, elapsed) @ rows[:, :-1].T + rows[:, -1]
        bad |= (kept.min(axis=1) < -1e-6) & (ends > switch)
    aborted = np.where(
        (ends > switch)[:, None],
        _moved(ATTEMPT, at_edge, np.maximum(ends - switch, 0.0)),
        _moved(APPROACH, start, np.minimum(ends, switch)),
    )
    for _ in range(100 if SAFE[name] else 0):
        at = _moved(PASSIVE, aborted, (HORIZON - ends) * random.random(count))
        bad |= np.abs(at[:, :2]).max(axis=1) <= float(HALF)
    return int(bad.sum())


def _moved(rates: Any, states: np.ndarray, times: np.ndarray) -> np.ndarray:
    """States (N, 4) after a time (N,) each: by whole sixteenths of a minute, and a series for the rest."""
    steps = np.floor(16.0 * times).astype(int)
    states = np.einsum("nij,nj->ni", _powers(rates)[steps], states)
    rest = (times - steps / 16.0)[:, None]
    term = states
    for k in range(1, 16):
        term = term @ numbers(rates).T * rest / k
        states = states + term
    return states


@functools.cache
def _powers(rates: Any) -> np.ndarray:
    """Motion of each whole number of sixteenths of a minute up to the horizon, (N, 4, 4)."""
    step = expm(numbers(rates) / 16.0)
    powers = [np.eye(4)]
    for _ in range(16 * HORIZON):
        powers.append(step @ powers[-1])
    return np.stack(powers)


def main(chosen: list[str]) -> None:
    """Decide the problems, and print each verdict with its processor times."""
    output = Path("archcomp-results")
    output.mkdir(exist_ok=True)
    for name in chosen or [*SAFE, "SRU01"]:
        begun = time.process_time()
        if name not in SAFE:
            ctx.prec = 128
            flight = refute()
            verdict = "refuted" if flight.is_inside else "open"
            x, y = (float(p.mid()) for p in flight.position)
            Terminal().say(
                f"SRU01 and SRU02: {verdict}. From x = {flight.start[0]:g}, y = {flight.start[1]:g} m the attempt "
                f"begins at {float(flight.switch.mid()):.3f} min, and {flight.coast:.1f} min after the abort the "
                f"chaser is at ({x:.4f}, {y:.4f}) m, within {float(max(p.rad() for p in flight.position)):.1g} m."
            )
            continue
        content = certificate(name)
        found = time.process_time()
        (output / f"{name}.json").write_bytes(content)
        least = check(content)
        checked = time.process_time()
        count = broken(name, FLIGHTS)
        Terminal().say(
            f"{name}: proved; {least:.3g} m beyond the square, search {found - begun:.1f} s, check "
            f"{checked - found:.1f} s; {count} of {FLIGHTS:,} flights contradict it."
        )


if __name__ == "__main__":
    main(sys.argv[1:])
