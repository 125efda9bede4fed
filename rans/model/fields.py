"""Vectors and rotations whose members are *fields*, and functions of fields.

A field is one scalar quantity of one or many spacecraft: a torch tensor ``(N,)`` in the fast engine, a float or
NumPy array in a test or the Drake environment, a CasADi ``SX`` in an optimal control problem, or a
`rans.model.trace.Symbol` while a GPU kernel is generated. Equations over fields are arithmetic on named scalars,
so the same source runs in all these libraries and compiles into one kernel
(docs/decisions/engine.md).

Two rules keep equations traceable. Multiply a vector with ``v.scale(s)``, never ``s * v``: a torch tensor on the
left takes the operator first. Never branch on a field; use `where`.
"""

from __future__ import annotations

import math
import operator
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from typing import Any, NoReturn, Self, TypeVar

import numpy as np

Field = Any
"""A torch tensor (N,), a NumPy array, a float, or a CasADi SX; see the module's docstring."""

Tree = TypeVar("Tree")
"""A field, or a tuple or a frozen dataclass of trees."""

_SMALLEST_WHOLE = 1e-30
"""Denominator in place of zero: far below any time or force, and a normal number in single precision."""

_CASADI_NAMES = {"abs": "fabs", "minimum": "fmin", "maximum": "fmax", "where": "if_else"}


def _function(name: str, *fields: Field) -> Callable[..., Field]:
    """The function of this name in the library that the first non-float field belongs to."""
    for field in fields:
        library = type(field).__module__.partition(".")[0]
        if library == "torch":
            return getattr(sys.modules["torch"], name)
        if library == "casadi":
            return getattr(sys.modules["casadi"], _CASADI_NAMES.get(name, name))
        if library == "rans":
            return partial(type(field).apply, name)
    return getattr(np, name)


def _unary(name: str) -> Callable[[Field], Field]:
    return lambda x: _function(name, x)(x)


exp, log, log1p, tanh, absolute, floor = map(
    _unary, ("exp", "log", "log1p", "tanh", "abs", "floor")
)


def sin(angle: Field) -> Field:
    """Sine, a Python float of a Python float; NumPy's scalar would turn float32 arrays into float64."""
    return math.sin(angle) if isinstance(angle, float) else _function("sin", angle)(angle)


def cos(angle: Field) -> Field:
    """Cosine, as `sin`."""
    return math.cos(angle) if isinstance(angle, float) else _function("cos", angle)(angle)


def sqrt(x: Field) -> Field:
    """Square root. In torch its gradient at zero is zero, not infinite, so that norms of zero vectors have one."""
    if getattr(x, "requires_grad", False):
        positive = x > 0
        return where(positive, x, 1.0).sqrt() * positive
    return _function("sqrt", x)(x)


def atan2(y: Field, x: Field) -> Field:
    """Angle of the point (x, y), rad, in [-pi, pi]."""
    return _function("atan2", y, x)(y, x)


def where(condition: Field, a: Field, b: Field) -> Field:
    """``a`` where the condition is true, else ``b``; the condition is a field or a bool."""
    if isinstance(condition, bool):
        return a if condition else b
    return _function("where", condition, a, b)(condition, a, b)


def at_least(x: Field, bound: float) -> Field:
    """The larger of a field and a constant."""
    if isinstance(x, int | float):
        return max(x, bound)
    if type(x).__module__.startswith("torch"):
        return x.clamp(min=bound)
    return _function("maximum", x)(x, bound)


def within(x: Field, low: float, high: float) -> Field:
    """A field clipped to the range between two constants."""
    if isinstance(x, int | float):
        return min(max(x, low), high)
    if type(x).__module__.startswith("torch"):
        return x.clamp(low, high)
    return _function("minimum", x)(_function("maximum", x)(x, low), high)


def fraction_of(part: Field, whole: Field) -> Field:
    """Fraction of a whole that a part is, from 0 to 1.

    A whole that is zero, or below zero by rounding, is all of any positive part and nothing of none: a plain
    quotient would be a huge number of either sign there.
    """
    return within(part / at_least(whole, _SMALLEST_WHOLE), 0.0, 1.0)


def ascending(values: Sequence[Field]) -> list[Field]:
    """The fields sorted in ascending order (by a bubble sort, which needs no branches).

    NaN is left where comparisons put it.
    """
    result = list(values)
    for last in range(len(result) - 1, 0, -1):
        for k in range(last):
            a = result[k]
            b = result[k + 1]
            result[k], result[k + 1] = where(a < b, a, b), where(a < b, b, a)
    return result


def wrap(angle: Field) -> Field:
    """Angle wrapped to [-pi, pi), rad."""
    return angle - math.tau * floor(angle / math.tau + 0.5)


