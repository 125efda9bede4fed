"""Check of a certificate about a chain of affine modes with an abort, in ball arithmetic.

It shares nothing with the search (`rans_proof.hybrid`), which joins corners of rectangles of times in double
precision: here a set of states is carried by the exponential of a mode's matrix to the middle of an interval of
time, and from there by its Taylor series, whose rest is bounded. Decimals are read as they are written, and every
number is an interval of FLINT.

What is proved if `check` accepts: of every flight from the starts, each mode ends once where its function rises
through zero and begins the next one; no function of a mode's `keep` is negative in it, up to the abort or the
horizon; and whenever a flight is aborted within `abort`, it is never in the square around the origin from then
until the horizon.
"""

from __future__ import annotations

import functools
import itertools
import math
import re
from typing import Any

from flint import arb, arb_mat, ctx

from rans_proof.balls import Refused, absolute_row_sums, column, diagonal, need, side_by_side
from rans_proof.claims import json_of, keys

_BITS = 128
_REACH, _REST = 8, 1e-15
"""Largest norm of matrix times time, and the part of the states that the rest of a series in time may have."""
_DEPTH = 24
"""A rectangle of times is halved so often at most; the first halves are those of the certificate."""
_TURNS = 48
"""Directions that are tried for one along which a position is outside of the square."""
_NUMBER = re.compile(r"-?[0-9]{1,9}(\.[0-9]{1,30})?")
_LARGEST = 2**28
"""Bytes of a certificate."""
_CELLS, _NODES = 10_000, 1_000_000
"""Largest numbers of cells, and of rectangles of a cell."""

Box = tuple[tuple[float, float], ...]
"""Ends along each time."""


def check(certificate: bytes) -> float:
    """Least distance beyond the square that this program finds along a direction, or infinity without an abort.

    Raises:
        Refused: it proves nothing.
    """
    ctx.prec = _BITS
    try:
        table = json_of(certificate, _LARGEST)
        keys("it", table, "format problem cells proofs")
        need(table["format"] == 1, "its format is not 1.")
        problem, cells = table["problem"], table["cells"]
        chain = Chain(problem)
        low, high = (_numbers(problem["start"][end]) for end in ("lower", "upper"))
        need(len(cells) == len(low) == len(high) == chain.count, "its starts have other states.")
        need(all(type(n) is int and n > 0 for n in cells), "its cells are no whole numbers.")
        places = list(itertools.product(*map(range, cells))) if math.prod(cells) <= _CELLS else []
        need(0 < len(places) == len(table["proofs"]), "it has not one proof of each cell.")
        for place, proof in zip(places, table["proofs"], strict=True):
            width = [(b - a) / n for a, b, n in zip(low, high, cells, strict=True)]
            centre = [
                a + (arb(k) + arb("0.5")) * w for a, k, w in zip(low, place, width, strict=True)
            ]
            chain.prove(side_by_side(column(centre), diagonal([w / 2 for w in width])), proof)
    except (ValueError, TypeError, LookupError, RecursionError, ArithmeticError) as error:
        raise Refused(f"it is damaged: {type(error).__name__} {error}.") from error
    return chain.least


def moved(rates: Any, states: Any, low: float, high: float) -> Any:
    """States x' = A x of all times of an interval, from states now.

    Args:
        rates: A.
        states: columns (c, g1, g2, ...) of the states c + g1 s1 + g2 s2 + ... with |s| <= 1.
        low: begin of the interval.
        high: its end.

    Returns:
        States in the same form; the first new column is what time changes at the interval's middle.
    """
    half = (arb(high) - arb(low)) / 2
    norm = max((float(x.upper()) for x in absolute_row_sums(rates)), default=0.0)
    reach = arb(norm) * half
    need(reach <= _REACH, "an interval of time is too long for its series.")
    at = (rates * ((arb(low) + arb(high)) / 2)).exp() * states
    # The terms A^k x t^k / k!: that of the middle state along time is a column, the others are a box.
    term = rates * at * half
    change = column([row[0] for row in term.tolist()])
    box = absolute_row_sums(arb_mat([[arb(0), *row[1:]] for row in term.tolist()]))
    factor, k = reach, 1
    while not factor * reach / (k + 1) / (1 - reach / (k + 2)) < _REST or k < _REACH:
        k += 1
        term = rates * term * (half / k)
        factor = factor * reach / k
        box = [a + b for a, b in zip(box, absolute_row_sums(term), strict=True)]
    # Further terms fall at least as those of a geometric series.
    size: Any = max((x.upper() for x in absolute_row_sums(at)), key=float)
    rest = size * factor * reach / (k + 1) / (1 - reach / (k + 2))
    return side_by_side(at, change, diagonal([x + rest for x in box]))


