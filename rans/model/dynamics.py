"""Equations of motion, written once over fields: torch, NumPy and CasADi run this source.

World frame W, body frame B at the centre of mass. Thrust is constant in B over one control period
(zero-order hold), disturbances are constant in W. There is no gravity and no friction: the spacecraft
flies free or floats on air.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from rans.model.fields import Attitude, Field, Heading, Quat, Vec2, Vec3, Vector, at_least, cos, sin
from rans.model.magnus import Rotation, Series, at, exponential, last_product, total, turned
from rans.model.spacecraft import Spacecraft

NODES = 6
"""Of the Gauss-Legendre rule for planar motion. Over one control period its error, as a share of the
thrust's effect, is below 3e-13 up to 1 rad turned and 3e-11 up to 2 rad
(docs/decisions/003-planar-motion-by-quadrature.md)."""
_SPATIAL_NODES = 3
"""The same in space: of order six, as the attitude is (docs/decisions/006-motion-in-space-by-series.md)."""
_SPIN_ORDER = 8
"""Of the angular velocity of a body whose moments of inertia differ."""


def _gauss_legendre(count: int) -> tuple[tuple[float, float], ...]:
    """Nodes and weights on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return tuple((float(n + 1) / 2, float(w) / 2) for n, w in zip(nodes, weights, strict=True))


_RULES = {count: _gauss_legendre(count) for count in range(1, NODES + 3)}
"""Made beforehand: torch cannot trace NumPy's polynomials."""


@dataclass(frozen=True)
class State(ABC):
    """Motion of the body frame B in the world frame W: `PlanarState` or `SpatialState`."""

    p: Vector
    attitude: Attitude
    v: Vector
    w: Field

    @abstractmethod
    def spin(self) -> tuple[Field, ...]:
        """The components of the angular velocity, rad/s."""


@dataclass(frozen=True)
class PlanarState(State):
    """Motion in the plane (3DoF)."""

    p: Vec2
    """p_WB, m."""
    attitude: Heading
    """R_WB."""
    v: Vec2
    """v_WB, expressed in W, m/s."""
    w: Field
    """w_WB about z, rad/s."""

    def normalised(self) -> PlanarState:
        """The same state with its heading in [-pi, pi)."""
        return PlanarState(self.p, self.attitude.normalised(), self.v, self.w)

    def spin(self) -> tuple[Field, ...]:
        """The components of the angular velocity, rad/s."""
        return (self.w,)


@dataclass(frozen=True)
class SpatialState(State):
    """Motion in space (6DoF)."""

    p: Vec3
    """p_WB, m."""
    attitude: Quat
    """R_WB."""
    v: Vec3
    """v_WB, expressed in W, m/s."""
    w: Vec3
    """w_WB_B: angular velocity expressed in B, rad/s."""

    def normalised(self) -> SpatialState:
        """The same state with a unit quaternion."""
        return SpatialState(self.p, self.attitude.normalised(), self.v, self.w)

    def spin(self) -> tuple[Field, ...]:
        """The components of the angular velocity, rad/s."""
        return self.w.columns()


AnyState = TypeVar("AnyState", PlanarState, SpatialState)


@dataclass(frozen=True)
class Wrench:
    """Force and torque about the centre of mass: expressed in B for thrust, in W for a disturbance."""

    force: Vec2 | Vec3
    """N."""
    torque: Field | Vec3
    """N m; a scalar about z in the plane."""


@dataclass(frozen=True)
class MassProperties:
    """What resists a wrench."""

    mass: Field
    """kg."""
    inertia: tuple[Field, ...]
    """About the centre of mass, axes of B, kg m^2. Plane: (I_zz,). Space: the six entries
    (I_xx, I_xy, I_xz, I_yy, I_yz, I_zz)."""

    @classmethod
    def of(cls, craft: Spacecraft) -> MassProperties:
        """The nominal mass properties of a spacecraft."""
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = craft.inertia
        return cls(craft.mass, (zz,) if craft.dimension == 2 else (xx, xy, xz, yy, yz, zz))


