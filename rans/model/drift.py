"""Drift: motion of a free point in W, to which no thruster contributes.

Written over fields (`rans.model.fields`). A drift is defined by its exact motion instead of its accelerations,
so that the quadrature of the thrust stays exact (`rans.model.dynamics.advance`).

W may be a rotating frame, such as that of Clohessy and Wiltshire (`Drift.turn`, `Drift.rate`). Attitude and spin
are relative to it, as position and velocity are: a craft without spin turns with W.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar, TypeVar

from rans.base.errors import ConfigError, is_finite
from rans.model.fields import (
    Field,
    Heading,
    Quat,
    Vec2,
    Vec3,
    at_least,
    atan2,
    cos,
    sin,
    sqrt,
)

AnyVector = TypeVar("AnyVector", Vec2, Vec3)


class Drift(ABC):
    """Motion of a free point; its parameters are the fields of the dataclass.

    Derive a frozen dataclass with `name`, `in_straight_lines` and `carry`; where W turns with `turn` and `rate`,
    and where the motion depends on when it begins with `steady` and `later`. A task's `drift` returns one. Drake
    needs a half of its own (`rans.reference.frames.DrakeFrame`).
    """

    name: ClassVar[str]
    """Name in messages."""
    in_straight_lines: ClassVar[bool]
    """Whether the difference between two free points grows linearly in time, so that velocity changes may be
    summed before they are propagated. Any other drift is affine: `kicked` is the linear part of `carry`."""
    steady: ClassVar[bool] = True
    """Whether the motion over a time is the same whenever it begins; other drifts override `later`."""

    def later(self, t: Field) -> Drift:
        """The drift of a motion that begins a time t (s) later."""
        return self

    @abstractmethod
    def carry(self, p: AnyVector, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """Position (m) and velocity (m/s) in W after a time t (s), a number or a CasADi symbol."""

    def kicked(self, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """Change of a motion by a velocity change v (m/s) a time t (s) ago: if linear, `carry` from W's origin."""
        return self.carry(v.scale(0.0), v, t)

    def turn(self, t: Field) -> Quat | None:
        """Attitude of W after a time t (s) in the axes that it has now; None: W does not turn."""
        return None

    def rate(self) -> Vec3 | None:
        """Angular velocity of W now in its own axes, rad/s; None: W does not turn."""
        return None

    def gradient(self) -> Field | None:
        """Gravitational parameter over the cube of the planet's distance now, 1/s^2; None: gravity turns no craft.

        The planet lies along -x of W.
        """
        return None


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
        """Position (m) and velocity (m/s), vectors of fields, after a time t (s) on a parabola.

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
    gravity_gradient: bool = False
    """Whether the gradient of gravity turns craft in space."""
    name: ClassVar[str] = "clohessy-wiltshire"
    in_straight_lines: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if not is_finite(self.mean_motion) or self.mean_motion <= 0:
            raise ConfigError(
                "the mean motion of a Clohessy-Wiltshire frame must be a finite number > 0 "
                f"rad/s, got {self.mean_motion!r}; without an orbit, use free flight."
            )

    def carry(self, p: AnyVector, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """Position and velocity, vectors of fields, after a time t (s), in closed form.

        1 - cos(n t) is computed as 2 sin(n t / 2)^2, which keeps its digits at short times.
        """
        n = self.mean_motion
        s, rise, by_s, by_rise, along = self._transition(t, v.x)
        x = p.x * (1.0 + 3.0 * rise) + v.x * by_s + v.y * by_rise
        y = p.y + p.x * (6.0 * (s - n * t)) - v.x * by_rise + v.y * along
        v_x = p.x * (3.0 * n * s) + v.x * (1.0 - rise) + v.y * (2.0 * s)
        v_y = v.y * (1.0 - 4.0 * rise) - p.x * (6.0 * n * rise) - v.x * (2.0 * s)
        if isinstance(p, Vec2) or isinstance(v, Vec2):
            return Vec2(x, y), Vec2(v_x, v_y)  # pyrefly: ignore[bad-return]
        z = p.z * (1.0 - rise) + v.z * by_s
        v_z = v.z * (1.0 - rise) - p.z * (n * s)
        return Vec3(x, y, z), Vec3(v_x, v_y, v_z)  # pyrefly: ignore[bad-return]

    def kicked(self, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """As `carry` from W's origin with a velocity v (m/s) and without its terms of the position; t in s."""
        s, rise, by_s, by_rise, along = self._transition(t, v.x)
        x = v.x * by_s + v.y * by_rise
        y = v.y * along - v.x * by_rise
        v_x = v.x * (1.0 - rise) + v.y * (2.0 * s)
        v_y = v.y * (1.0 - 4.0 * rise) - v.x * (2.0 * s)
        if isinstance(v, Vec2):
            return Vec2(x, y), Vec2(v_x, v_y)  # pyrefly: ignore[bad-return]
        return Vec3(x, y, v.z * by_s), Vec3(v_x, v_y, v.z * (1.0 - rise))  # pyrefly: ignore[bad-return]

    def turn(self, t: Field) -> Quat:
        """Rotation about z by n t."""
        half = 0.5 * self.mean_motion * t
        return Quat(cos(half), 0.0, 0.0, sin(half))

    def rate(self) -> Vec3:
        """Angular velocity n about z, rad/s."""
        return Vec3(0.0, 0.0, self.mean_motion)

    def gradient(self) -> Field | None:
        """Square of n, 1/s^2."""
        return self.mean_motion**2 if self.gravity_gradient else None

    def _transition(self, t: Field, v: Field) -> tuple[Field, Field, Field, Field, Field]:
        """Coefficients of the motion of fields such as v over a time t (s); those of a number are computed once."""
        # The compiler of torch warns of what remembers results, and computes numbers once by itself.
        if type(t) is float and not type(v).__module__.startswith("torch"):
            return _remembered_transition(self.mean_motion, t)
        return _transition(self.mean_motion, t)