def lowest(row: Any, constant: Any, states: Any) -> Any:
    """Lower bound of a linear function of states."""
    values = (row * states).entries()
    return (values[0] + constant - sum((abs(x) for x in values[1:]), arb(0))).lower()


class Chain:
    """The modes of a problem.

    Args:
        problem: table of a certificate.
    """

    def __init__(self, problem: Any) -> None:
        keys("its problem", problem, "name horizon start mode passive", "abort")
        keys("its start", problem["start"], "lower upper")
        keys("its passive", problem["passive"], "rates half")
        self.least = math.inf
        self._horizon, self._half = _numbers([problem["horizon"], problem["passive"]["half"]])
        need(self._half > 0, "its square is none.")
        self._abort = _numbers(problem["abort"]) if "abort" in problem else None
        if self._abort is not None:
            need(
                len(self._abort) == 2 and self._abort[0] <= self._abort[1],
                "its abort is no interval.",
            )
            need(
                self._abort[0] >= 0 and self._abort[1] <= self._horizon, "its abort is not in time."
            )
        self._passive = arb_mat([_numbers(row) for row in problem["passive"]["rates"]])
        self.count = self._passive.nrows()
        self._modes = []
        for number, mode in enumerate(problem["mode"]):
            keys("its mode", mode, "name rates keep", "until")
            need(
                ("until" in mode) == (number + 1 < len(problem["mode"])),
                "a mode but the last has no end.",
            )
            rates = arb_mat([_numbers(row) for row in mode["rates"]])
            need(rates.nrows() == rates.ncols() == self.count, "its modes have other states.")
            rows = [_row(row, self.count) for row in mode["keep"]]
            guard = _row(mode["until"], self.count) if "until" in mode else None
            self._modes.append((rates, rows, guard))
        need(self._modes and self.count >= 2, "it has no mode, or no position.")

    def prove(self, states: Any, proof: Any) -> None:
        """Refuse a cell of starts whose flights are not proved by its tables of the modes.

        What a mode's table does not reach in time is refused, but for modes that begin after the last abort:
        nothing of them is claimed.
        """
        keys("a proof", proof, "modes")
        # When the mode begins: for the first and for the last flight.
        first = last = arb(0)
        until = self._horizon if self._abort is None else self._abort[1]
        for number, (rates, rows, guard) in enumerate(self._modes):
            if first > until:
                break
            table = proof["modes"][number]
            keys("a mode's proof", table, "end keep abort")
            longest = (until - first).upper()
            end = None
            if guard is not None:
                end = self._ended(rates, states, guard, table["end"])
                longest = min(longest, arb(end[1]), key=float)
            if rows:
                ((low, high),) = box = _box(table["keep"]["box"], 1)
                need(
                    low <= 0.0 and arb(high) >= longest, "a mode is not proved in all of its time."
                )
                test = functools.partial(self._keeps, rates, states, rows)
                _everywhere(test, box, table["keep"]["tree"])
            if self._abort is not None and not longest < self._abort[0] - last:
                begin = self._abort[0] - last
                (low, high), (now, late) = box = _box(table["abort"]["box"], 2)
                need(low <= 0.0 or arb(low) <= begin, "an early abort is not proved.")
                need(arb(high) >= longest, "a late abort is not proved.")
                coast = self._horizon - max(self._abort[0], first + max(low, 0.0), key=float)
                need(
                    now <= 0.0 and arb(late) >= coast, "a passive flight is not proved to its end."
                )
                flown = functools.cache(functools.partial(moved, rates, states))
                test = functools.partial(self._misses, rates, flown, first)
                _everywhere(test, box, table["abort"]["tree"])
            if end is None or guard is None:
                break
            states = _at(guard, rates, moved(rates, states, *end))
            first, last = first + end[0], last + end[1]

    def _ended(self, rates: Any, states: Any, guard: Any, end: Any) -> tuple[float, float]:
        """Times (s) of a mode's end: before them its function is below zero, then it rises, then is above.

        All three statements are about the whole set: a flight whose function rises twice would be in two modes.
        """
        ((low, high),) = _box([end], 1)
        row, constant = guard
        need(low > 0.0, "a mode may end at its begin.")

        def is_before(box: Box) -> int | None:
            if not _fits(rates, box[0]):
                return 0
            return None if lowest(-row, -constant, moved(rates, states, *box[0])) > 0 else 0

        _everywhere(is_before, ((0.0, low),), [])
        between = moved(rates, states, low, high)
        need(lowest(row * rates, arb(0), between) > 0, "a mode may end twice.")
        need(lowest(row, constant, moved(rates, states, high, high)) > 0, "a mode may end later.")
        return low, high

    @staticmethod
    def _keeps(rates: Any, states: Any, rows: Any, box: Box) -> int | None:
        """Whether no function is negative in an interval of time: None, or the axis to halve it along."""
        if not _fits(rates, box[0]):
            return 0
        during = moved(rates, states, *box[0])
        return None if all(lowest(row, c, during) > 0 for row, c in rows) else 0

    def _misses(self, rates: Any, flown: Any, first: Any, box: Box) -> int | None:
        """None if no flight is in the square in a rectangle of times, as is proved.

        Else the axis to halve it along.

        `least` gets the smallest distance so far, m, which the checker prints.
        """
        (begin, end), (now, late) = box
        assert self._abort is not None
        if arb(now) > self._horizon - max(self._abort[0], first + begin, key=float):
            return None  # after the horizon
        for axis, matrix in enumerate((rates, self._passive)):
            if not _fits(matrix, box[axis]):
                return axis
        begun = flown(begin, end)
        during = moved(self._passive, begun, now, late)
        # Along the best of some directions, which need not be of length 1.
        position = [[float(x.mid()) for x in row] for row in during.tolist()[:2]]
        best, chosen = -math.inf, (1.0, 0.0)
        for k in range(_TURNS):
            c, s = math.cos(2 * math.pi * k / _TURNS), math.sin(2 * math.pi * k / _TURNS)
            values = [c * x + s * y for x, y in zip(*position, strict=True)]
            value = values[0] - sum(map(abs, values[1:])) - float(self._half) * (abs(c) + abs(s))
            best, chosen = max((best, chosen), (value, (c, s)))
        row = arb_mat([[*map(arb, chosen), *[arb(0)] * (self.count - 2)]])
        corner = self._half * (abs(arb(chosen[0])) + abs(arb(chosen[1])))
        distance = lowest(row, -corner, during)
        if distance > 0:
            self.least = min(self.least, float(distance))
            return None
        # What time since the mode's begin, and time since the abort, change of the position.
        width = begun.ncols()
        changes = [sum(abs(row[k]) for row in position) for k in (width - self.count - 1, width)]
        return int(changes[1] > changes[0])