def finite(*xs: Field) -> Field:
    """Whether all fields are finite, by their sum: it is NaN or infinite if one of its terms is."""
    return absolute(reduce(operator.add, xs)) < 1e30  # beyond float32's squares


def leaves(tree: Any) -> tuple[Field, ...]:
    """Fields of a tree of frozen dataclasses and tuples, in the order of definition; None has no field."""
    leaves: list[Field] = []
    _gather(tree, leaves)
    return tuple(leaves)


def _gather(tree: Any, leaves: list[Field]) -> None:
    """Append the fields of a tree to a list, in the order of definition.

    This order is an interface: memory of kernels, rows of files and `_filled` have it.
    """
    if tree is None:
        return
    if isinstance(tree, tuple):
        for branch in tree:
            _gather(branch, leaves)
    elif hasattr(
        type(tree), "__match_args__"
    ):  # a dataclass: `dataclasses.fields` takes twice as long
        for name in type(tree).__match_args__:
            _gather(getattr(tree, name), leaves)
    else:
        leaves.append(tree)


def map_leaves(function: Callable[..., Field], tree: Tree, *others: Tree) -> Tree:
    """Tree of the same structure whose fields are ``function(field, *fields_of_the_others)``."""
    return unflatten(tree, map(function, leaves(tree), *map(leaves, others)))


def unflatten(tree: Tree, fields: Iterable[Field]) -> Tree:
    """Tree of the same structure filled with these fields, in the order of `leaves`."""
    return _filled(tree, iter(fields))


def _filled(tree: Any, fields: Iterator[Field]) -> Any:
    """A tree like this one with the next fields in place of its own.

    None stays None, so that a tree without an effect keeps its shape.
    """
    if tree is None:
        return None
    if isinstance(tree, tuple):
        return tuple([_filled(branch, fields) for branch in tree])
    if not hasattr(type(tree), "__match_args__"):
        return next(fields)
    return type(tree)(*[_filled(getattr(tree, name), fields) for name in type(tree).__match_args__])


@dataclass(frozen=True)
class Vector(ABC):
    """A vector in the plane or in space: `Vec2` or `Vec3`."""

    x: Field
    y: Field

    @abstractmethod
    def columns(self) -> tuple[Field, ...]:
        """The components, in order."""

    @abstractmethod
    def __add__(self, other: Any) -> Self:
        """Sum of two vectors of the same kind."""

    @abstractmethod
    def __sub__(self, other: Any) -> Self:
        """Difference of two vectors of the same kind."""

    def __mul__(self, other: object) -> NoReturn:
        raise TypeError(
            "a vector is multiplied by a number or a field as v.scale(s), and v.dot(u) is the scalar product; "
            "there is no v * s"
        )

    def __truediv__(self, other: object) -> NoReturn:
        raise TypeError("a vector is divided as v.scale(1.0 / s); there is no v / s")

    __rmul__ = __mul__

    @abstractmethod
    def scale(self, s: Field) -> Self:
        """The vector times a scalar field."""

    @abstractmethod
    def dot(self, other: Any) -> Field:
        """Scalar product."""

    def norm(self) -> Field:
        """Euclidean length."""
        return sqrt(self.dot(self))


def _require(other: object, kind: type[Vector]) -> None:
    if not isinstance(other, kind):
        raise TypeError(
            f"a vector and {type(other).__name__} cannot be added; this one is a {kind.__name__}, to which a "
            f"{kind.__name__} is added"
        )


class Attitude(ABC):
    """A rotation in the plane or in space: `Heading` or `Quat`."""

    @abstractmethod
    def rotate(self, v: Any) -> Any:
        """Vector expressed in W, from one expressed in B."""

    @abstractmethod
    def inverse(self) -> Self:
        """The inverse rotation: ``attitude.inverse().rotate(v)`` expresses a vector of W in B."""

    @abstractmethod
    def to(self, goal: Any) -> Attitude:
        """The rotation from this attitude to the goal's, R_B^T R_goal."""

    @abstractmethod
    def magnitude(self) -> Field:
        """The angle of the shortest equal rotation, rad, in [0, pi]."""

    @abstractmethod
    def normalised(self) -> Self:
        """Equal rotation with its angle in [-pi, pi), or with a unit quaternion."""

    @abstractmethod
    def columns(self) -> tuple[Field, ...]:
        """Continuous representation for policies: (cos, sin), or the first two rows of the rotation matrix."""


@dataclass(frozen=True)
class Vec2(Vector):
    """A vector in the plane."""

    def __add__(self, other: Vec2) -> Vec2:
        _require(other, Vec2)
        return Vec2(self.x + other.x, self.y + other.y)

    def __sub__(self, other: Vec2) -> Vec2:
        _require(other, Vec2)
        return Vec2(self.x - other.x, self.y - other.y)

    def scale(self, s: Field) -> Vec2:
        """The vector times a scalar field."""
        return Vec2(self.x * s, self.y * s)

    def dot(self, other: Vec2) -> Field:
        """Scalar product."""
        return self.x * other.x + self.y * other.y

    def columns(self) -> tuple[Field, ...]:
        """The components, in order."""
        return (self.x, self.y)