@dataclass(frozen=True)
class Following(Drift):
    """A drift for craft of which some follow W: something that is not modelled holds their attitude in it."""

    drift: Drift
    """Motion of a free point."""
    free: Field
    """1 for craft that W does not turn, 0 for those that follow it."""
    name: ClassVar[str] = "orbit"
    in_straight_lines: ClassVar[bool] = False
    steady: ClassVar[bool] = False

    def later(self, t: Field) -> Following:
        """The drift of a motion that begins a time t (s) later."""
        return replace(self, drift=self.drift.later(t))

    def carry(self, p: AnyVector, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """Position and velocity after a time t (s)."""
        return self.drift.carry(p, v, t)

    def kicked(self, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """Change of a motion by a velocity change v (m/s) a time t (s) ago, at its start."""
        return self.drift.kicked(v, t)

    def turn(self, t: Field) -> Quat | None:
        """Attitude of W after a time t (s) as a free craft sees it."""
        turn = self.drift.turn(t)
        if turn is None:
            return None
        x, y, z = (q * self.free for q in (turn.x, turn.y, turn.z))
        return Quat(1.0 - (1.0 - turn.w) * self.free, x, y, z)

    def rate(self) -> Vec3 | None:
        """Angular velocity of W now, rad/s, as a free craft sees it."""
        rate = self.drift.rate()
        return None if rate is None else rate.scale(self.free)


def _transition(n: float, t: Field) -> tuple[Field, Field, Field, Field, Field]:
    """sin(n t), 1 - cos(n t), and the coefficients of a velocity in a position, s; see `ClohessyWiltshire`."""
    s = sin(n * t)
    half = sin(0.5 * n * t)
    rise = 2.0 * half * half
    return s, rise, s / n, 2.0 * rise / n, 4.0 * s / n - 3.0 * t


_remembered_transition = lru_cache(maxsize=1024)(_transition)
"""A flight has few lengths of steps."""
FREE = FreeFlight()


def steady(drift: Drift, purpose: str) -> Drift:
    """A drift whose motion over a time is the same whenever it begins.

    Args:
        drift: drift.
        purpose: what asks for it, such as "an LQR has gains"; it begins the message.

    Raises:
        ConfigError: the drift depends on when a motion begins.
    """
    if drift.steady:
        return drift
    raise ConfigError(
        f"{purpose} for a drift that is the same at all times, and {drift.name} changes along the orbit; fly a "
        "circular orbit, or mission guidance without conditions."
    )


def arctangent(y: Field, x: Field) -> Field:
    """Angle of the point (x, y), rad, which is a Python float for Python floats."""
    return math.atan2(y, x) if isinstance(y, float) else atan2(y, x)


def step_goal(goal: Any, drift: Drift, duration: Field) -> Any:
    """Goal after a duration (s) of free motion, exactly: it drifts as spacecraft do and keeps its spin.

    Its angular velocity relative to W is constant in its own frame, as that of a body with equal moments of inertia
    where W does not turn. A goal without spin turns with W.
    """
    p, v = drift.carry(goal.p, goal.v, duration)
    if isinstance(goal.attitude, Heading):
        return replace(goal, p=p, attitude=Heading(goal.attitude.angle + duration * goal.w), v=v)
    rate = sqrt(goal.w.dot(goal.w))
    half = 0.5 * duration * rate
    axis = goal.w.scale(sin(half) / at_least(rate, 1e-30))  # no axis without a rotation
    return replace(goal, p=p, attitude=goal.attitude.times(Quat(cos(half), *axis.columns())), v=v)