def _everywhere(test: Any, box: Box, tree: Any) -> None:
    """Refuse a box of times unless a test passes on all parts, those of a tree and halves of its leaves.

    ``test(part)`` is None if it passes, else the axis to halve; the tree only spares tests, so that a wrong one
    cannot prove anything.
    """
    stack: list[tuple[Box, Any, int]] = [(box, tree, 0)]
    for _ in range(_NODES):
        if not stack:
            return
        box, tree, depth = stack.pop()
        need(isinstance(tree, list), "it has a tree that is no list.")
        axis = tree[0] if tree else test(box)
        if axis is None:
            continue
        need(type(axis) is int and 0 <= axis < len(box), "it has a tree of another axis.")
        need(depth < _DEPTH, f"what is to be proved may be false at the times {box}.")
        low, high = box[axis]
        middle = low + (high - low) / 2
        branches = tree[1:] if tree else ([], [])
        need(len(branches) == 2, "it has a tree without two halves.")
        for part, branch in zip(((low, middle), (middle, high)), branches, strict=True):
            stack.append(((*box[:axis], part, *box[axis + 1 :]), branch, depth + 1))
    need(False, "it has too many rectangles.")


def _fits(rates: Any, ends: tuple[float, float]) -> bool:
    """Whether the series of an interval of time is one that is summed."""
    norm = max(float(x.upper()) for x in absolute_row_sums(rates))
    return norm * (ends[1] - ends[0]) / 2 < 0.99 * _REACH


def _at(guard: Any, rates: Any, states: Any) -> Any:
    """States of a set that are at a guard: moved onto it along one rate, which leaves those where they are."""
    row, constant = guard
    rate = (rates * column([x[0] for x in states.tolist()])).entries()
    rate = column([x.mid() for x in rate])
    values = row * states
    values[0, 0] += constant
    return states - rate * (values / (row * rate)[0, 0])


def _numbers(texts: Any) -> list[Any]:
    """Balls of decimals in a list."""
    need(
        all(isinstance(x, str) and _NUMBER.fullmatch(x) for x in texts),
        "it has a number that is no decimal.",
    )
    return [arb(x) for x in texts]


def _row(texts: Any, count: int) -> tuple[Any, Any]:
    """Row of factors (1, count) and the constant of a linear function."""
    *factors, constant = _numbers(texts)
    need(len(factors) == count, "it has a function of other states.")
    return arb_mat([factors]), constant


def _box(ends: Any, count: int) -> Any:
    """Intervals of times (s), ``count`` pairs of numbers within 1e9 in order; else `Refused`."""
    pairs = tuple((low, high) for low, high in ends)
    is_good = all(type(x) is float and 0.0 <= x < 1e9 for pair in pairs for x in pair)
    need(
        is_good and len(pairs) == count and all(a <= b for a, b in pairs),
        "it has a wrong interval.",
    )
    return pairs
