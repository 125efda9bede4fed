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
from collections.abc import Iterable, Sequence
from typing import Any

from flint import arb, arb_mat, ctx

from rans_proof.balls import (
    Refused,
    absolute_row_sums,
    column,
    derivative,
    diagonal,
    network_enclosure,
    plus,
    polynomial,
    polynomial_product,
    side_by_side,
    sizes,
    value_at,
)
from rans_proof.check_file import Claim, claim_of
from rans_proof.check_network import layers_of

_BITS = 80
"""Bits of a ball's middle."""
_SIDES = 48
"""Sides of the polygon around a circle of speeds."""
_SUBSTEPS = 12
"""Taylor steps of a control period of a plant that is not linear."""


def check(certificate: bytes, network: bytes, only: Sequence[int] | None = None) -> float:
    """Least margin that this program finds over the cells of a certificate.

    Args:
        certificate: content of a certificate's file.
        network: content of the ONNX file.
        only: numbers of the cells whose flights are checked; None: all. The cover is checked in any case.

    Raises:
        Refused: it proves nothing, or is of another network.
    """
    ctx.prec = _BITS
    claim = _claim(certificate, network)
    problem = claim.problem
    layers = layers_of(network, tuple(problem["start"]["lower"]), tuple(problem["start"]["upper"]))
    if layers[-1][0].nrows() != problem["commands"]:
        raise Refused(
            f"its network gives {layers[-1][0].nrows()} numbers, and its problem has "
            f"{problem['commands']} commands."
        )
    move = _linear(problem) or _taylor(problem)
    least = math.inf
    for k in range(len(claim.cells)) if only is None else only:
        margin = _fly(problem, layers, move, claim.cells[k])
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
    _cover(box, claim.cells)
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


def _fly(problem: dict[str, Any], layers: Any, move: Any, cell: Any) -> float:
    """Margin over all times of the flights from a cell."""
    centre = column([(arb(a) + arb(b)) / 2 for a, b in cell])
    spread = diagonal([(arb(b) - arb(a)) / 2 for a, b in cell])
    least = math.inf
    for _ in range(problem["steps"]):
        for begin, end, sag in move(centre, spread, *network_enclosure(layers, centre, spread)):
            least = _least((least, _margin(problem["keep"], begin, end, sag)))
            centre, spread = end
        if not least > 0.0:
            break
    if "end" in problem:
        last = centre, spread
        least = _least(
            (least, _margin({"within": problem["end"]}, last, last, [arb(0)] * len(cell)))
        )
    return least


def _least(values: Iterable[Any]) -> float:
    """Least number; what is none, such as infinity less infinity, is below all."""
    return min(x if x == x else -math.inf for x in map(float, values))


def _highest(row: Any, state: tuple[Any, Any]) -> Any:
    """Largest value of a row of factors (1, n) times a state (centre, spread)."""
    return (row * state[0])[0, 0] + absolute_row_sums(row * state[1])[0]


def _margin(keep: dict[str, Any], begin: Any, end: Any, sag: Sequence[Any]) -> float:
    """Margin of a property over a piece of a flight, which is off the chord between its ends by at most ``sag``.

    Margins are linear in the state, so that over the chord each is least at an end.
    """
    ((kind, limit),) = keep.items()
    if kind in ("avoid", "within"):
        return _margin_of_box(kind, limit, begin, end, sag)
    return _margin_of_distance(kind, limit, begin, end, sag)


def _margin_of_box(
    kind: str, limit: dict[str, Any], begin: Any, end: Any, sag: Sequence[Any]
) -> float:
    """Margin of keeping within a box: of the nearest face. Of avoiding it: of the axis that is farthest from it."""
    margins = []
    for axis, (low, high) in enumerate(zip(limit["lower"], limit["upper"], strict=True)):
        row = arb_mat(1, len(sag), [arb(int(i == axis)) for i in range(len(sag))])
        # x < low or -x < -high keeps out of the box, x < high and -x < -low within.
        edges = (arb(low), -arb(high)) if kind == "avoid" else (arb(high), -arb(low))
        for sign, edge in zip((1, -1), edges, strict=True):
            reach = [_highest(sign * row, state) + sag[axis] for state in (begin, end)]
            margins.append(_least((edge - x).lower() for x in reach))
    return max(margins) if kind == "avoid" else _least(margins)


def _margin_of_distance(
    kind: str, limit: dict[str, Any], begin: Any, end: Any, sag: Sequence[Any]
) -> float:
    """Margin of a ball to keep out of, |p| > r, or of a limit of the speed, |v| < base + slope |p|.

    Along any unit vector d a position is no longer than it is, |p| >= d p: here along the middle of the chord. A
    velocity in the plane is at most 1 / cos(pi / K) times its longest component along K directions.
    """
    is_speed = kind == "speed_limit"
    position = limit["position"]
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


