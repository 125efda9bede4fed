"""Vectors in a body frame B that has rotated by a small angle.

A small rotation is a vector ``half_turn`` of half the angle, rad, along its axis: one component in the plane
(about z), three in space. Functions take fields, and packages estimate motion with them.
"""

from __future__ import annotations

from rans.model.fields import Field, Vec3
from rans.tasks.observation_terms import Columns


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
