"""Observed columns in a body frame B that has rotated by a small angle.

A small rotation is a vector ``half_turn`` of half the angle, rad, along its axis: one component in the plane
(about z), three in space. Every function takes fields, columns by columns.
"""

from __future__ import annotations

from rans.model.fields import Field, Vec3
from rans.tasks.observation_terms import Block, Columns, RelativeRotation, VectorInW, matrix_rows


def scaled_sum(a: Field, x: Columns, b: Field, y: Columns) -> list[Field]:
    """The sum a x + b y of two vectors, component by component."""
    return [a * p + b * q for p, q in zip(x, y, strict=True)]


def cross(a: Columns, x: Columns) -> list[Field]:
    """Vector product a x x; in the plane ``a`` is along z and is written as its one component."""
    if len(a) == 1:
        return [-(a[0] * x[1]), a[0] * x[0]]
    return list(Vec3(*a).cross(Vec3(*x)).columns())


def vector_in_rotated_frame(x: Columns, half_turn: Columns) -> list[Field]:
    """Components of a vector in a frame that has rotated by about twice ``half_turn``, rad.

    Cayley's transform, which keeps lengths exactly: the angle is 2 atan |half_turn|. The vector x and the half turn
    have one component in the plane, or three.
    """
    scale = 2.0 / (1.0 + sum(a * a for a in half_turn))
    once = cross(half_turn, x)
    return [
        value + scale * (second - first)
        for value, first, second in zip(x, once, cross(half_turn, once), strict=True)
    ]


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
