"""How a free point moves: what W pulls at every spacecraft with when no thruster does.

Written over fields (`rans.model.fields`). A drift is given by its exact motion, not by its accelerations, so
that the thrust's quadrature stays exact in it (`rans.model.dynamics.advance`).

W may be a turning frame, as that of Clohessy and Wiltshire. In the plane the spin is measured against it,
which is exact. In space the attitude is held against it as if W did not turn: near the Earth (0.001 rad/s)
that neglects 0.025 rad, or 1.4 degrees, in 25 s.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any, ClassVar, TypeVar

from rans.errors import ConfigError, is_finite
from rans.model.fields import Field, Heading, Quat, Vec2, Vec3, at_least, cos, sin, sqrt

AnyVector = TypeVar("AnyVector", Vec2, Vec3)


class Drift(ABC):
    """The motion of a free point."""

    name: ClassVar[str]
    """What messages call it; its parameters are its fields."""
    in_straight_lines: ClassVar[bool]
    """Whether the difference between two free points grows evenly, so that pushes may be summed before they
    are carried. A drift of which this does not hold is linear: it leaves a point at rest at W's origin."""

    @abstractmethod
    def carry(self, p: AnyVector, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """Position (m) and velocity (m/s) in W after a time (s): a number, or a CasADi symbol."""


@dataclass(frozen=True)
class FreeFlight(Drift):
    """Nothing pulls: in free space, or on an even floor."""

    name: ClassVar[str] = "free-flight"
    in_straight_lines: ClassVar[bool] = True

    def carry(self, p: AnyVector, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """Along a straight line."""
        return p + v.scale(t), v


@dataclass(frozen=True)
class UniformGravity(Drift):
    """The same acceleration everywhere: near a surface, or on a tilted floor.

    Raises:
        ConfigError: the acceleration is not two or three finite numbers.
    """

    acceleration: tuple[float, ...]
    """In W, m/s^2: two numbers in the plane, three in space."""
    name: ClassVar[str] = "uniform-gravity"
    in_straight_lines: ClassVar[bool] = True

    def __post_init__(self) -> None:
        given = self.acceleration
        if (
            not isinstance(given, tuple)
            or len(given) not in (2, 3)
            or not all(map(is_finite, given))
        ):
            raise ConfigError(
                "the acceleration of uniform gravity must be two (plane) or three (space) "
                f"finite numbers in m/s^2, got {given!r}."
            )

    def carry(self, p: AnyVector, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """Along a parabola.

        Raises:
            ConfigError: the acceleration is of the other dimension.
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
    """Near a target on a circular orbit: W is its Hill frame, x radial outwards, y along the track, z across.

    x'' = 3 n^2 x + 2 n y', y'' = -2 n x', z'' = -n^2 z, to first order in the distance over the orbit's
    radius; the plane has x and y. Source: W. H. Clohessy and R. S. Wiltshire, "Terminal guidance system for
    satellite rendezvous", Journal of the Aerospace Sciences 27(9), 1960.

    Raises:
        ConfigError: the mean motion is not a finite number > 0.
    """

    mean_motion: float
    """n, rad/s: 0.00113 at 400 km above the Earth."""
    name: ClassVar[str] = "clohessy-wiltshire"
    in_straight_lines: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if not is_finite(self.mean_motion) or self.mean_motion <= 0:
            raise ConfigError(
                "the mean motion of a Clohessy-Wiltshire frame must be a finite number > 0 "
                f"rad/s, got {self.mean_motion!r}; without an orbit it is free flight."
            )

    def carry(self, p: AnyVector, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """Along the closed form, without 1 - cos, which would lose digits in short times."""
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
    """A plain number of a plain number: NumPy's own would make float64 of float32 arrays."""
    return float(sin(angle)) if isinstance(angle, float) else sin(angle)


def velocity_to_reach(drift: Drift, p: AnyVector, target: AnyVector, time: Field) -> AnyVector:
    """Velocity (m/s) with which a free point is at a target after a time: Lambert's problem in a drift.

    Drifts are affine in position and velocity, so that it is one linear system. In a Clohessy-Wiltshire frame
    of mean motion n it has no solution after n t = pi, across the orbit, and after n t = 2 pi.

    Args:
        drift: what pulls.
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
    """A goal that nothing pushes, after a duration (s), exactly: it drifts as spacecraft do, its spin stays.

    Its angular velocity is constant in its own frame, as of a body with equal moments.
    """
    p, v = drift.carry(goal.p, goal.v, duration)
    if isinstance(goal.attitude, Heading):
        return replace(goal, p=p, attitude=Heading(goal.attitude.angle + duration * goal.w), v=v)
    rate = sqrt(goal.w.dot(goal.w))
    half = 0.5 * duration * rate
    axis = goal.w.scale(sin(half) / at_least(rate, 1e-30))  # a goal that does not turn has no axis
    return replace(goal, p=p, attitude=goal.attitude.times(Quat(cos(half), *axis.columns())), v=v)
