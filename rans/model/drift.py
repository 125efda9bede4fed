"""Drift: motion of a free point in W, to which no thruster contributes.

Written over fields (`rans.model.fields`). A drift is defined by its exact motion instead of its accelerations,
so that the quadrature of the thrust stays exact (`rans.model.dynamics.advance`).

W may be a rotating frame, such as that of Clohessy and Wiltshire. In the plane the spin is relative to it,
which is exact. In space the rotation of W is neglected in the attitude: near the Earth (0.001 rad/s) this
neglects 0.025 rad, or 1.4 degrees, in 25 s.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any, ClassVar, TypeVar

from rans.errors import ConfigError, is_finite
from rans.model.fields import Field, Heading, Quat, Vec2, Vec3, at_least, cos, sin, sqrt

AnyVector = TypeVar("AnyVector", Vec2, Vec3)


class Drift(ABC):
    """Motion of a free point; its parameters are the fields of the dataclass."""

    name: ClassVar[str]
    """Name in messages."""
    in_straight_lines: ClassVar[bool]
    """Whether the difference between two free points grows linearly in time, so that velocity changes may be
    summed before they are propagated. Any other drift must be linear: a point at rest at W's origin stays there."""

    @abstractmethod
    def carry(self, p: AnyVector, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """Position (m) and velocity (m/s) in W after a time t (s), a number or a CasADi symbol."""


@dataclass(frozen=True)
class FreeFlight(Drift):
    """No acceleration: free space, or a level floor."""

    name: ClassVar[str] = "free-flight"
    in_straight_lines: ClassVar[bool] = True

    def carry(self, p: AnyVector, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """Position and velocity after a time t (s) on a straight line."""
        return p + v.scale(t), v


@dataclass(frozen=True)
class UniformGravity(Drift):
    """Uniform acceleration, as near a surface or on a tilted floor.

    Raises:
        ConfigError: the acceleration is not two or three finite numbers.
    """

    acceleration: tuple[float, ...]
    """Acceleration in W, m/s^2: two numbers in the plane, three in space."""
    name: ClassVar[str] = "uniform-gravity"
    in_straight_lines: ClassVar[bool] = True

    def __post_init__(self) -> None:
        acceleration = self.acceleration
        if (
            not isinstance(acceleration, tuple)
            or len(acceleration) not in (2, 3)
            or not all(map(is_finite, acceleration))
        ):
            raise ConfigError(
                "the acceleration of uniform gravity must be two (plane) or three (space) "
                f"finite numbers in m/s^2, got {acceleration!r}."
            )

    def carry(self, p: AnyVector, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """Position and velocity after a time t (s) on a parabola.

        Raises:
            ConfigError: the acceleration has another dimension than the position.
        """
        if len(self.acceleration) != len(p.columns()):
            raise ConfigError(
                f"uniform gravity of {len(self.acceleration)} components, {self.acceleration}, "
                f"does not fit a spacecraft of dimension {len(p.columns())}."
            )
        g = type(p)(*self.acceleration)
        return p + v.scale(t) + g.scale(0.5 * t * t), v + g.scale(t)


@dataclass(frozen=True)
class ClohessyWiltshire(Drift):
    """Relative motion near a target on a circular orbit (Clohessy-Wiltshire equations).

    W is the Hill frame of the target: x radially outwards, y along the track, z across it. To first order in the
    distance over the radius of the orbit, x'' = 3 n^2 x + 2 n y', y'' = -2 n x', z'' = -n^2 z; the plane has x
    and y. Source: W. H. Clohessy and R. S. Wiltshire, "Terminal guidance system for satellite rendezvous",
    Journal of the Aerospace Sciences 27(9), 1960.

    Raises:
        ConfigError: the mean motion is not a finite number > 0.
    """

    mean_motion: float
    """Mean motion n, rad/s: 0.00113 at 400 km above the Earth."""
    name: ClassVar[str] = "clohessy-wiltshire"
    in_straight_lines: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if not is_finite(self.mean_motion) or self.mean_motion <= 0:
            raise ConfigError(
                "the mean motion of a Clohessy-Wiltshire frame must be a finite number > 0 "
                f"rad/s, got {self.mean_motion!r}; without an orbit, use free flight."
            )

    def carry(self, p: AnyVector, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """Position and velocity after a time t (s), in closed form.

        1 - cos(n t) is computed as 2 sin(n t / 2)^2, which keeps its digits at short times.
        """
        n = self.mean_motion
        s = _sine(n * t)
        half = _sine(0.5 * n * t)
        rise = 2.0 * half * half
        """1 - cos(n t)."""
        x = p.x * (1.0 + 3.0 * rise) + v.x * (s / n) + v.y * (2.0 * rise / n)
        y = p.y + p.x * (6.0 * (s - n * t)) - v.x * (2.0 * rise / n) + v.y * (4.0 * s / n - 3.0 * t)
        v_x = p.x * (3.0 * n * s) + v.x * (1.0 - rise) + v.y * (2.0 * s)
        v_y = v.y * (1.0 - 4.0 * rise) - p.x * (6.0 * n * rise) - v.x * (2.0 * s)
        if isinstance(p, Vec2) or isinstance(v, Vec2):
            return Vec2(x, y), Vec2(v_x, v_y)
        z = p.z * (1.0 - rise) + v.z * (s / n)
        v_z = v.z * (1.0 - rise) - p.z * (n * s)
        return Vec3(x, y, z), Vec3(v_x, v_y, v_z)


FREE = FreeFlight()


def _sine(angle: Field) -> Field:
    """Sine that is a Python float for a Python float; NumPy's scalar would turn float32 arrays into float64."""
    return math.sin(angle) if isinstance(angle, float) else sin(angle)


def velocity_to_reach(drift: Drift, p: AnyVector, target: AnyVector, time: Field) -> AnyVector:
    """Velocity (m/s) with which a free point reaches a target after a time: Lambert's problem in a drift.

    Drifts are affine in position and velocity, so this is one linear system. In a Clohessy-Wiltshire frame of
    mean motion n it has no solution at n t = pi (across the orbit) and at n t = 2 pi.

    Args:
        drift: motion of a free point.
        p: position in W, m.
        target: position in W after the time, m.
        time: time, s; more than zero.
    """
    zero = type(p)(*(0.0 for _ in p.columns()))
    axes = range(len(p.columns()))
    units = [type(p)(*(float(i == k) for i in axes)) for k in axes]
    begun, _ = drift.carry(zero, zero, time)
    reach: Any = [drift.carry(zero, unit, time)[0] - begun for unit in units]
    missing = target - drift.carry(p, zero, time)[0]
    # Cramer's rule.
    if isinstance(missing, Vec2):
        a, b = reach
        scale = 1.0 / (a.x * b.y - a.y * b.x)
        return Vec2(
            (missing.x * b.y - missing.y * b.x) * scale, (a.x * missing.y - a.y * missing.x) * scale
        )
    a, b, c = reach
    across = b.cross(c)
    scale = 1.0 / a.dot(across)
    return Vec3(
        missing.dot(across) * scale,
        missing.dot(c.cross(a)) * scale,
        missing.dot(a.cross(b)) * scale,
    )


def step_goal(goal: Any, drift: Drift, duration: Field) -> Any:
    """Goal after a duration (s) of free motion, exactly: it drifts as spacecraft do and keeps its spin.

    Its angular velocity is constant in its own frame, as that of a body with equal moments of inertia.
    """
    p, v = drift.carry(goal.p, goal.v, duration)
    if isinstance(goal.attitude, Heading):
        return replace(goal, p=p, attitude=Heading(goal.attitude.angle + duration * goal.w), v=v)
    rate = sqrt(goal.w.dot(goal.w))
    half = 0.5 * duration * rate
    axis = goal.w.scale(sin(half) / at_least(rate, 1e-30))  # no axis without a rotation
    return replace(goal, p=p, attitude=goal.attitude.times(Quat(cos(half), *axis.columns())), v=v)
