"""Check of a network's certificate in ball arithmetic, which shares no code with the prover.

A certificate names a network by its SHA-256, a problem (plant, starts, property), and cells of starts, or a flight.
It is accepted if

1. it is well formed: a closed schema, so that no claim is made which is not checked here
   (`check_problem`);
2. the network is the file at hand, read by a reader of its own and compared with `onnx.reference`
   (`network_reader`);
3. its cells cover the starts (`_cover`);
4. from every cell the property holds at all times with a margin above zero (`Loop.margin`). A set of states
   goes through the network (`balls.network_enclosure`) and the plant (`check_motion.Plant`), period by period, and
   the property is judged over each step (`check_property.Property`). A cell that is too wide as a whole is halved;
5. a flight breaks the property at an instant for sure (`Loop.broken`).

Every number is an interval of FLINT, so that no rounding is argued about. It needs numpy, onnx and python-flint.
What it accepts is a theorem: tests plant errors of every kind, and each must be refused.
"""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from flint import arb, arb_mat, ctx

from rans_proof.balls import (
    Refused,
    column,
    diagonal,
    need,
    network_enclosure,
)
from rans_proof.check_motion import Plant, linear, reduced
from rans_proof.check_problem import Claim, claim_of
from rans_proof.check_property import Property, hull, least_of
from rans_proof.network_reader import layers_of

_BITS = 80
"""Bits of a ball's middle."""
_DEPTH = 12
"""A cell is halved so often at most."""
_EFFORT = 2000, 100
"""Taylor steps of all parts of a cell at most: a number, and so many more for each period. Of ARCH-COMP's problems
the double pendulum needs the largest number, 849 in 20 periods; a thousand steps of a formula of one state take
a second."""
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
        margin = loop.margin(claim.cells[k], _DEPTH)
        reason = loop.refusal or f"its margin is {margin:.3g}."
        need(margin > 0.0, f"cell {k} is not proved: {reason}")
        least = min(least, margin)
    return least


@functools.lru_cache(maxsize=1)
def _claim(certificate: bytes, network: bytes) -> Claim:
    """Claim of a certificate of this network, whose cells cover its starts.

    The last one is remembered, because cells are checked a few at a time.
    """
    claim = claim_of(certificate)
    digest = hashlib.sha256(network).hexdigest()
    need(claim.network == digest, "it is of another network: the SHA-256 of the file differs.")
    start = claim.problem["start"]
    box = [(float(a), float(b)) for a, b in zip(start["lower"], start["upper"], strict=True)]
    if claim.flight:
        is_start = all(a <= x <= b for (a, b), x in zip(box, claim.flight[0], strict=True))
        need(is_start, "its flight does not begin among the starts.")
    else:
        _cover(box, claim.cells)
    return claim


