"""Check of a certificate in ball arithmetic; it shares no code with the prover.

Every number is an interval of FLINT (Johansson, "Arb: efficient arbitrary-precision midpoint-radius interval
arithmetic", 2017), so that no rounding is argued about. A certificate is accepted if its network is the file at
hand, its cells cover the start set, and from every cell the property holds at all times with a margin above zero.
It reads the certificate (`rans_proof.check_file`) and the network (`rans_proof.check_network`) by readers of its
own; it needs numpy, onnx and python-flint.
"""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from flint import arb, arb_mat, arb_series, ctx

from rans_proof.balls import Refused, absolute_row_sums, column, diagonal, network_enclosure, sizes
from rans_proof.check_file import Claim, claim_of
from rans_proof.check_motion import Formula, Plant, Sloped, formula, reduced
from rans_proof.check_network import layers_of

_BITS = 80
"""Bits of a ball's middle."""
_SIDES = 48
"""Sides of the polygon around a circle of speeds."""
_OFF = 1e-6
"""Part of a state by which a flight that was written out may be off: it was computed in double precision."""


def check(certificate: bytes, network: bytes, only: Sequence[int] | None = None) -> float:
    """Least margin that this program finds over the cells of a certificate, or that of a flight that breaks it.

    Args:
        certificate: content of a certificate's file.
        network: content of the ONNX file.
        only: numbers of the cells whose flights are checked; None: all. The cover is checked in any case.

    Returns:
        A number above 0 if the property is proved, and below 0 if the certificate is of a flight that breaks it.

    Raises:
        Refused: it proves nothing, or is of another network.
    """
    ctx.prec = _BITS
    claim = _claim(certificate, network)
    loop = Loop(claim.problem, network)
    if claim.flight:
        return loop.broken(claim.flight)
    least = math.inf
    for k in range(len(claim.cells)) if only is None else only:
        margin = loop.margin(claim.cells[k])
        if not margin > 0.0:
            raise Refused(f"cell {k} has the margin {margin:.3g}.")
        least = min(least, margin)
    return least


@functools.lru_cache(maxsize=1)
def _claim(certificate: bytes, network: bytes) -> Claim:
    """Claim of a certificate of this network, whose cells cover its starts.

    The last one is remembered, because cells are checked a few at a time.
    """
    claim = claim_of(certificate)
    if claim.network != hashlib.sha256(network).hexdigest():
        raise Refused("it is of another network: the SHA-256 of the file differs.")
    start = claim.problem["start"]
    box = [(float(a), float(b)) for a, b in zip(start["lower"], start["upper"], strict=True)]
    if not claim.flight:
        _cover(box, claim.cells)
    elif not all(a <= x <= b for (a, b), x in zip(box, claim.flight[0], strict=True)):
        raise Refused("its flight does not begin among the starts.")
    return claim