def _linear(problem: dict[str, Any]) -> Any:
    """Motion of a linear plant by the exponential of its matrix, or None."""
    count = len(problem["derivative"])
    width = count + problem["commands"]
    rates = [polynomial(text, count, width) for text in problem["derivative"]]
    if any(sum(key) != 1 for rate in rates for key in rate):
        return None
    unit = [tuple(int(i == k) for i in range(width)) for k in range(width)]
    rows = [[rate.get(key, arb(0)) for key in unit] for rate in rates]
    both = arb_mat(rows + [[arb(0)] * width] * problem["commands"])
    h = arb(problem["period"])
    whole = (both * h).exp()
    widest = (sizes(both) * h).exp()
    second = sizes(both) * sizes(both) * widest * (h * h / 8)

    def move(centre: Any, spread: Any, gain: Any, offset: Any, errors: list[Any]) -> list[Any]:
        state = arb_mat([row[:count] for row in whole.tolist()[:count]])
        push = arb_mat([row[count:] for row in whole.tolist()[:count]])
        total = state + push * gain
        end = total * centre + push * offset, side_by_side(total * spread, push * diagonal(errors))
        largest = [
            abs(c) + r for c, r in zip(centre.entries(), absolute_row_sums(spread), strict=True)
        ]
        forces = (sizes(gain) * column(largest) + sizes(offset)).entries()
        largest += [f + e for f, e in zip(forces, errors, strict=True)]
        sag = (second * column(largest)).entries()[:count]
        return [((centre, spread), end, sag)]

    return move


def _taylor(problem: dict[str, Any]) -> Any:
    """Motion of a polynomial plant by Taylor steps of second order, with a bound of the third term.

    The variables are the states x, with x' = f(x, u), and the commands u, which are constant in a period. A step is
    x + h f + h^2 / 2 f' + h^3 / 6 f'', with f'' anywhere in the step.
    """
    count = len(problem["derivative"])
    width = count + problem["commands"]
    rates = [polynomial(text, count, width) for text in problem["derivative"]]
    h = arb(problem["period"]) / _SUBSTEPS

    def along(polynomials: Sequence[Any]) -> list[Any]:
        """Their derivatives by time."""
        parts = [
            [polynomial_product(derivative(p, k), f) for k, f in enumerate(rates)]
            for p in polynomials
        ]
        return [functools.reduce(plus, part) for part in parts]

    second = along(rates)
    third = along(second)
    unit = [{tuple(int(i == k) for i in range(width)): arb(1)} for k in range(count)]
    step = [plus(plus(x, f, h), g, h * h / 2) for x, f, g in zip(unit, rates, second, strict=True)]
    slopes = [[derivative(component, k) for k in range(width)] for component in step]

    def states_of(centre: list[Any], spread: Any) -> tuple[Any, Any]:
        return column(centre[:count]), arb_mat(spread.tolist()[:count])

    def move(centre: Any, spread: Any, gain: Any, offset: Any, errors: list[Any]) -> list[Any]:
        # States and commands as one set, centre + spread s with |s| <= 1; errors of commands are further s.
        variables = [*centre.entries(), *(gain * centre + offset).entries()]
        of_states = side_by_side(spread, arb_mat(count, len(errors)))
        of_commands = side_by_side(gain * spread, diagonal(errors))
        wide = arb_mat(of_states.tolist() + of_commands.tolist())
        pieces = []
        for _ in range(_SUBSTEPS):
            widths = absolute_row_sums(wide)
            balls = [
                arb(c.mid(), (r + c.rad()).upper()) for c, r in zip(variables, widths, strict=True)
            ]
            during = _during(rates, balls, h)
            remainder = [h**3 / 6 * abs(value_at(p, during)).upper() for p in third]
            sag = [(h * h / 8 * abs(value_at(p, during))).upper() for p in second]
            # Mean value theorem: the step is its value at the centre, and slopes over the whole set. What is
            # uncertain in the slopes, in the centre and in that value is an error.
            exact = [x.mid() for x in variables]
            jacobian = arb_mat([[value_at(entry, balls) for entry in row] for row in slopes])
            fixed = arb_mat([[x.mid() for x in row] for row in jacobian.tolist()])
            loose = arb_mat([[arb(x.rad()) for x in row] for row in jacobian.tolist()])
            reach = [r + arb(c.rad()) for r, c in zip(widths, variables, strict=True)]
            off = [a + b for a, b in zip((loose * column(reach)).entries(), remainder, strict=True)]
            new = [value_at(component, exact) for component in step]
            of_centre = (sizes(fixed) * column([arb(c.rad()) for c in variables])).entries()
            off = [a + b + arb(n.rad()) for a, b, n in zip(off, of_centre, new, strict=True)]
            # The set after the step; its errors are further s.
            begin = states_of(variables, wide)
            moved = arb_mat((fixed * wide).tolist() + wide.tolist()[count:])
            extra = arb_mat(diagonal(off).tolist() + [[arb(0)] * count] * (width - count))
            variables = [n.mid() for n in new] + variables[count:]
            wide = side_by_side(moved, extra)
            pieces.append((begin, states_of(variables, wide), sag))
        return pieces

    return move


def _during(rates: Sequence[Any], balls: list[Any], h: Any) -> list[Any]:
    """Balls that hold states and commands at all times of a step of length h; ``balls`` hold them at its start.

    They are guessed by Picard's iteration with some room, and hold the motion if it leaves them inside.
    """
    count = len(rates)
    grown = balls
    for _ in range(3):
        grown = [
            x + arb(0, (2 * h * abs(value_at(f, grown))).upper())
            for x, f in zip(balls, rates, strict=False)
        ] + balls[count:]
    for x, larger, f in zip(balls, grown, rates, strict=False):
        if not larger.contains(x + (arb(0).union(h)) * value_at(f, grown)):
            raise Refused("its motion has no bound within a Taylor step.")
    return grown
