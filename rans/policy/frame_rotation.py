"""Columns of what is observed, seen in a body frame that has turned a little."""

from __future__ import annotations

from rans.model.fields import Field, Vec3
from rans.tasks.observation_terms import Block, Columns, RelativeRotation, VectorInW, matrix_rows


def scaled_sum(a: Field, x: Columns, b: Field, y: Columns) -> list[Field]:
    """The sum a x + b y."""
    return [a * p + b * q for p, q in zip(x, y, strict=True)]


def cross(a: Columns, x: Columns) -> list[Field]:
    """Vector product; in the plane the first vector is along z, and its length stands for it."""
    if len(a) == 1:
        return [-(a[0] * x[1]), a[0] * x[0]]
    return list(Vec3(*a).cross(Vec3(*x)).columns())


def turned(x: Columns, half: Columns) -> list[Field]:
    """A vector, seen in a frame that has turned by about twice this rotation vector (Cayley's transform)."""
    scale = 2.0 / (1.0 + sum(a * a for a in half))
    once = cross(half, x)
    return [
        value + scale * (second - first)
        for value, first, second in zip(x, once, cross(half, once), strict=True)
    ]


def seen_turned(block: Block, columns: Columns, half: Columns) -> Columns:
    """A block's columns in a frame that has turned so."""
    if issubclass(block.kind, RelativeRotation):
        if len(columns) == 2:
            return _unit(turned(columns, half))
        first, second, _ = zip(
            *(turned(column, half) for column in zip(*matrix_rows(columns), strict=True)),
            strict=True,
        )
        first = _unit(first)
        along = sum(a * b for a, b in zip(first, second, strict=True))
        return [*first, *_unit([b - along * a for a, b in zip(first, second, strict=True)])]
    return turned(columns, half) if issubclass(block.kind, VectorInW) else columns


def _unit(x: Columns) -> list[Field]:
    """A vector of almost unit length, closer to it: rounding of rows turned again and again would grow.

    The error is squared, as by Newton's method, and no vector comes out longer than 1.
    """
    scale = 2.0 / (1.0 + sum(a * a for a in x))
    return [a * scale for a in x]


def tilt_between(now: Columns, then: Columns) -> list[Field]:
    """How B is turned against where it was expected, as a rotation vector, from what both say of one turn."""
    if len(now) == 2:
        return [now[0] * then[1] - now[1] * then[0]]
    columns = [zip(*matrix_rows(one), strict=True) for one in (now, then)]
    turns = [cross(a, b) for a, b in zip(*columns, strict=True)]
    return [0.5 * sum(axis) for axis in zip(*turns, strict=True)]
