"""Shapes around a goal: keep-out balls, approach cones, speed limits and glide slopes.

One object serves every use of a shape: `Shape.gap` is the margin of a constraint, `Shape.entries` are observation
terms, optimal control and safety filters evaluate the same functions, and pages draw the shape
(`rans.tasks.base.Task.scenery`). Shapes are frozen dataclasses of fields (`rans.model.fields`), so that an episode
can store them in the ``notes`` of its goal.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self, TypeVar

from rans.model.dynamics import State
from rans.model.fields import Field, Vector, cos, map_leaves, sin, sqrt, where
from rans.tasks.observation_terms import Information, InformationInW, ObservationTerm

_SOFTENING = 1e-18
"""Added to squared lengths, m^2 or m^2/s^2, so that at zero a length is 1e-9 and its gradient 0."""


@dataclass(frozen=True)
class Shape(ABC):
    """Base class of shapes: a region of allowed positions, or of positions and velocities."""

    @abstractmethod
    def gap(self, position: Vector, velocity: Vector | None = None) -> Field:
        """Margin of a point, in SI units; it is negative where the point is not allowed.

        Args:
            position: position in W, m.
            velocity: velocity in W, m/s, for speed limits.
        """

    def later(self, time: Field) -> Self:
        """The shape after a time (s); by default it does not move."""
        return self

    def entries(self, name: str, state: State) -> tuple[ObservationTerm, ...]:
        """Observation terms of the shape; by default its margin."""
        meaning = f"distance from the surface of the {name}, positive where it is allowed to be"
        return (Information(f"{name} gap", "m", self.gap(state.p, state.v), meaning=meaning),)


AnyShape = TypeVar("AnyShape", bound=Shape)


@dataclass(frozen=True)
class Ball(Shape):
    """A keep-out zone: a disc in the plane or a ball in space, which may move at a constant velocity."""

    centre: Vector
    """Centre in W, m."""
    v: Vector
    """Velocity of the centre in W, m/s."""
    radius: Field
    """Radius, m; it includes that of the spacecraft if the whole craft must stay outside."""

    def gap(self, position: Vector, velocity: Vector | None = None) -> Field:
        """Distance from the surface of the ball, m; negative inside."""
        return _length(position - self.centre) - self.radius

    def later(self, time: Field) -> Ball:
        """The ball after a time (s)."""
        return replace(self, centre=self.centre + self.v.scale(time))

    def entries(self, name: str, state: State) -> tuple[ObservationTerm, ...]:
        """Vector to the centre and relative velocity, both in W, and distance from the surface.

        Networks are trained on this order.
        """
        return (
            InformationInW(
                f"{name} d",
                "m",
                self.centre - state.p,
                meaning=f"position of the centre of {name} minus own",
            ),
            InformationInW(
                f"{name} dv_",
                "m/s",
                self.v - state.v,
                meaning=f"velocity of {name} minus own",
            ),
            *super().entries(name, state),
        )


@dataclass(frozen=True)
class Cone(Shape):
    """An approach cone: points within its length of the apex must be inside the cone; others are allowed."""

    apex: Vector
    """Apex in W, m: the port, or a point behind it."""
    axis: Vector
    """Unit vector in W from the apex along which the cone opens."""
    half_angle: Field
    """Angle between the axis and the surface, rad, below pi / 2."""
    length: Field
    """Distance from the apex beyond which the cone does not apply, m."""

    def gap(self, position: Vector, velocity: Vector | None = None) -> Field:
        """The larger of two signed distances, m: from the cone's surface and from the ball around it."""
        offset = position - self.apex
        inside = _inside_cone(offset, self.axis, *_cosine_and_sine(self.half_angle))
        beyond = _length(offset) - self.length
        return where(inside > beyond, inside, beyond)


@dataclass(frozen=True)
class SpeedLimit(Shape):
    """A speed limit that increases with the distance from a point."""

    at: Vector
    """The point in W, m."""
    base: Field
    """Speed limit at the point, m/s."""
    slope: Field
    """Increase of the limit per metre of distance, 1/s."""

    def gap(self, position: Vector, velocity: Vector | None = None) -> Field:
        """Limit less speed, m/s; negative above the limit.

        Raises:
            ValueError: there is no velocity.
        """
        if velocity is None:
            raise ValueError("the margin of a speed limit needs a velocity.")
        return self.base + self.slope * _length(position - self.at) - _length(velocity)

    def entries(self, name: str, state: State) -> tuple[ObservationTerm, ...]:
        """The margin of the limit, m/s."""
        meaning = "allowed speed minus own: positive where the speed is allowed"
        return (Information(f"{name} gap", "m/s", self.gap(state.p, state.v), meaning=meaning),)


@dataclass(frozen=True)
class GlideSlope(Shape):
    """A glide slope: seen from the landing point, the craft must be above a least elevation.

    It is an infinite cone around the vertical of the landing point.
    """

    apex: Vector
    """Landing point in W, m."""
    up: Vector
    """Unit vector in W opposite to gravity."""
    angle: Field
    """Least elevation as seen from the landing point, rad, below pi / 2."""

    def gap(self, position: Vector, velocity: Vector | None = None) -> Field:
        """Signed distance from the surface of the cone, m; negative outside."""
        cosine, sine = _cosine_and_sine(self.angle)
        return _inside_cone(position - self.apex, self.up, sine, cosine)


def nearest_first(shapes: Sequence[AnyShape], position: Vector) -> list[AnyShape]:
    """Shapes of one class sorted by margin, the smallest first, so that observations have a unique order.

    It is a stable bubble sort, which needs no branches.
    """
    result: list[Any] = [(shape.gap(position), shape) for shape in shapes]
    for last in range(len(result) - 1, 0, -1):
        for k in range(last):
            gap, shape = result[k]
            other_gap, next_shape = result[k + 1]
            swap = other_gap < gap
            result[k] = (where(swap, other_gap, gap), _chosen(swap, next_shape, shape))
            result[k + 1] = (where(swap, gap, other_gap), _chosen(swap, shape, next_shape))
    return [shape for _, shape in result]


def _chosen(condition: Field, first: AnyShape, second: AnyShape) -> AnyShape:
    """One shape where the condition is true, else the other; a number that both share stays a number."""

    def choose(a: Field, b: Field) -> Field:
        same = a is b or (isinstance(a, int | float) and isinstance(b, int | float) and a == b)
        return a if same else where(condition, a, b)

    return map_leaves(choose, first, second)


def _length(v: Vector) -> Field:
    """Euclidean length, whose gradient is zero at zero (`_SOFTENING`)."""
    return sqrt(v.dot(v) + _SOFTENING)


def _cosine_and_sine(angle: Field) -> tuple[Field, Field]:
    """Cosine and sine that are Python floats for a Python float; NumPy scalars turn float32 arrays into float64."""
    if isinstance(angle, int | float):
        return math.cos(angle), math.sin(angle)
    return cos(angle), sin(angle)


def _inside_cone(offset: Vector, axis: Vector, cosine: Field, sine: Field) -> Field:
    """Signed distance from the surface of an infinite cone, m; positive inside.

    Behind the apex it is the distance from the extended generating line, which is not larger than that from the
    cone.

    Args:
        offset: vector from the apex, m.
        axis: unit vector along the axis.
        cosine: cosine of the angle between axis and surface.
        sine: sine of the same angle.
    """
    along = offset.dot(axis)
    across = _length(offset - axis.scale(along))
    return along * sine - across * cosine
