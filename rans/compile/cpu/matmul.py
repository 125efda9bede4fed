"""Products of matrices as machine code, whose columns are spacecraft, sixteen to a vector."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rans.compile.cpu.llvm import FLOAT, LANES, LONG, ROWS, TILE, Code, Value, constant

WIDTH = LANES * TILE
"""Columns that are computed together."""


def product(
    code: Code,
    shape: tuple[int, int],
    weights: Value,
    steps: tuple[int, int],
    source: Value,
    stride: Value,
    finish: Callable[[Value, list[Sequence[Value]]], object],
) -> None:
    """Of weights (rows, length) and `WIDTH` columns of a source (length, ...).

    Args:
        code: of the function.
        shape: rows and length.
        weights: where the first lies.
        steps: from row to row and from number to number of the weights, in numbers.
        source: where the columns begin.
        stride: of the source's rows, in numbers.
        finish: is given the number of the first of some rows, and their `TILE` vectors each.
    """
    (rows, length) = shape

    def group(first: Value, count: int) -> None:
        begins = [
            code.at(weights, code.mul(code.add(first, LONG(u)), LONG(steps[0])), FLOAT)
            for u in range(count)
        ]

        def summand(k: Value, sums: list[Value]) -> list[Value]:
            place = code.mul(k, stride)
            along = code.mul(k, LONG(steps[1]))
            x = [code.read(source, code.add(place, LONG(v * LANES))) for v in range(TILE)]
            w = [code.everywhere(code.read(begin, along, FLOAT)) for begin in begins]
            pairs = [(one, other) for one in w for other in x]
            return [
                code.times_plus(one, other, old)
                for old, (one, other) in zip(sums, pairs, strict=True)
            ]

        sums = code.repeat(length, [constant(0.0)] * (count * TILE), summand)
        finish(first, [sums[TILE * u : TILE * (u + 1)] for u in range(count)])

    code.groups(rows, ROWS, group)


def dense(
    code: Code,
    shape: tuple[int, int],
    weight: Value,
    bias: Value,
    source: Value,
    stride: Value,
    to: Value,
    step: Value,
    activation: str,
) -> None:
    """A layer of weights (rows, length) with its activation; ``step`` is the stride of what it makes."""

    def finish(first: Value, sums: list[Sequence[Value]]) -> None:
        for u, v, value in each(sums):
            unit = code.add(first, LONG(u))
            value = code.fadd(value, code.everywhere(code.read(bias, unit, FLOAT)))
            place = code.add(code.mul(unit, step), LONG(v * LANES))
            code.write(code.activation(activation, value), to, place)

    product(code, shape, weight, (shape[1], 1), source, stride, finish)


def each(sums: Sequence[Sequence[Value]]) -> list[tuple[int, int, Value]]:
    """Every sum with the numbers of its row and vector."""
    return [(u, v, value) for u, row in enumerate(sums) for v, value in enumerate(row)]


def correlation(
    code: Code,
    shape: tuple[int, int],
    a: Value,
    a_stride: Value,
    b: Value,
    b_stride: Value,
    vectors: Value,
    to: Value,
) -> None:
    """Add to each number of a matrix (rows, columns) the products of a row of a and one of b, summed.

    Both have rows of so many vectors.
    """
    rows, columns = shape

    def several(first: Value, count: int) -> None:
        def beside(second: Value, others: int) -> None:
            def summand(k: Value, sums: list[Value]) -> list[Value]:
                place = code.mul(k, LONG(LANES))
                left, right = (
                    [
                        code.read(x, code.add(code.mul(code.add(begin, LONG(i)), stride), place))
                        for i in range(many)
                    ]
                    for x, stride, begin, many in (
                        (a, a_stride, first, count),
                        (b, b_stride, second, others),
                    )
                )
                pairs = [(x, y) for x in left for y in right]
                return [code.times_plus(x, y, old) for old, (x, y) in zip(sums, pairs, strict=True)]

            sums = code.repeat(vectors, [code.everywhere(0.0)] * (count * others), summand)
            for i, value in enumerate(sums):
                row = code.mul(code.add(first, LONG(i // others)), LONG(columns))
                gather(code, value, to, code.add(row, code.add(second, LONG(i % others))))

        code.groups(columns, TILE, beside)

    code.groups(rows, ROWS, several)


def row_sums(code: Code, rows: int, a: Value, stride: Value, vectors: Value, to: Value) -> None:
    """Add to each of some numbers the sum of a row of so many vectors."""

    def several(first: Value, count: int) -> None:
        def summand(k: Value, sums: list[Value]) -> list[Value]:
            place = code.mul(k, LONG(LANES))
            return [
                code.fadd(
                    old, code.read(a, code.add(code.mul(code.add(first, LONG(i)), stride), place))
                )
                for i, old in enumerate(sums)
            ]

        for i, value in enumerate(code.repeat(vectors, [code.everywhere(0.0)] * count, summand)):
            gather(code, value, to, code.add(first, LONG(i)))

    code.groups(rows, ROWS, several)


def gather(code: Code, value: Value, to: Value, place: Value) -> None:
    """Add a vector's sum to a number."""
    code.write(code.fadd(code.read(to, place, FLOAT), code.total(value)), to, place)