@dataclass(frozen=True)
class Vec3(Vector):
    """A vector in space."""

    z: Field

    def __add__(self, other: Vec3) -> Vec3:
        _require(other, Vec3)
        return Vec3(self.x + other.x, self.y + other.y, self.z + other.z)

    def __sub__(self, other: Vec3) -> Vec3:
        _require(other, Vec3)
        return Vec3(self.x - other.x, self.y - other.y, self.z - other.z)

    def scale(self, s: Field) -> Vec3:
        """The vector times a scalar field."""
        return Vec3(self.x * s, self.y * s, self.z * s)

    def dot(self, other: Vec3) -> Field:
        """Scalar product."""
        return self.x * other.x + self.y * other.y + self.z * other.z

    def cross(self, other: Vec3) -> Vec3:
        """Vector product."""
        a = self
        b = other
        return Vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)

    def columns(self) -> tuple[Field, ...]:
        """The components, in order."""
        return (self.x, self.y, self.z)


@dataclass(frozen=True)
class Heading(Attitude):
    """A rotation in the plane, R_WB, by its angle; it has the same methods as `Quat`, so that tasks serve both."""

    angle: Field
    """Heading of B's x axis in W, rad, not wrapped."""

    def rotate(self, v: Vec2) -> Vec2:
        """Vector expressed in W, from one expressed in B."""
        c = cos(self.angle)
        s = sin(self.angle)
        return Vec2(c * v.x - s * v.y, s * v.x + c * v.y)

    def inverse(self) -> Heading:
        """The inverse rotation: ``attitude.inverse().rotate(v)`` expresses a vector of W in B."""
        return Heading(0.0 - self.angle)

    def to(self, goal: Heading) -> Heading:
        """The rotation from this attitude to the goal's, R_B^T R_goal."""
        return Heading(goal.angle - self.angle)

    def magnitude(self) -> Field:
        """The angle of the shortest equal rotation, rad, in [0, pi]."""
        return absolute(wrap(self.angle))

    def normalised(self) -> Heading:
        """Equal rotation with its angle in [-pi, pi)."""
        return Heading(wrap(self.angle))

    def columns(self) -> tuple[Field, ...]:
        """The first column of the rotation matrix: (cos, sin)."""
        return (cos(self.angle), sin(self.angle))


@dataclass(frozen=True)
class Quat(Attitude):
    """A rotation in space, R_WB, as a unit quaternion (w, x, y, z)."""

    w: Field
    x: Field
    y: Field
    z: Field

    def rotate(self, v: Vec3) -> Vec3:
        """Vector expressed in W, from a vector v in B: (w^2 - u.u) v + 2 (u.v) u + 2 w u x v, u = (x, y, z).

        For a quaternion that is not of unit length this form scales the vector but still rotates it exactly; the
        shorter v + 2 u x (u x v + w v) does not.
        """
        w = self.w
        u = Vec3(self.x, self.y, self.z)
        along = v.scale(w * w - u.dot(u)) + u.scale(2.0 * u.dot(v))
        return along + u.cross(v).scale(2.0 * w)

    def times(self, other: Quat) -> Quat:
        """Hamilton product of fields: first the other rotation, then this one; it is not normalised."""
        a = self
        b = other
        return Quat(
            a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
            a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
            a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
            a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
        )

    def inverse(self) -> Quat:
        """The inverse rotation: ``attitude.inverse().rotate(v)`` expresses a vector of W in B."""
        return Quat(self.w, -self.x, -self.y, -self.z)

    def to(self, goal: Quat) -> Quat:
        """The rotation from this attitude to the goal's, R_B^T R_goal."""
        return self.inverse().times(goal)

    def magnitude(self) -> Field:
        """The angle of the rotation, rad, in [0, pi]; atan2 instead of arccos avoids NaN at both ends."""
        return 2.0 * atan2(Vec3(self.x, self.y, self.z).norm(), absolute(self.w))

    def normalised(self) -> Quat:
        """Quaternion scaled to unit length."""
        w = self.w
        x = self.x
        y = self.y
        z = self.z
        s = 1.0 / sqrt(w * w + x * x + y * y + z * z)
        return Quat(w * s, x * s, y * s, z * s)

    def columns(self) -> tuple[Field, ...]:
        """First two rows of the rotation matrix, continuous in the attitude; agents are trained on this order."""
        w = self.w
        x = self.x
        y = self.y
        z = self.z
        return (
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - w * z),
            2.0 * (x * z + w * y),
            2.0 * (x * y + w * z),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - w * x),
        )
