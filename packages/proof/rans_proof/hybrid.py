"""Search for proofs about chains of affine modes, with an abort into a passive mode at any time of an interval.

A flight begins in the first mode, x' = A x. A mode ends when a linear function rises through zero, and the next one
begins. Within an interval of time the flight may be aborted at any instant; from then on it is passive until the
horizon. To be proved: in each mode linear functions are never negative, and a passive flight is never in a square
around the origin.

The search is in double precision and trusts its rounding: what it writes is a certificate, and
`rans_proof.check_hybrid` is what proves. Over a rectangle of times (time in the mode, time since the abort) a
position is off the one that its four corners are joined by (bilinear) by at most the largest second derivatives
times the squared sides / 8; so a linear function of it is least at a corner, less that. A rectangle that this does
not decide is halved.
"""

from __future__ import annotations

import functools
import itertools
from typing import Any

import numpy as np
from scipy.linalg import expm

_SMALLEST = 2.0**-24
"""Part of the whole interval of a time below which rectangles are not halved."""
_STEP = 1.0 / 64
"""Step of time at which the end of a mode is searched for."""
_MORE = 1.25
"""Second derivatives at the corners times this are taken for those in between."""
_TURNS = 64
"""Directions along which a position may be outside of the square."""

Tree = list[Any]
"""[]: a rectangle that is proved as a whole; [axis, tree, tree]: its halves along an axis, 0 or 1."""


class Open(Exception):
    """The search finds no proof; the message says where."""


def search(problem: dict[str, Any], cells: tuple[int, ...]) -> list[dict[str, Any]]:
    """Cells of starts with the times at which their modes end, and the rectangles that prove them.

    Args:
        problem: table as of `rans_proof.check_hybrid.check`.
        cells: number of cells along each state.

    Returns:
        A table of each cell: for every mode `end` (first and last time in the mode at which it may end, if it
        does), `keep` and `abort` (box of times and tree of its halves; None if there is nothing to prove).

    Raises:
        Open: a rectangle is neither proved nor large enough to be halved.
    """
    low, high = (np.array(problem["start"][end], dtype=float) for end in ("lower", "upper"))
    found = []
    for place in itertools.product(*map(range, cells)):
        width = (high - low) / cells
        centre = low + (np.array(place) + 0.5) * width
        found.append({"modes": _Cell(problem).modes(centre, np.diag(0.5 * width))})
    return found


