"""Ball arithmetic of the checker of certificates: matrices, and planes around dense networks.

Every number is an interval of FLINT (Johansson, "Arb: efficient arbitrary-precision midpoint-radius interval
arithmetic", 2017). The prover uses nothing here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from flint import arb, arb_mat


class Refused(Exception):
    """The certificate is refused; the message says why."""


def need(condition: object, reason: str) -> None:
    """Refuse a certificate that does not meet a condition."""
    if not condition:
        raise Refused(reason)


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


def diagonal(values: Sequence[Any]) -> Any:
    """Diagonal matrix."""
    table = arb_mat(len(values), len(values))
    for i, value in enumerate(values):
        table[i, i] = value
    return table


def side_by_side(*matrices: Any) -> Any:
    """One matrix of the columns of several, from left to right."""
    rows = zip(*(m.tolist() for m in matrices), strict=True)
    return arb_mat([[x for part in row for x in part] for row in rows])


def parallel(low: Any, high: Any, kind: str) -> tuple[Any, Any, Any]:
    """Slope, middle and half distance of parallel lines around an activation from low to high.

    The slope is that of the chord; what is left of it is largest at an end or where the slope is that of the
    activation: of tanh where 1 - tanh^2 is the slope. A sigmoid is (1 + tanh(z / 2)) / 2.
    """
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
    lowest: Any = min((x.lower() for x in values), key=float)
    highest: Any = max((x.upper() for x in values), key=float)
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


class Layer(NamedTuple):
    """Layer y = bend(weight x + bias)."""

    weight: Any
    bias: Any
    kind: str
    """Tanh, Sigmoid, Relu, or "" for none."""
    machine: tuple[Any, Any, Any] | None = None
    """What a machine's sums err by, at most factors |x| + shift, and its bends; None: they are exact."""
    sums: tuple[Any, Any, Any] | None = None
    """Factor and constant that bound a machine's partial sums by the largest number of |x| and 1, and the bound
    that they must be below; None: any."""


def network_enclosure(
    layers: Sequence[tuple[Any, ...]], centre: Any, spread: Any
) -> tuple[Any, Any, list[Any]]:
    """Planes around a network's answers to the states x = c + G s, |s| <= 1, as a machine computes them.

    What a layer gives is gain x + offset + noise e with |e| <= 1: each activation lies between two parallel lines
    over the range of its argument (`parallel`), and half their distance is a noise of its own, with the rounding of
    its argument times their slope.

    Args:
        layers: values of `Layer`.
        centre: c, (n, 1).
        spread: G, (n, k).

    Returns:
        Gain, offset and errors: the answers lie in gain x + offset +- errors.

    Raises:
        Refused: a partial sum of the machine may be too large for a number of its precision.
    """
    count = centre.nrows()
    gain = diagonal([arb(1)] * count)
    offset = arb_mat(count, 1)
    noise = arb_mat(count, 0)
    largest = [abs(c) + r for c, r in zip(centre.entries(), absolute_row_sums(spread), strict=True)]
    for layer in layers:
        weight, bias, kind, machine, sums = Layer(*layer)
        if sums is not None:
            factor, constant, limit = sums
            is_number = all(factor * x + constant < limit for x in (*largest, arb(1)))
            need(
                is_number,
                "its network's sums may be too large for numbers of the file's precision.",
            )
        gain = weight * gain
        offset = weight * offset + bias
        noise = weight * noise
        factors, shift, of_bend = machine or (0 * weight, 0 * bias, arb(0))
        off = (factors * column(largest) + shift).entries()
        if not kind:
            noise = side_by_side(noise, diagonal(off))
            continue
        middles = (gain * centre + offset).entries()
        widths = zip(absolute_row_sums(gain * spread), absolute_row_sums(noise), off, strict=True)
        reach = [sum(parts, arb(0)) for parts in widths]
        # Each activation between two lines, whose distance becomes noise.
        lines = [parallel(m - r, m + r, kind) for m, r in zip(middles, reach, strict=True)]
        slopes, middle, half = zip(*lines, strict=True)
        half = [h + abs(s) * o + of_bend for h, s, o in zip(half, slopes, off, strict=True)]
        gain = scaled(slopes, gain)
        noise = side_by_side(scaled(slopes, noise), diagonal(half))
        offset = scaled(slopes, offset) + column(middle)
        # Between the lines, whose slopes are not negative, lie the answers.
        largest = [
            s * (abs(m) + r) + abs(a) + h
            for s, m, r, a, h in zip(slopes, middles, reach, middle, half, strict=True)
        ]
    return gain, offset, absolute_row_sums(noise)
