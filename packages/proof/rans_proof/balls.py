"""Ball arithmetic that checkers of certificates share: matrices and enclosures of dense networks.

Every number is an interval of FLINT (Johansson, "Arb: efficient arbitrary-precision midpoint-radius interval
arithmetic", 2017). Nothing here is used by the provers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from flint import arb, arb_mat


class Refused(Exception):
    """The certificate is refused; the message says why."""


def matrix(values: np.ndarray) -> Any:
    """Matrix of balls without a radius."""
    rows, columns = values.shape
    return arb_mat(rows, columns, [arb(float(x)) for x in values.ravel()])


def sizes(matrix: Any) -> Any:
    """Absolute values."""
    return arb_mat(matrix.nrows(), matrix.ncols(), [abs(x) for x in matrix.entries()])


def absolute_row_sums(matrix: Any) -> list[Any]:
    """Sums of absolute values along rows."""
    return [sum((abs(x) for x in row), arb(0)) for row in matrix.tolist()]


def scaled(factors: Sequence[Any], matrix: Any) -> Any:
    """Rows times factors."""
    return arb_mat([[f * x for x in row] for f, row in zip(factors, matrix.tolist(), strict=True)])


def column(values: Sequence[Any]) -> Any:
    """Matrix of a column."""
    return arb_mat(len(values), 1, list(values))


def parallel(low: Any, high: Any, kind: str) -> tuple[Any, Any, Any]:
    """Slope, middle and half distance of parallel lines around an activation from low to high."""
    scale = arb("0.5") if kind == "Sigmoid" else arb(1)
    bend = _rectified if kind == "Relu" else arb.tanh
    low = (scale * low).lower()
    high = (scale * high).upper()
    slope = arb(0)
    if (high - low).lower() > 1e-9:
        slope = ((bend(high) - bend(low)) / (high - low)).mid()
    points = [low, high]
    if kind == "Relu":
        points += [arb(0)] if low < 0 < high else []  # in between it is straight
    elif 0 < slope < 1:
        turn = (1 - slope).sqrt().atanh()
        points += [z for z in (turn, -turn) if z.upper() >= low and z.lower() <= high]
    else:
        points.append(low.union(high))
    values = [bend(z) - slope * z for z in points]
    lowest = min((x.lower() for x in values), key=float)
    highest = max((x.upper() for x in values), key=float)
    lowest = (lowest - abs(lowest) * arb(1e-14) - arb(1e-300)).lower()  # as floats order them
    highest = (highest + abs(highest) * arb(1e-14) + arb(1e-300)).upper()
    middle = ((lowest + highest) / 2).mid()
    half = ((highest - lowest) / 2).upper()
    if kind != "Sigmoid":
        return slope, middle, half
    return slope / 4, arb("0.5") + middle / 2, half / 2


def _rectified(z: Any) -> Any:
    """The larger one of an exact number and 0; what is no number stays none."""
    return arb(0) if z <= 0 else z


def with_sizes(layers: Sequence[Any]) -> list[Any]:
    """Layers of weight, bias and activation, and the absolute weights that `network_enclosure` needs."""
    return [(*layer, sizes(layer[0])) for layer in layers]


def network_enclosure(
    layers: Sequence[Any], centre: Any, spread: Any
) -> tuple[Any, Any, list[Any]]:
    """Linear enclosure of a network's answers to the states x = c + G s, |s| <= 1.

    Every activation is enclosed by two parallel lines over the range of its argument (`parallel`).

    Args:
        layers: layers of `with_sizes`.
        centre: c, (n, 1).
        spread: G, (n, k).

    Returns:
        Gain, offset and errors: the answers lie in gain x + offset +- errors.
    """
    gain: Any = None
    offset: Any = None
    slopes: list[Any] = []
    line_errors: list[Any] = []
    errors: list[Any] = []
    for k, (weight, shift, kind, absolute) in enumerate(layers):
        # The linear operation, of what the lines before make of the state.
        gain = weight if gain is None else weight * gain
        offset = shift if offset is None else weight * offset + shift
        # Errors of the lines of every earlier layer, carried forward by the product of all between.
        carried = [arb(0)] * weight.nrows()
        product = weight
        for j in reversed(range(k)):
            by_layer = (absolute * column(line_errors[j])).entries()
            carried = [a + b for a, b in zip(carried, by_layer, strict=True)]
            if j:
                product = scaled(slopes[j], product.transpose()).transpose() * layers[j][0]
                absolute = sizes(product)
        if not kind:
            return gain, offset, carried
        # Lines over the range of each argument of the activation.
        middle = (gain * centre + offset).entries()
        reach = [a + b for a, b in zip(absolute_row_sums(gain * spread), carried, strict=True)]
        lines = [parallel(m - r, m + r, kind) for m, r in zip(middle, reach, strict=True)]
        slopes.append([line[0] for line in lines])
        line_errors.append([line[2] for line in lines])
        gain = scaled(slopes[-1], gain)
        offset = scaled(slopes[-1], offset) + column([line[1] for line in lines])
        errors = [s * c + e for s, c, e in zip(slopes[-1], carried, line_errors[-1], strict=True)]
    return gain, offset, errors


def side_by_side(*matrices: Any) -> Any:
    """One matrix of the columns of several, from left to right."""
    return arb_mat(
        [
            [x for row in rows for x in row]
            for rows in zip(*(m.tolist() for m in matrices), strict=True)
        ]
    )


def diagonal(values: Sequence[Any]) -> Any:
    """Diagonal matrix."""
    return arb_mat(
        [[x if i == k else arb(0) for k in range(len(values))] for i, x in enumerate(values)]
    )