def _cover(box: list[Any], cells: list[Any]) -> None:
    """Refuse cells that leave a part of a box open. Coordinates are compared, never computed."""
    stack = [(box, cells)]
    while stack:
        box, inside = stack.pop()
        pairs = [list(zip(box, cell, strict=True)) for cell in inside]
        pairs = [
            overlap
            for overlap in pairs
            if all((a < d and c < b) or a == b for (a, b), (c, d) in overlap)
        ]
        inside = [[cell for _, cell in overlap] for overlap in pairs]
        if any(all(c <= a and b <= d for (a, b), (c, d) in overlap) for overlap in pairs):
            continue
        cuts = [
            (axis, edge)
            for overlap in pairs
            for axis, ((a, b), ends) in enumerate(overlap)
            for edge in ends
            if a < edge < b
        ]
        if not cuts:
            raise Refused(f"its cells do not cover {box}.")
        axis, edge = cuts[len(cuts) // 2]
        parts = ((box[axis][0], edge), (edge, box[axis][1]))
        stack += [([*box[:axis], part, *box[axis + 1 :]], inside) for part in parts]


class Loop:
    """Closed loop of a problem and a network, in balls.

    Args:
        problem: table of `rans_proof.check_file.problem_table`.
        network: content of the ONNX file.
    """

    def __init__(self, problem: dict[str, Any], network: bytes) -> None:
        self._problem = problem
        count = len(problem["derivative"])
        names = [f"x{i}" for i in range(count)]
        low, high = (tuple(problem["start"][end]) for end in ("lower", "upper"))
        # What the network takes, as rows of factors and a constant.
        self._inputs = None
        if "inputs" in problem:
            rows = [_linear(text, names) for text in problem["inputs"]]
            self._inputs = arb_mat([row[:-1] for row in rows]), column([row[-1] for row in rows])
            middle = column([(arb(a) + arb(b)) / 2 for a, b in zip(low, high, strict=True)])
            half = column([(arb(b) - arb(a)) / 2 for a, b in zip(low, high, strict=True)])
            at = (self._inputs[0] * middle + self._inputs[1]).entries()
            reach = (sizes(self._inputs[0]) * half).entries()
            low, high = (
                tuple(float(x + sign * r) for x, r in zip(at, reach, strict=True))
                for sign in (-1, 1)
            )
        self._layers = layers_of(network, low, high)
        if self._layers[-1][0].nrows() != problem["commands"]:
            raise Refused(
                f"its network gives {self._layers[-1][0].nrows()} numbers, and its problem has "
                f"{problem['commands']} commands."
            )
        self._plant = Plant(problem["derivative"], problem["commands"], problem["period"])
        self._keep = Property(problem["keep"], count) if "keep" in problem else None
        self._end = Property({"within": problem["end"]}, count) if "end" in problem else None

    def _pieces(self, centre: Any, spread: Any) -> Iterator[tuple[int, bool, Any, Any, Any]]:
        """Pieces of flights: control period, whether it ends with the piece, begin, end and sag."""
        for number in range(self._problem["steps"]):
            if self._inputs is None:
                gain, offset, errors = network_enclosure(self._layers, centre, spread)
            else:
                table, shift = self._inputs
                gain, offset, errors = network_enclosure(
                    self._layers, table * centre + shift, table * spread
                )
                gain, offset = gain * table, gain * shift + offset
            pieces = list(self._plant.move(centre, spread, gain, offset, errors))
            for begin, end, sag in pieces:
                centre, spread = end
                yield number, begin is pieces[-1][0], begin, end, sag
            centre, spread = reduced(centre, spread)

    def margin(self, cell: Any) -> float:
        """Margin over all times of the flights from a cell."""
        centre = column([(arb(a) + arb(b)) / 2 for a, b in cell])
        spread = diagonal([(arb(b) - arb(a)) / 2 for a, b in cell])
        least, at_end = math.inf, -math.inf
        earliest = self._problem.get("end", {}).get("earliest", 0) or self._problem["steps"]
        still = [arb(0)] * len(cell)
        for number, is_last, begin, end, sag in self._pieces(centre, spread):
            if self._keep is not None and number >= self._problem.get("begins", 0):
                least = _least((least, self._keep.margin(begin, end, sag)))
            if not least > 0.0:
                return least
            if self._end is not None and is_last and number + 1 >= earliest:
                at_end = max(at_end, _least((self._end.margin(end, end, still),)))
        return least if self._end is None else min(least, at_end)

    def broken(self, flight: Sequence[Sequence[float]]) -> float:
        """How far below 0 the property's value is on a flight that was written out, at the worst instant.

        Raises:
            Refused: the flight is another one than this program's, or does not surely break the property.
        """
        first = column([arb(x) for x in flight[0]])
        point = first, arb_mat(len(flight[0]), 1)
        begins = self._problem.get("begins", 0)
        earliest = self._problem.get("end", {}).get("earliest", 0) or self._problem["steps"]
        values = [self._keep.value(point)] if self._keep is not None and begins == 0 else []
        at_ends = []
        for number, is_last, begin, end, _ in self._pieces(*point):
            if self._keep is not None and number >= begins:
                values += [self._keep.value(begin), self._keep.value(end)]
            if is_last:
                for x, claimed in zip(_hull(end), flight[number + 1], strict=True):
                    if not abs(x - arb(claimed)) <= arb(_OFF) * (1 + abs(arb(claimed))):
                        raise Refused(f"its flight is another one in period {number}.")
                if self._end is not None and number + 1 >= earliest:
                    at_ends.append(self._end.value(end))
        # The end's box is missed if it is missed at every instant at which a flight may be in it.
        lowest = [float(x.upper()) for x in values if x.is_finite()]
        if at_ends and all(x.is_finite() for x in at_ends):
            lowest.append(max(float(x.upper()) for x in at_ends))
        worst = min(lowest, default=math.inf)
        if not worst < 0.0:
            raise Refused(f"its flight does not surely break the property: {worst:.3g}.")
        return worst


def _linear(text: str, names: Sequence[str]) -> list[Any]:
    """Factors of names in a formula, and its constant as the last one.

    Raises:
        Refused: it is no linear function.
    """
    ctx.cap = 1
    zero, wide = arb_series([0]), arb_series([arb(0, 1e30)])
    unit = [[arb_series([int(i == k)]) for i in range(len(names))] for k in range(len(names))]
    value: Formula = formula(text, names)
    result = value([Sloped(zero, wide, row) for row in unit])
    if not isinstance(result, Sloped):  # a number
        return [*[arb(0)] * len(names), result]
    row = [*(p[0] for p in result.slopes), result.at[0]]
    if not all(x.is_finite() and x.rad() <= 1e-15 * (1 + abs(x.mid())) for x in row):
        raise Refused(f"its formula {text[:80]!r} is no linear function of the state.")
    return row


def _hull(state: tuple[Any, Any]) -> list[Any]:
    """Balls around each coordinate of a set."""
    widths = absolute_row_sums(state[1])
    return [x + arb(0, w.upper()) for x, w in zip(state[0].entries(), widths, strict=True)]


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
                *factors, constant = _linear(text, [f"x{i}" for i in range(count)])
                self._rows.append((arb_mat(1, count, factors), constant))

    def margin(self, begin: Any, end: Any, sag: Sequence[Any]) -> float:
        """Margin over a piece of a flight, which is off the chord between its ends by at most ``sag``.

        It is of linear functions of the state, so that over the chord each is least at an end.
        """
        if not self._rows:
            return _margin_of_distance(self._kind, self._limit, begin, end, sag)
        margins = []
        for row, constant in self._rows:
            off = (sizes(row) * column(sag))[0, 0]
            lowest = [constant - _highest(-row, state) - off for state in (begin, end)]
            margins.append(_least(x.lower() for x in lowest))
        return _least(margins) if self._is_every else max(margins)

    def value(self, state: tuple[Any, Any]) -> Any:
        """Ball around the property's value over a set, which is below 0 where it is broken."""
        x = column(_hull(state))
        values = [(row * x)[0, 0] + constant for row, constant in self._rows]
        if values:
            return functools.reduce(arb.min if self._is_every else arb.max, values)

        def length(states: Sequence[int]) -> Any:
            return sum((x[i, 0] * x[i, 0] for i in states), arb(0)).nonnegative_part().sqrt()

        distance = length(self._limit["position"])
        if self._kind == "speed_limit":
            limit = arb(self._limit["base"]) + arb(self._limit["slope"]) * distance
            return limit - length(self._limit["velocity"])
        away = distance - arb(self._limit["radius"])
        return away if self._kind == "keep_out" else -away


def _least(values: Iterable[Any]) -> float:
    """Least number; what is none, such as infinity less infinity, is below all."""
    return min(x if x == x else -math.inf for x in map(float, values))


def _highest(row: Any, state: tuple[Any, Any]) -> Any:
    """Largest value of a row of factors (1, n) times a state (centre, spread)."""
    return (row * state[0])[0, 0] + absolute_row_sums(row * state[1])[0]


def _margin_of_distance(
    kind: str, limit: dict[str, Any], begin: Any, end: Any, sag: Sequence[Any]
) -> float:
    """Margin of a ball to keep out of or to stay in, or of a limit of the speed, |v| < base + slope |p|.

    Along any unit vector d a position is no longer than it is, |p| >= d p: here along the middle of the chord. A
    velocity in the plane is at most 1 / cos(pi / K) times its longest component along K directions.
    """
    is_speed = kind == "speed_limit"
    position = limit["position"]
    if kind == "stay_in":  # the farthest corner of the boxes around both ends
        hulls = [_hull(state) for state in (begin, end)]
        corners = [[abs(hull[i]).upper() + sag[i] for i in position] for hull in hulls]
        far = [sum((x * x for x in corner), arb(0)).sqrt() for corner in corners]
        return _least((arb(limit["radius"]) - x).lower() for x in far)
    ahead = [float((begin[0][i, 0] + end[0][i, 0]).mid()) for i in position]
    norm = sum((arb(x) ** 2 for x in ahead), arb(0)).sqrt()
    slope = arb(limit["slope"]) if is_speed else arb(1)
    # The rows times a state are what counts against the margin; the sag adds to them.
    row = [arb(0)] * len(sag)
    for i, value in zip(position, ahead, strict=True):
        row[i] -= slope * arb(value) / norm
    off = slope * sum((sag[i] ** 2 for i in position), arb(0)).sqrt()
    if is_speed:
        base = arb(limit["base"])
        off += sum((sag[i] ** 2 for i in limit["velocity"]), arb(0)).sqrt()
        turns = [arb(2 * side) / _SIDES for side in range(_SIDES)]
        rows = [list(row) for _ in turns]
        for row_of_turn, turn in zip(rows, turns, strict=True):
            direction = turn.cos_pi(), turn.sin_pi()
            for i, value in zip(limit["velocity"], direction, strict=True):
                row_of_turn[i] += value / (arb(1) / _SIDES).cos_pi()
    else:
        base = -arb(limit["radius"])
        rows = [row]
    factors = [arb_mat(1, len(sag), values) for values in rows]
    return _least(
        (base - _highest(x, state) - off).lower() for x in factors for state in (begin, end)
    )
