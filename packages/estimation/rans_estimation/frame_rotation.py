"""Observed columns in a body frame B that has rotated by a small angle.

Half turns are those of `rans.policy.frame_rotation`. Every function takes fields, columns by columns.
"""

from __future__ import annotations

from rans.extend import (
    Block,
    Columns,
    Field,
    RelativeRotation,
    VectorInW,
    cross,
    vector_in_rotated_frame,
)
from rans.tasks.observation_terms import matrix_rows


def scaled_sum(a: Field, x: Columns, b: Field, y: Columns) -> list[Field]:
    """The sum a x + b y of two vectors, component by component."""
    return [a * p + b * q for p, q in zip(x, y, strict=True)]


def block_in_rotated_frame(block: Block, columns: Columns, half_turn: Columns) -> Columns:
    """Columns of an observed block in a frame B that has rotated by about twice ``half_turn``, rad.

    Vectors and the relative rotation change; every other block stays as it is. Of a relative rotation the rows
    are made orthonormal again, since rounding would accumulate from period to period.
    """
    if issubclass(block.kind, VectorInW):
        return vector_in_rotated_frame(columns, half_turn)
    if not issubclass(block.kind, RelativeRotation):
        return columns
    if len(columns) == 2:  # the plane: cosine and sine of the angle
        return _unit(vector_in_rotated_frame(columns, half_turn))
    first, second, _ = zip(
        *(
            vector_in_rotated_frame(column, half_turn)
            for column in zip(*matrix_rows(columns), strict=True)
        ),
        strict=True,
    )
    # One step of Gram-Schmidt.
    first = _unit(first)
    along = sum(a * b for a, b in zip(first, second, strict=True))
    return [*first, *_unit([b - along * a for a, b in zip(first, second, strict=True)])]


def _unit(x: Columns) -> list[Field]:
    """A vector of almost unit length, rescaled closer to it.

    The error of the length is squared, as by Newton's method, and no vector comes out longer than 1.
    """
    scale = 2.0 / (1.0 + sum(a * a for a in x))
    return [a * scale for a in x]


def tilt_between(rotation: Columns, expected: Columns) -> list[Field]:
    """Small rotation vector, rad in B, between a relative rotation as read and as it was expected.

    Args:
        rotation: columns of a `RelativeRotation`, 2 in the plane and 6 in space.
        expected: the same columns as predicted.
    """
    if len(rotation) == 2:
        return [rotation[0] * expected[1] - rotation[1] * expected[0]]
    columns = [zip(*matrix_rows(matrix), strict=True) for matrix in (rotation, expected)]
    products = [cross(a, b) for a, b in zip(*columns, strict=True)]
    return [0.5 * sum(axis) for axis in zip(*products, strict=True)]