class _Cell:
    """Search for the proof of one cell of starts, in double precision; `rans_proof.check_hybrid` judges it."""

    def __init__(self, problem: dict[str, Any]) -> None:
        self._problem = problem
        self._horizon = float(problem["horizon"])
        self._half = float(problem["passive"]["half"])
        angles = 2.0 * np.pi * np.arange(_TURNS) / _TURNS
        self._directions = np.column_stack((np.cos(angles), np.sin(angles)))
        self._least = self._half * np.abs(self._directions).sum(axis=1)
        self._passive = np.array(problem["passive"]["rates"], dtype=float)
        self._coast = functools.cache(lambda time: expm(time * self._passive))

    def modes(self, centre: np.ndarray, spread: np.ndarray) -> list[dict[str, Any]]:
        """Tables of the modes, from a set of starts centre + spread s, |s| <= 1. Arrays are (n,) and (n, m).

        The checker reads these tables (`Chain.prove`); times are since the begin of the mode, s.
        """
        first = last = 0.0
        abort = [float(x) for x in self._problem.get("abort", [])]
        until = abort[1] if abort else self._horizon
        tables = []
        for mode in self._problem["mode"]:
            a = np.array(mode["rates"], dtype=float)
            flow = functools.cache(lambda time, a=a: expm(time * a))
            states = np.column_stack((centre, spread))
            table: dict[str, Any] = {"end": None, "keep": None, "abort": None}
            longest = until - first
            guard = np.array(mode.get("until", []), dtype=float)
            if len(guard):
                table["end"] = self._end(flow, states, guard)
                longest = min(longest, table["end"][1])
            if mode["keep"] and longest > 0.0:
                rows = np.array(mode["keep"], dtype=float)
                tree = self._kept(a, flow, states, rows, (0.0, longest), longest)
                table["keep"] = {"box": [[0.0, longest]], "tree": tree}
            if abort and longest > 0.0:
                begin = max(0.0, abort[0] - last)
                if begin <= longest:
                    coast = self._horizon - max(abort[0], first + begin)
                    box = (begin, longest), (0.0, coast)
                    tree = self._missed(a, flow, states, box, box, first, abort[0])
                    table["abort"] = {"box": [list(pair) for pair in box], "tree": tree}
            tables.append(table)
            if not len(guard):
                break
            # The next mode's states: those of the middle of the interval, moved along their rate to the guard.
            middle = 0.5 * sum(table["end"])
            states = flow(middle) @ states
            rate = a @ states[:, 0]
            value = guard[:-1] @ states
            value[0] += guard[-1]
            states = states - np.outer(rate, value) / (guard[:-1] @ rate)
            # What is left is of the second order.
            off = 0.5 * np.abs(a @ rate) * (0.5 * (table["end"][1] - table["end"][0])) ** 2
            centre, spread = states[:, 0], np.column_stack((states[:, 1:], np.diag(off)))
            first, last = first + table["end"][0], last + table["end"][1]
            if first >= until:
                break
        return tables

    def _end(self, flow: Any, states: np.ndarray, guard: np.ndarray) -> list[float]:
        """First and last time (s) at which a set (n, 1 + m) may be at a guard, with a step of room.

        `Open` if it never ends.
        """
        step = flow(_STEP)
        first = None
        for k in range(int(self._horizon / _STEP)):
            value = guard[:-1] @ states
            value[0] += guard[-1]
            reach = np.abs(value[1:]).sum()
            if first is None and value[0] + reach >= 0.0:
                first = max(0, k - 1) * _STEP
            if first is not None and value[0] - reach > 0.0:
                return [first, (k + 1) * _STEP]
            states = step @ states
        raise Open("a mode does not end before the horizon.")

    def _kept(
        self, a: Any, flow: Any, states: np.ndarray, rows: np.ndarray, box: Any, whole: float
    ) -> Tree:
        """Tree of parts of the interval ``box`` of the time in a mode, each with a bound by which rows @ x >= 0.

        `Open` if a part is too small; states are (n, 1 + m), and the trees are those that `rans_proof.check_hybrid`
        reads.
        """
        low, high = box
        ends = [flow(time) @ states for time in box]
        least = np.min([self._lowest(rows, x) for x in ends], axis=0)
        bend = np.max([np.abs(rows[:, :-1] @ a @ a @ x).sum(axis=1) for x in ends], axis=0)
        if (least - _MORE * bend * (high - low) ** 2 / 8.0 > 1e-9).all():
            return []
        if high - low < _SMALLEST * whole:
            raise Open(f"a function of the mode may be negative after {low:.4f} min in it.")
        middle = 0.5 * (low + high)
        parts = (low, middle), (middle, high)
        return [0, *(self._kept(a, flow, states, rows, part, whole) for part in parts)]

    @staticmethod
    def _lowest(rows: np.ndarray, states: np.ndarray) -> np.ndarray:
        values = rows[:, :-1] @ states
        return values[:, 0] + rows[:, -1] - np.abs(values[:, 1:]).sum(axis=1)

    def _missed(
        self,
        a: Any,
        flow: Any,
        states: np.ndarray,
        box: Any,
        whole: Any,
        first: float,
        abort: float,
    ) -> Tree:
        """Tree of rectangles of times (aborted, coasted) in which no passive flight is in the square.

        See `_kept`.

        What it finds is no proof: `rans_proof.check_hybrid` bounds every rectangle anew.
        """
        (e0, e1), (p0, p1) = box
        if p0 > self._horizon - max(abort, first + e0):  # after the horizon
            return []
        begun = [flow(time) @ states for time in (e0, e1)]
        corners = [[self._coast(time) @ x for time in (p0, p1)] for x in begun]
        # Second derivatives of positions along both times.
        bends = [
            np.max(
                [np.abs((coast @ change @ x)[:2]).sum(axis=1) for coast in coasts for x in begun],
                axis=0,
            )
            for coasts, change in (
                ([self._coast(time) for time in (p0, p1)], a @ a),
                (
                    [self._passive @ self._passive @ self._coast(time) for time in (p0, p1)],
                    np.eye(4),
                ),
            )
        ]
        sides = np.array([e1 - e0, p1 - p0])
        off = _MORE * sum(bend * side**2 / 8.0 for bend, side in zip(bends, sides, strict=True))
        values = [self._directions @ x[:2] for row in corners for x in row]
        least = np.min([v[:, 0] - np.abs(v[:, 1:]).sum(axis=1) for v in values], axis=0)
        if (least - np.abs(self._directions) @ off - self._least).max() > 1e-9:
            return []
        # Halves along the time along which the position changes by more.
        change = [
            np.abs(corners[1][0][:2, 0] - corners[0][0][:2, 0]).max(),
            np.abs(corners[0][1][:2, 0] - corners[0][0][:2, 0]).max(),
        ]
        change = [
            c + (bend * side**2).max() for c, bend, side in zip(change, bends, sides, strict=True)
        ]
        axis = int(change[1] > change[0])
        lengths = [high - low for low, high in whole]
        if sides[axis] <= _SMALLEST * lengths[axis]:
            raise Open(
                f"a flight that is aborted {e0:.4f} min after a mode's begin may hit at {p0:.4f} min."
            )
        low, high = box[axis]
        middle = 0.5 * (low + high)
        halves = [
            tuple(part if k == axis else box[k] for k in (0, 1))
            for part in ((low, middle), (middle, high))
        ]
        return [
            axis,
            *(self._missed(a, flow, states, half, whole, first, abort) for half in halves),
        ]