def thrust(craft: Spacecraft, command: Sequence[Field]) -> tuple[Field, ...]:
    """Share of its full force that each thruster gives, after the supply's limit.

    Args:
        craft: the spacecraft; its ``thrust_sharing`` decides.
        command: one field per thruster, 0 (shut) to 1 (open).
    """
    if craft.thrust_sharing == "none":
        return tuple(command)
    share = 1.0 / at_least(sum(command[1:], start=command[0]), 1.0)
    return tuple(c * share for c in command)


def wrench(craft: Spacecraft, command: Sequence[Field]) -> Wrench:
    """Sum of the thrusters' forces and torques on B.

    Args:
        craft: gives each thruster's full-on wrench (`Spacecraft.wrench_map`).
        command: one field per thruster, 0 (shut) to 1 (open).
    """
    shares = thrust(craft, command)
    total = [_dot(shares, column) for column in zip(*craft.wrench_map, strict=True)]
    if craft.dimension == 2:
        return Wrench(Vec2(total[0], total[1]), total[2])
    return Wrench(Vec3(*total[:3]), Vec3(*total[3:]))


def _dot(shares: Sequence[Field], coefficients: Sequence[float]) -> Field:
    """Sum of products without the terms whose coefficient is zero."""
    terms = [s * c for s, c in zip(shares, coefficients, strict=True) if c != 0.0]
    return sum(terms[1:], start=terms[0]) if terms else shares[0] * 0.0


def advance(state: AnyState, applied: Wrench, body: MassProperties, duration: Field,
            substeps: int = 1, nodes: int = NODES, disturbance: Wrench | None = None) -> AnyState:
    """The state after the wrench acted for the duration, constant in B.

    Args:
        state: at the start.
        applied: the wrench on B.
        body: mass properties.
        duration: of the whole motion, s.
        substeps: equal parts the motion is computed in. Each part is exact up to quadrature
            rounding in the plane and of order six in space.
        nodes: of the quadrature in the plane; float32 needs only four.
        disturbance: a second wrench, constant in W: an uneven floor, a draught, a tether.
    """
    load, h = _Load(applied, disturbance, body), duration / substeps
    for _ in range(substeps):
        if isinstance(state, PlanarState):
            state = _advance_planar(state, load, h, nodes)
        else:
            state = _advance_spatial(state, load, h)
    return state


@dataclass(frozen=True)
class _Load:
    """What acts on what."""

    thrust: Wrench
    disturbance: Wrench | None
    body: MassProperties


def _advance_planar(state: PlanarState, load: _Load, h: Field, nodes: int) -> PlanarState:
    """With constant torque the heading is an exact quadratic in time; force follows by quadrature.

    v(h) = v + h sum w_i a(s_i h) and p(h) = p + v h + h^2 sum w_i (1 - s_i) a(s_i h), where
    a(t) = R(heading(t)) F_B / m, over the nodes s_i and weights w_i of `_RULES`. A disturbance's force
    does not turn, so its share is exact.
    """
    acceleration = load.thrust.force.scale(1.0 / load.body.mass)
    torque = load.thrust.torque if load.disturbance is None else load.thrust.torque + load.disturbance.torque
    spin_up = torque * (1.0 / load.body.inertia[0])
    speed_cos = speed_sin = way_cos = way_sin = 0.0
    for node, weight in _RULES[nodes]:
        t = node * h
        angle = state.attitude.angle + t * (state.w + (0.5 * t) * spin_up)
        c, s = cos(angle), sin(angle)
        speed_cos, speed_sin = speed_cos + weight * c, speed_sin + weight * s
        way_cos, way_sin = way_cos + (weight * (1 - node)) * c, way_sin + (weight * (1 - node)) * s
    x, y = acceleration.x, acceleration.y
    gained = Vec2(speed_cos * x - speed_sin * y, speed_sin * x + speed_cos * y).scale(h)
    moved = Vec2(way_cos * x - way_sin * y, way_sin * x + way_cos * y).scale(h * h)
    if load.disturbance is not None:
        drift: Any = load.disturbance.force.scale(1.0 / load.body.mass)
        gained, moved = gained + drift.scale(h), moved + drift.scale(0.5 * h * h)
    return PlanarState(
        p=state.p + state.v.scale(h) + moved,
        attitude=Heading(state.attitude.angle + h * (state.w + (0.5 * h) * spin_up)),
        v=state.v + gained,
        w=state.w + h * spin_up,
    )


