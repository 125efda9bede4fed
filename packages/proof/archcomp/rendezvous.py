"""Refute ARCH-COMP's unsafe rendezvous (category AFF, SRU01 and SRU02) by a flight in ball arithmetic.

`python packages/proof/archcomp/rendezvous.py` needs no file. An approach is aborted 260 min after its start, and
the chaser then drifts into the square of 0.4 m around the target. Each mode is linear, x' = A x, so that its
flight is the exponential of A. The instant of the switch at x = -100 m is a ball that holds it. SRU02 may be
aborted at any time up to 260 min, so that the same flight refutes it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from flint import arb, arb_mat, ctx
from scipy.linalg import expm

from rans.terminal import Terminal

APPROACH = (
    ("-0.057599765881773", "0.000200959896519766", "-2.89995083970656", "0.00877200894463775"),
    ("-0.000174031357370456", "-0.0665123984901026", "-0.00875351105536225", "-2.90300269286856"),
)
"""Rows of vx' and vy' by x, y (m), vx, vy (m/min), as published; x' = vx and y' = vy in every mode."""
ATTEMPT = (
    ("-0.575999943070835", "0.000262486079431672", "-19.2299795908647", "0.00876275931760007"),
    ("-0.000262486080737868", "-0.575999940191886", "-0.00876276068239993", "-19.2299765959399"),
)
PASSIVE = (("0.0000575894721132", "0", "0", "0.00876276"), ("0", "0", "-0.00876276", "0"))
ABORT, HORIZON = 260, 300
"""min."""
EDGE = -100
"""x at which the attempt begins, m."""
HALF = "0.2"
"""Half a side of the square that a chaser must never be in, m."""


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


def main() -> None:
    """Print the flight."""
    ctx.prec = 128
    flight = refute()
    verdict = "refuted" if flight.is_inside else "open"
    x, y = (float(p.mid()) for p in flight.position)
    Terminal().say(
        f"SRU01 and SRU02: {verdict}. From x = {flight.start[0]:g}, y = {flight.start[1]:g} m the attempt begins "
        f"at {float(flight.switch.mid()):.3f} min, and {flight.coast:.1f} min after the abort the chaser is at "
        f"({x:.4f}, {y:.4f}) m, within {float(max(p.rad() for p in flight.position)):.1g} m."
    )


if __name__ == "__main__":
    main()
