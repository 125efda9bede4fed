"""Shapes around a goal: keep-out balls, approach cones, speed limits and glide slopes.

One object is everything that a shape is: its `Shape.gap` is the margin of a constraint, its
`Shape.entries` are what a policy observes, optimal control and safety filters ask the same functions of
their own fields, and pages draw it (`rans.tasks.base.Task.scenery`). Shapes are frozen dataclasses of
fields (`rans.model.fields`), so that an episode may keep them in its goal's ``notes``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self, TypeVar

from rans.model.dynamics import State
from rans.model.fields import Field, Vector, cos, map_leaves, sin, sqrt, where
from rans.tasks.observation_terms import Information, InformationInW, ObservationTerm

_SOFTENING = 1e-18
"""Added to squared lengths, m^2 or m^2/s^2: at zero a length is 1e-9 and its gradient 0, in every library."""


@dataclass(frozen=True)
class Shape(ABC):
    """A region of positions, or of positions and velocities, where a spacecraft is allowed to be."""

    @abstractmethod
    def gap(self, position: Vector, velocity: Vector | None = None) -> Field:
        """Margin of a point, in SI units: not negative where the point is allowed.

        Args:
            position: position in W, m.
            velocity: velocity in W, m/s, which speed limits need.
        """

    def later(self, time: Field) -> Self:
        """The shape after a time, s: by default it stands still."""
        return self

    def entries(self, name: str, state: State) -> tuple[ObservationTerm, ...]:
        """What a policy observes of the shape: by default its margin."""
        return (Information(f"{name} gap", "m", self.gap(state.p, state.v)),)


AnyShape = TypeVar("AnyShape", bound=Shape)


@dataclass(frozen=True)
class Ball(Shape):
    """A keep-out zone: a disc in the plane or a ball in space, which may move at a constant velocity."""

    centre: Vector
    """Centre in W, m."""
    v: Vector
    """Velocity of the centre in W, m/s."""
    radius: Field
    """Radius, m. It includes the spacecraft's own where the whole craft must stay outside."""

    def gap(self, position: Vector, velocity: Vector | None = None) -> Field:
        """Distance from the ball's surface, m: negative inside."""
        return _length(position - self.centre) - self.radius

    def later(self, time: Field) -> Ball:
        """The ball after a time, s."""
        return replace(self, centre=self.centre + self.v.scale(time))

    def entries(self, name: str, state: State) -> tuple[ObservationTerm, ...]:
        """Way to the centre and relative velocity, both in W, and the distance from the surface."""
        return (
            InformationInW(f"{name} d", "m", self.centre - state.p),
            InformationInW(f"{name} dv_", "m/s", self.v - state.v),
            *super().entries(name, state),
        )


@dataclass(frozen=True)
class Cone(Shape):
    """An approach cone: nearer to its apex than its length, a point must be inside.

    Farther away everything is allowed.
    """

    apex: Vector
    """Apex in W, m: the port, or a point behind it."""
    axis: Vector
    """Unit vector in W from the apex along which the cone opens."""
    half_angle: Field
    """Angle between the axis and the surface, rad, below pi / 2."""
    length: Field
    """Distance from the apex beyond which the cone does not matter, m."""

    def gap(self, position: Vector, velocity: Vector | None = None) -> Field:
        """The larger of two signed distances, m: from the cone's surface and from the ball around it."""
        offset = position - self.apex
        inside = _inside_cone(offset, self.axis, cos(self.half_angle), sin(self.half_angle))
        beyond = _length(offset) - self.length
        return where(inside > beyond, inside, beyond)


@dataclass(frozen=True)
class SpeedLimit(Shape):
    """A limit of the speed that grows with the distance from a point: nearby one must be slow."""

    at: Vector
    """The point in W, m."""
    base: Field
    """Speed that is allowed at the point, m/s."""
    slope: Field
    """Speed more that is allowed per metre away from it, 1/s."""

    def gap(self, position: Vector, velocity: Vector | None = None) -> Field:
        """Speed below the limit, m/s: negative above it.

        Raises:
            ValueError: there is no velocity.
        """
        if velocity is None:
            raise ValueError("the margin of a speed limit needs a velocity.")
        return self.base + self.slope * _length(position - self.at) - _length(velocity)

    def entries(self, name: str, state: State) -> tuple[ObservationTerm, ...]:
        """The margin, m/s."""
        return (Information(f"{name} gap", "m/s", self.gap(state.p, state.v)),)


@dataclass(frozen=True)
class GlideSlope(Shape):
    """A descent corridor: the landing point must be seen at least at an angle above the horizon's plane.

    It is an infinite cone around the vertical of the landing point.
    """

    apex: Vector
    """Landing point in W, m."""
    up: Vector
    """Unit vector in W against gravity."""
    angle: Field
    """Least elevation as seen from the landing point, rad, below pi / 2."""

    def gap(self, position: Vector, velocity: Vector | None = None) -> Field:
        """Signed distance from the corridor's surface, m: negative outside."""
        return _inside_cone(position - self.apex, self.up, sin(self.angle), cos(self.angle))


def nearest_first(shapes: Sequence[AnyShape], position: Vector) -> list[AnyShape]:
    """Shapes of one kind, those with the smallest margin first, so that a policy sees no arbitrary order.

    A bubble sort, which never branches; where two are equally near, their order stays.
    """
    result: list[Any] = [(shape.gap(position), shape) for shape in shapes]
    for last in range(len(result) - 1, 0, -1):
        for k in range(last):
            gap, shape = result[k]
            other_gap, other = result[k + 1]
            swap = other_gap < gap
            result[k] = (where(swap, other_gap, gap), _chosen(swap, other, shape))
            result[k + 1] = (where(swap, gap, other_gap), _chosen(swap, shape, other))
    return [shape for _, shape in result]


def _chosen(condition: Field, one: AnyShape, other: AnyShape) -> AnyShape:
    """One shape where the condition holds, elsewhere the other; a number that both share stays a number."""

    def choose(a: Field, b: Field) -> Field:
        same = a is b or (isinstance(a, int | float) and isinstance(b, int | float) and a == b)
        return a if same else where(condition, a, b)

    return map_leaves(choose, one, other)


def _length(v: Vector) -> Field:
    """Euclidean length, whose gradient is zero at zero (`_SOFTENING`)."""
    return sqrt(v.dot(v) + _SOFTENING)


def _inside_cone(offset: Vector, axis: Vector, cosine: Field, sine: Field) -> Field:
    """Signed distance from the surface of an infinite cone, m; positive inside.

    Outside, behind the apex, it is that from the nearest generating line prolonged, which is not farther away.

    Args:
        offset: way from the apex, m.
        axis: unit vector.
        cosine: of the angle between axis and surface.
        sine: of the same angle.
    """
    along = offset.dot(axis)
    across = _length(offset - axis.scale(along))
    return along * sine - across * cosine