def _advance_spatial(state: SpatialState, load: _Load, h: Field) -> SpatialState:
    """Spin by its Taylor series, attitude by Magnus' series, translation by quadrature.

    The thrust's acceleration, expressed in B at the start of the step, enters velocity and position as in
    the plane.
    """
    rate = _spin_series(state, load, h)
    rotation, acceleration = Rotation(rate, h), load.thrust.force.scale(1.0 / load.body.mass)
    speed = way = Vec3(0.0, 0.0, 0.0)
    for node, weight in _RULES[_SPATIAL_NODES]:
        push = turned(rotation.vector(node), acceleration)  # type: ignore[arg-type]
        speed, way = speed + push.scale(weight), way + push.scale(weight * (1 - node))
    gained, moved = (state.attitude.rotate(x) for x in (speed.scale(h), way.scale(h * h)))
    if load.disturbance is not None:
        drift: Any = load.disturbance.force.scale(1.0 / load.body.mass)
        gained, moved = gained + drift.scale(h), moved + drift.scale(0.5 * h * h)
    return SpatialState(
        p=state.p + state.v.scale(h) + moved,
        attitude=state.attitude.times(exponential(rotation.vector(1.0))),
        v=state.v + gained,
        w=at(rate, 1.0),
    )


def _spin_series(state: SpatialState, load: _Load, h: Field) -> Series:
    """Taylor series of the angular velocity over the share of h that is gone.

    Euler's equation, I w' = tau - w x (I - I_zz 1) w: a multiple of the unit tensor has no part in
    w x I w, so the series of a body with three equal moments ends after its second term. A torque that is
    constant in W turns in B: u' = u x w.
    """
    xx, xy, xz, yy, yz, zz = load.body.inertia
    excess, inverse = (xx - zz, xy, xz, yy - zz, yz, 0.0), _inverse(load.body.inertia)
    even = all(isinstance(x, float) and x == 0.0 for x in excess)
    turning: list[Any] = []
    if load.disturbance is not None:
        turning.append(state.attitude.conjugate().rotate(load.disturbance.torque))  # type: ignore[arg-type]
    rate, momentum = [state.w], []
    for k in range(1 if even and not turning else _SPIN_ORDER):
        torques: list[Any] = [load.thrust.torque] if k == 0 else []
        if turning:
            torques.append(turning[k])
            turning.append(last_product(turning, rate).scale(h / (k + 1)))
        if not even:
            momentum.append(_symmetric_times(excess, rate[k]))
            torques.append(last_product(momentum, rate))
        rate.append(_symmetric_times(inverse, total(torques)).scale(h / (k + 1)))
    return rate


def _symmetric_times(entries: Sequence[Field], v: Vec3) -> Vec3:
    """Product of a symmetric 3x3 tensor, given by its six entries, with a vector."""
    xx, xy, xz, yy, yz, zz = entries
    return Vec3(
        xx * v.x + xy * v.y + xz * v.z,
        xy * v.x + yy * v.y + yz * v.z,
        xz * v.x + yz * v.y + zz * v.z,
    )


def _inverse(entries: Sequence[Field]) -> tuple[Field, ...]:
    """Inverse of a symmetric 3x3 tensor by cofactors, as its six entries."""
    xx, xy, xz, yy, yz, zz = entries
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    s = 1.0 / (xx * a + xy * b + xz * c)
    return (a * s, b * s, c * s, (xx * zz - xz * xz) * s, (xy * xz - xx * yz) * s,
            (xx * yy - xy * xy) * s)
