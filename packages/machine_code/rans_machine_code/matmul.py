"""Matrix products as printed machine code; columns are samples or spacecraft, `LANES` to a vector.

Matrices are float32 in memory, row by row. A value that is called an array is the address of its first number, and
strides are in numbers. The order of sums is fixed, so that a training is repeated bit by bit; strips are `ROWS`
rows by `TILE` vectors.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rans_machine_code.llvm import FLOAT, LANES, LONG, ROWS, TILE, Code, Value, constant

WIDTH = LANES * TILE
"""Columns that are computed together."""


def matrix_product(
    code: Code,
    shape: tuple[int, int],
    weights: Value,
    steps: tuple[int, int],
    source: Value,
    stride: Value,
    finish: Callable[[Value, list[Sequence[Value]]], object],
) -> None:
    """Print the product of weights (rows, length) and `WIDTH` columns of a source (length, ...).

    Args:
        code: of the function.
        shape: rows and length.
        weights: array of the weights.
        steps: strides of the weights by row and by column.
        source: array whose first `WIDTH` columns are multiplied.
        stride: of the source's rows.
        finish: prints what becomes of the sums, from the number of a first row and the `TILE` vectors of it and of
            each row after it in the group.
    """
    (rows, length) = shape

    # Groups of as many rows as registers hold sums of.
    def group(first: Value, count: int) -> None:
        """Print the sums of ``count`` rows from row ``first``, `TILE` vectors each, and hand them to ``finish``.

        Each sum runs over the inner index from 0 up, by fused products: another order would be another training.
        """
        begins = [
            code.at(weights, code.mul(code.add(first, LONG(u)), LONG(steps[0])), FLOAT)
            for u in range(count)
        ]

        def summand(k: Value, sums: list[Value]) -> list[Value]:
            """Print number k of the inner sums: a weight of each row times `TILE` vectors of the source's row k."""
            offset = code.mul(k, stride)
            along = code.mul(k, LONG(steps[1]))
            x = [code.read(source, code.add(offset, LONG(v * LANES))) for v in range(TILE)]
            w = [code.everywhere(code.read(begin, along, FLOAT)) for begin in begins]
            pairs = [(weight_vector, column) for weight_vector in w for column in x]
            return [
                code.times_plus(weight_vector, column, old)
                for old, (weight_vector, column) in zip(sums, pairs, strict=True)
            ]

        sums = code.repeat(length, [constant(0.0)] * (count * TILE), summand)
        finish(first, [sums[TILE * u : TILE * (u + 1)] for u in range(count)])

    code.groups(rows, ROWS, group)


def dense_layer(
    code: Code,
    shape: tuple[int, int],
    weight: Value,
    bias: Value,
    source: Value,
    stride: Value,
    output: Value,
    output_stride: Value,
    activation: str,
) -> None:
    """Print a dense layer with its activation for `WIDTH` columns.

    Args:
        code: of the function.
        shape: units and inputs.
        weight: (units, inputs).
        bias: (units,).
        source: (inputs, ...) whose first columns are the inputs.
        stride: of the source's rows.
        output: (units, ...) whose first columns are written.
        output_stride: of the output's rows.
        activation: key of `rans.policy.activations.ACTIVATIONS`, or "".
    """

    def finish(first: Value, sums: list[Sequence[Value]]) -> None:
        for u, v, value in numbered_sums(sums):
            unit = code.add(first, LONG(u))
            value = code.fadd(value, code.everywhere(code.read(bias, unit, FLOAT)))
            offset = code.add(code.mul(unit, output_stride), LONG(v * LANES))
            code.write(code.activation(activation, value), output, offset)

    matrix_product(code, shape, weight, (shape[1], 1), source, stride, finish)


def numbered_sums(sums: Sequence[Sequence[Value]]) -> list[tuple[int, int, Value]]:
    """Index of the row, index of the vector, and sum, for every sum of `matrix_product`."""
    return [(u, v, value) for u, row in enumerate(sums) for v, value in enumerate(row)]


def row_correlations(
    code: Code,
    shape: tuple[int, int],
    a: Value,
    a_stride: Value,
    b: Value,
    b_stride: Value,
    vectors: Value,
    output: Value,
) -> None:
    """Print output += a b', the sums of products of each row of ``a`` with each row of ``b``.

    Args:
        code: of the function.
        shape: rows of ``a`` and rows of ``b``.
        a: (rows, samples).
        a_stride: of the rows of ``a``.
        b: (columns, samples).
        b_stride: of the rows of ``b``.
        vectors: samples, in vectors.
        output: (rows, columns), added to.
    """
    # Blocks of rows of both, so that each vector that is read is used several times.
    rows, columns = shape

    def row_group(first_row: Value, group_rows: int) -> None:
        """Print the products of ``group_rows`` rows of a with all rows of b."""

        def column_group(first_column: Value, column_count: int) -> None:
            """Print the products of this group's rows with ``column_count`` rows of b, added to the output."""

            def vectors_at(
                k: Value, x: Value, stride: Value, begin: Value, count: int
            ) -> list[Value]:
                """Vector k (`LANES` numbers) of ``count`` rows of x from row ``begin``; ``stride`` in numbers."""
                offset = code.mul(k, LONG(LANES))
                starts = [code.mul(code.add(begin, LONG(i)), stride) for i in range(count)]
                return [code.read(x, code.add(start, offset)) for start in starts]

            def summand(k: Value, sums: list[Value]) -> list[Value]:
                """Sums of products, one of each pair of rows, with the products of vectors k added."""
                left = vectors_at(k, a, a_stride, first_row, group_rows)
                right = vectors_at(k, b, b_stride, first_column, column_count)
                pairs = [(x, y) for x in left for y in right]
                return [code.times_plus(x, y, old) for old, (x, y) in zip(sums, pairs, strict=True)]

            sums = code.repeat(
                vectors, [code.everywhere(0.0)] * (group_rows * column_count), summand
            )
            # The sum of each pair, into its row and column of the output.
            for i, value in enumerate(sums):
                row = code.mul(code.add(first_row, LONG(i // column_count)), LONG(columns))
                add_vector_sum(
                    code,
                    value,
                    output,
                    code.add(row, code.add(first_column, LONG(i % column_count))),
                )

        code.groups(columns, TILE, column_group)

    code.groups(rows, ROWS, row_group)


def row_sums(code: Code, rows: int, a: Value, stride: Value, vectors: Value, output: Value) -> None:
    """Print output (rows,) += the sum of each row of ``a``, which has ``vectors`` vectors of `LANES` numbers.

    Gradients of biases are these sums over the samples of a minibatch, whose order is fixed as that of the products
    is.
    """

    def row_group(first: Value, count: int) -> None:
        """Print the sums of ``count`` rows from ``first``, added to the output."""

        def summand(k: Value, sums: list[Value]) -> list[Value]:
            offset = code.mul(k, LONG(LANES))
            return [
                code.fadd(
                    old, code.read(a, code.add(code.mul(code.add(first, LONG(i)), stride), offset))
                )
                for i, old in enumerate(sums)
            ]

        for i, value in enumerate(code.repeat(vectors, [code.everywhere(0.0)] * count, summand)):
            add_vector_sum(code, value, output, code.add(first, LONG(i)))

    code.groups(rows, ROWS, row_group)


def add_vector_sum(code: Code, value: Value, array: Value, index: Value) -> None:
    """Print array[index] += the sum of a vector's numbers."""
    code.write(code.fadd(code.read(array, index, FLOAT), code.total(value)), array, index)
