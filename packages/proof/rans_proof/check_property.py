"""Margins of properties over sets of states in ball arithmetic."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Sequence
from typing import Any

from flint import arb, arb_mat

from rans_proof.balls import absolute_row_sums, column, sizes
from rans_proof.check_motion import linear

_SIDES = 48
"""Sides of the polygon around a circle of speeds."""


class Property:
    """A property of the state, of which a margin is not more than the state may move before it is broken.

    Args:
        keep: table of one kind and its limits.
        count: number of states.
    """

    def __init__(self, keep: dict[str, Any], count: int) -> None:
        ((self._kind, self._limit),) = keep.items()
        self._is_every = self._kind in ("within", "every")
        # Functions that are not to be negative, as rows of factors and constants: within a box those of its faces,
        # outside of it the negated ones.
        self._rows: list[tuple[Any, Any]] = []
        if self._kind in ("within", "avoid"):
            sign = 1 if self._is_every else -1
            for axis in range(count):
                row = arb_mat(1, count, [arb(int(i == axis)) for i in range(count)])
                low, high = (arb(self._limit[end][axis]) for end in ("lower", "upper"))
                self._rows += [(sign * row, -sign * low), (-sign * row, sign * high)]
        if self._kind in ("every", "some"):
            for text in self._limit:
                *factors, constant = linear(text, [f"x{i}" for i in range(count)])
                self._rows.append((arb_mat(1, count, factors), constant))

    def margin(self, begin: Any, end: Any, sag: Sequence[Any]) -> float:
        """Margin over a piece of a flight, which is off the chord between its ends by at most ``sag``.

        It is of linear functions of the state, so that over the chord each is least at an end.
        """
        if not self._rows:
            return self._distance(begin, end, sag)
        margins = []
        for row, constant in self._rows:
            off = (sizes(row) * column(sag))[0, 0]
            lowest = [constant - _highest(-row, state) - off for state in (begin, end)]
            margins.append(least_of(x.lower() for x in lowest))
        return least_of(margins) if self._is_every else max(margins)

    def _distance(self, begin: Any, end: Any, sag: Sequence[Any]) -> float:
        """Margin of a ball to keep out of or to stay in, or of a limit of the speed, |v| < base + slope |p|.

        Along any unit vector d a position is no longer than it is, |p| >= d p: here along the middle of the chord.
        A velocity in the plane is at most 1 / cos(pi / K) times its longest component along K directions.
        """
        limit = self._limit
        position = self._limit["position"]
        if self._kind == "stay_in":  # the farthest corner of the boxes around both ends
            hulls = [hull(state) for state in (begin, end)]
            corners = [[abs(hull[i]).upper() + sag[i] for i in position] for hull in hulls]
            return least_of((arb(limit["radius"]) - _norm(corner)).lower() for corner in corners)
        is_speed = self._kind == "speed_limit"
        ahead = [arb((begin[0][i, 0] + end[0][i, 0]).mid()) for i in position]
        slope = arb(limit["slope"]) if is_speed else arb(1)
        # The rows times a state are what counts against the margin; the sag adds to them.
        row = [arb(0)] * len(sag)
        for i, value in zip(position, ahead, strict=True):
            row[i] -= slope * value / _norm(ahead)
        off = slope * _norm(sag[i] for i in position)
        rows = [row]
        base = arb(limit["base"] if is_speed else -limit["radius"])
        if is_speed:
            off += _norm(sag[i] for i in limit["velocity"])
            turns = [arb(2 * side) / _SIDES for side in range(_SIDES)]
            rows = [list(row) for _ in turns]
            for row_of_turn, turn in zip(rows, turns, strict=True):
                direction = turn.cos_pi(), turn.sin_pi()
                for i, value in zip(limit["velocity"], direction, strict=True):
                    row_of_turn[i] += value / (arb(1) / _SIDES).cos_pi()
        factors = [arb_mat(1, len(sag), values) for values in rows]
        return least_of(
            (base - _highest(x, state) - off).lower() for x in factors for state in (begin, end)
        )

    def value(self, state: tuple[Any, Any]) -> Any:
        """Ball around the property's value over a set, which is below 0 where it is broken.

        A set is a pair of its middle and its generators, see `hull`. A certificate holds where the ball is above 0,
        so that the ball must have the value of every state of the set.
        """
        x = hull(state)
        values = [(row * column(x))[0, 0] + constant for row, constant in self._rows]
        if values:
            return functools.reduce(arb.min if self._is_every else arb.max, values)
        limit = self._limit
        distance = _norm(x[i] for i in self._limit["position"])
        if self._kind == "speed_limit":
            speed = _norm(x[i] for i in limit["velocity"])
            return arb(limit["base"]) + arb(limit["slope"]) * distance - speed
        away = distance - arb(limit["radius"])
        return away if self._kind == "keep_out" else -away


def hull(state: tuple[Any, Any]) -> list[Any]:
    """Balls around each coordinate of a set."""
    widths = absolute_row_sums(state[1])
    return [x + arb(0, w.upper()) for x, w in zip(state[0].entries(), widths, strict=True)]


def _norm(vector: Iterable[Any]) -> Any:
    return sum((x * x for x in vector), arb(0)).nonnegative_part().sqrt()


def least_of(values: Iterable[Any]) -> float:
    """Least number; what is none, such as infinity less infinity, is below all."""
    return min(x if x == x else -math.inf for x in map(float, values))


def _highest(row: Any, state: tuple[Any, Any]) -> Any:
    """Largest value of a row of factors (1, n) times a state (centre, spread)."""
    return (row * state[0])[0, 0] + absolute_row_sums(row * state[1])[0]