def _cover(box: Any, cells: Any) -> None:
    """Refuse cells that leave a part of a box open.

    Coordinates are compared, never computed, so that nothing is rounded. Cells may overlap.
    """
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
        need(cuts, f"its cells do not cover {box}.")
        axis, edge = cuts[len(cuts) // 2]
        parts = ((box[axis][0], edge), (edge, box[axis][1]))
        stack += [([*box[:axis], part, *box[axis + 1 :]], inside) for part in parts]


class Loop:
    """Closed loop of a problem and a network, in balls.

    Args:
        problem: table of `problem_table`.
        network: content of the ONNX file.
    """

    def __init__(self, problem: dict[str, Any], network: bytes) -> None:
        # The network as read is compared with `onnx.reference` around what it takes from the starts.
        self._problem = problem
        count = len(problem["derivative"])
        names = [f"x{i}" for i in range(count)]
        # What the network takes, as rows of factors and a constant, and its range over the starts.
        rows = [linear(text, names) for text in problem.get("inputs", names)]
        self._inputs = arb_mat([row[:-1] for row in rows]), column([row[-1] for row in rows])
        ends = list(zip(problem["start"]["lower"], problem["start"]["upper"], strict=True))
        self._spans = [high - low for low, high in ends]
        start = _set(ends)
        taken = hull((self._inputs[0] * start[0] + self._inputs[1], self._inputs[0] * start[1]))
        low, high = (tuple(float(end(x)) for x in taken) for end in (arb.lower, arb.upper))
        self._layers = layers_of(network, low, high)
        outputs = self._layers[-1][0].nrows()
        commands = problem["commands"]
        need(
            outputs == commands,
            f"its network gives {outputs} numbers, and its problem has {commands} commands.",
        )
        self._plant = Plant(problem["derivative"], commands, problem["period"])
        self._keep = Property(problem["keep"], count) if "keep" in problem else None
        self._end = Property({"within": _widened_end(problem)}, count) if "end" in problem else None
        self._begins = problem.get("begins", 0)
        self._earliest = problem.get("end", {}).get("earliest", 0) or problem["steps"]
        self._effort = _EFFORT[0] + _EFFORT[1] * problem["steps"]
        self.refusal = ""
        """Why the last part of a cell has no margin; "": it has one."""

    def _pieces(self, centre: Any, spread: Any) -> Iterator[tuple[int, bool, Any, Any, Any]]:
        """Pieces of flights: control period, whether it ends with the piece, begin, end and sag.

        Counts the plant's halvings anew.
        """
        self._plant.halvings = 0
        for number in range(self._problem["steps"]):
            pieces = self._plant.move(centre, spread, *self._commands(centre, spread))
            for begin, end, sag in pieces:
                centre, spread = end
                yield number, begin is pieces[-1][0], begin, end, sag
            centre, spread = reduced(centre, spread)

    def _commands(self, centre: Any, spread: Any) -> tuple[Any, Any, list[Any]]:
        """Commands of a set of states x: gain x + offset +- errors."""
        table, shift = self._inputs
        taken = table * centre + shift, table * spread
        gain, offset, errors = network_enclosure(self._layers, *taken)
        return gain * table, gain * shift + offset, errors

    def margin(self, cell: Any, depth: int = 0) -> float:
        """Margin over all times of the flights from a cell, which is halved ``depth`` times at most.

        Above 0 is a theorem about every state of the cell, so that anything that is not proved must come out as 0
        or less; halves count as much as the whole, since together they are the cell.
        """
        self._plant.left = self._effort
        return self._halved(cell, depth)

    def _halved(self, cell: Any, depth: int) -> float:
        """Margin of a cell, which is halved as long as the plant has steps left."""
        self.refusal = ""
        try:
            margin = self._margin(*_set(cell))
        except Refused as refusal:  # of a motion without a bound, or of a sum that is too large
            margin = -math.inf
            self.refusal = str(refusal)
        if margin > 0.0 or not depth or self._plant.left < 0:
            return margin
        # Halves along the state that is widest as a part of its starts, until one is refused.
        margins: list[float] = []
        parts = [
            (b - a) / (span or math.inf) for (a, b), span in zip(cell, self._spans, strict=True)
        ]
        axis = parts.index(max(parts))
        low, high = cell[axis]
        cut = low + (high - low) / 2
        for part in ((low, cut), (cut, high)):
            margins.append(self._halved([*cell[:axis], part, *cell[axis + 1 :]], depth - 1))
            if not margins[-1] > 0.0:
                break
        return min(margins)

    def _margin(self, centre: Any, spread: Any) -> float:
        """Margin over all times of the flights from a set (ball matrices).

        Infinite if the property asks nothing.
        """
        least = math.inf
        at_end = -math.inf
        still = [arb(0)] * centre.nrows()
        for number, is_last, begin, end, sag in self._pieces(centre, spread):
            if self._keep is not None and number >= self._begins:
                least = least_of((least, self._keep.margin(begin, end, sag)))
            if not least > 0.0:
                return least
            if self._end is not None and is_last and number + 1 >= self._earliest:
                at_end = max(at_end, least_of((self._end.margin(end, end, still),)))
        return least if self._end is None else min(least, at_end)

    def broken(self, flight: Sequence[Sequence[float]]) -> float:
        """How far below 0 the property's value is on a flight that was written out, at the worst instant.

        Raises:
            Refused: the flight is another one than this program's, or does not surely break the property.
        """
        self._plant.left = self._effort
        point = _set((x, x) for x in flight[0])
        values = [self._keep.value(point)] if self._keep is not None and self._begins == 0 else []
        at_ends = []
        for number, is_last, begin, end, _ in self._pieces(*point):
            if self._keep is not None and number >= self._begins:
                values += [self._keep.value(begin), self._keep.value(end)]
            if not is_last:
                continue
            for x, claimed in zip(hull(end), map(arb, flight[number + 1]), strict=True):
                # A flight as the rounding of the file may make it, which is a ball, is near it.
                is_near = abs(x - claimed).lower() <= arb(_OFF) * (1 + abs(claimed))
                need(is_near, f"its flight is another one in period {number}.")
            if self._end is not None and number + 1 >= self._earliest:
                at_ends.append(self._end.value(end))
        # The end's box is missed if it is missed at every instant at which a flight may be in it.
        lowest = [float(x.upper()) for x in values if x.is_finite()]
        if at_ends and all(x.is_finite() for x in at_ends):
            lowest.append(max(float(x.upper()) for x in at_ends))
        worst = min(lowest, default=math.inf)
        need(worst < 0.0, f"its flight does not surely break the property: {worst:.3g}.")
        return worst


def _widened_end(problem: dict[str, Any]) -> dict[str, list[float]]:
    """Box in which flights must end, lower and upper bounds by state, +-1e9 for constant states that start in it.

    A state of the rate "0" ends where it starts. If its starts fill the box, its margin would be 0, and a proof
    needs margins above 0.
    """
    start = problem["start"]
    end = problem["end"]
    box = {"lower": list(end["lower"]), "upper": list(end["upper"])}
    for i, rate in enumerate(problem["derivative"]):
        is_inside = end["lower"][i] <= start["lower"][i] and start["upper"][i] <= end["upper"][i]
        if rate.strip() == "0" and is_inside:
            box["lower"][i] = -1e9
            box["upper"][i] = 1e9
    return box


def _set(cell: Iterable[tuple[float, float]]) -> tuple[Any, Any]:
    """Centre (n, 1) and spread (n, n) of a box."""
    ends = [(arb(a), arb(b)) for a, b in cell]
    return column([(a + b) / 2 for a, b in ends]), diagonal([(b - a) / 2 for a, b in ends])
