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

import numpy as np

from rans.errors import ConfigError, is_finite
from rans.model.fields import (
    Field,
    Heading,
    Quat,
    Vec2,
    Vec3,
    at_least,
    atan2,
    cos,
    floor,
    sin,
    sqrt,
)

AnyVector = TypeVar("AnyVector", Vec2, Vec3)

EARTH = 3.986004418e14
"""Gravitational parameter of the Earth, m^3/s^2 (IERS Conventions 2010)."""
MOST_ECCENTRIC = 0.9
"""Largest eccentricity of an orbit: that of a transfer to geostationary orbit is 0.73, of a Molniya orbit 0.74."""
J2 = 1.08262668e-3
"""Oblateness of the Earth's gravity, without a unit (EGM96)."""
EARTH_RADIUS = 6.378137e6
"""Equatorial radius of the Earth, m (WGS 84)."""
_HALLEY_STEPS = 3
"""Steps that solve Kepler's equation to rounding up to an eccentricity of 0.95."""
_OBLATE_NODES = 6
"""Nodes that integrate oblateness: in half an orbit its fourth harmonic turns by 12.6 rad, and the error is 0.6 %
of what this harmonic does, as much as the second order in oblateness; in a quarter it is 0.0001 %."""
_SHORT_NODES = 2
"""Nodes for times in which the target turns by less than `_SHORT_ANGLE`: the error is 1e-9 of the effect."""
_SHORT_ANGLE = 0.0125
"""rad, 12 s of a low orbit: four times as much, to the fourth power, over 4320, is the error of two nodes."""


class Drift(ABC):
    """Motion of a free point; its parameters are the fields of the dataclass."""

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
        """Position and velocity after a time t (s), in closed form.

        1 - cos(n t) is computed as 2 sin(n t / 2)^2, which keeps its digits at short times.
        """
        n = self.mean_motion
        s, rise, by_s, by_rise, along = self._transition(t, v.x)
        x = p.x * (1.0 + 3.0 * rise) + v.x * by_s + v.y * by_rise
        y = p.y + p.x * (6.0 * (s - n * t)) - v.x * by_rise + v.y * along
        v_x = p.x * (3.0 * n * s) + v.x * (1.0 - rise) + v.y * (2.0 * s)
        v_y = v.y * (1.0 - 4.0 * rise) - p.x * (6.0 * n * rise) - v.x * (2.0 * s)
        if isinstance(p, Vec2) or isinstance(v, Vec2):
            return Vec2(x, y), Vec2(v_x, v_y)
        z = p.z * (1.0 - rise) + v.z * by_s
        v_z = v.z * (1.0 - rise) - p.z * (n * s)
        return Vec3(x, y, z), Vec3(v_x, v_y, v_z)

    def kicked(self, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """As `carry` from W's origin, without its terms of the position."""
        s, rise, by_s, by_rise, along = self._transition(t, v.x)
        x = v.x * by_s + v.y * by_rise
        y = v.y * along - v.x * by_rise
        v_x = v.x * (1.0 - rise) + v.y * (2.0 * s)
        v_y = v.y * (1.0 - 4.0 * rise) - v.x * (2.0 * s)
        if isinstance(v, Vec2):
            return Vec2(x, y), Vec2(v_x, v_y)
        return Vec3(x, y, v.z * by_s), Vec3(v_x, v_y, v.z * (1.0 - rise))

    def turn(self, t: Field) -> Quat:
        """Rotation about z by n t."""
        half = 0.5 * self.mean_motion * t
        return Quat(_cosine(half), 0.0, 0.0, _sine(half))

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
class EllipticOrbit(Drift):
    """Relative motion near a target on an elliptic orbit (Tschauner-Hempel equations), in closed form.

    W turns with the line from the planet to the target: x radially outwards, y along the track, z across it. To
    first order in the distance over the radius r of the orbit, with the angular velocity w of that line and the
    planet's gravitational parameter mu,

        x'' = (w^2 + 2 mu / r^3) x + w' y + 2 w y',  y'' = (w^2 - mu / r^3) y - w' x - 2 w x',  z'' = -(mu / r^3) z.

    The solution is the state transition of K. Yamanaka and F. Ankersen, "New state transition matrix for relative
    motion on an arbitrary elliptical orbit", Journal of Guidance, Control, and Dynamics 25(1), 2002. With an
    eccentricity of zero it is that of `ClohessyWiltshire`.

    >>> from rans.model.drift import EllipticOrbit
    >>> orbit = EllipticOrbit(mean_motion=0.001027, eccentricity=0.1, mean_anomaly=0.0)
    >>> orbit.later(1000.0).mean_anomaly
    1.027

    Raises:
        ConfigError: the mean motion is not a finite number > 0, or the eccentricity is not from 0 to 0.9.
    """

    mean_motion: float
    """Mean motion n, rad/s: the square root of mu / a^3 for a semi-major axis a."""
    eccentricity: float
    """Eccentricity e, from 0 (circle) to `MOST_ECCENTRIC`."""
    mean_anomaly: Field
    """Mean anomaly of the target at the start of a motion, rad: n times the time since its periapsis."""
    gravity_gradient: bool = False
    """Whether the gradient of gravity turns craft in space."""
    name: ClassVar[str] = "elliptic-orbit"
    in_straight_lines: ClassVar[bool] = False
    steady: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if not is_finite(self.mean_motion) or self.mean_motion <= 0:
            raise ConfigError(
                "the mean motion of an elliptic orbit must be a finite number > 0 rad/s, got "
                f"{self.mean_motion!r}."
            )
        if not is_finite(self.eccentricity) or not 0.0 <= self.eccentricity <= MOST_ECCENTRIC:
            raise ConfigError(
                f"the eccentricity of an orbit must be from 0 to {MOST_ECCENTRIC}, got {self.eccentricity!r}."
            )

    def later(self, t: Field) -> EllipticOrbit:
        """The drift of a motion that begins a time t (s) later."""
        return replace(self, mean_anomaly=self.mean_anomaly + self.mean_motion * t)

    def carry(self, p: AnyVector, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """Position and velocity after a time t (s).

        Changes over the time are computed from half the angle that is passed, which keeps their digits at short
        times. In the names, 0 is the start, 1 the end, and m halfway in angle.
        """
        n = self.mean_motion
        e = self.eccentricity
        eta = math.sqrt(1.0 - e * e)
        sin_0, cos_0, sin_h, cos_h = self._passed(t)
        sin_m = sin_0 * cos_h + cos_0 * sin_h
        cos_m = cos_0 * cos_h - sin_0 * sin_h
        sin_1 = sin_m * cos_h + cos_m * sin_h
        cos_1 = cos_m * cos_h - sin_m * sin_h

        # The functions of the true anomaly f of which the solution consists, with rho = 1 + e cos f:
        # s = rho sin f and c = rho cos f, their derivatives in f at the start and changes of all of them.
        rho_0 = 1.0 + e * cos_0
        rho_1 = 1.0 + e * cos_1
        s_0 = rho_0 * sin_0
        c_0 = rho_0 * cos_0
        s_1 = rho_1 * sin_1
        rise_1 = cos_1 + e * (cos_1 * cos_1 - sin_1 * sin_1)
        passed = 2.0 * sin_h * cos_h
        d_sin = 2.0 * cos_m * sin_h
        d_cos = -2.0 * sin_m * sin_h
        twice_sin = 2.0 * sin_m * cos_m
        twice_cos = cos_m * cos_m - sin_m * sin_m
        d_s = d_sin + e * twice_cos * passed
        d_c = d_cos - e * twice_sin * passed
        d_rise = d_cos - 2.0 * e * twice_sin * passed
        d_fall = -d_sin - 2.0 * e * twice_cos * passed

        # From positions and velocities to rho times the position and its derivative in f; the rate of f is
        # k rho^2 with k = n / eta^3.
        k = n / (eta * eta * eta)
        into = 1.0 / (k * rho_0)
        x = p.x * rho_0
        y = p.y * rho_0
        x_rate = v.x * into - p.x * (e * sin_0)
        y_rate = v.y * into - p.y * (e * sin_0)

        # Constants of the motion in the plane of the orbit, named after what they multiply.
        inverse = 1.0 / (eta * eta)
        both = 1.0 + 1.0 / rho_0
        of_s = x_rate * (c_0 - 2.0 * e) - y_rate * (s_0 * both)
        of_s = (of_s - x * (3.0 * (s_0 / rho_0) * (1.0 + e * e / rho_0))) * inverse
        of_c = x * (3.0 * (c_0 / rho_0 + e)) + y_rate * (c_0 * both + e) + x_rate * s_0
        of_c = of_c * (0.0 - inverse)
        secular = x * (3.0 * rho_0 + e * e - 1.0) + y_rate * (rho_0 * rho_0) + x_rate * (e * s_0)
        secular = secular * inverse

        # The end. `gone` is k times the time.
        gone = k * t
        ratio = (d_sin + e * passed) / (rho_0 * rho_1)
        swing = of_s * d_s + of_c * d_c
        x_1 = x + swing - secular * (3.0 * e * s_1 * gone)
        y_1 = y + of_s * (d_c + d_cos) - of_c * (d_s + d_sin)
        y_1 = y_1 - secular * (3.0 * rho_1 * rho_1 * gone)
        x_rate_1 = x_rate + of_s * d_rise + of_c * d_fall
        x_rate_1 = x_rate_1 - secular * (3.0 * e * (rise_1 * gone + ratio))
        y_rate_1 = y_rate - 2.0 * swing + secular * (6.0 * e * s_1 * gone)

        # Back from f to time.
        back = 1.0 / rho_1
        turn = k * e * sin_1
        speed = k * rho_1
        ends = [(x_1, x_rate_1), (y_1, y_rate_1)]
        if not (isinstance(p, Vec2) or isinstance(v, Vec2)):
            # Across the plane of the orbit.
            z = p.z * rho_0
            z_rate = v.z * into - p.z * (e * sin_0)
            fall = 2.0 * sin_h * sin_h
            ends.append((z + z_rate * passed - z * fall, z_rate - z * passed - z_rate * fall))
        vector = type(p)
        return (
            vector(*(q * back for q, _ in ends)),
            vector(*(rate * speed + q * turn for q, rate in ends)),
        )

    def turn(self, t: Field) -> Quat:
        """Rotation about z by the change of the true anomaly."""
        *_, sin_h, cos_h = self._passed(t)
        return Quat(cos_h, 0.0, 0.0, sin_h)

    def rate(self) -> Vec3:
        """Angular velocity of the line to the target, n sqrt(1 - e^2) (a / r)^2 about z, rad/s."""
        e = self.eccentricity
        r = self._radius()
        return Vec3(0.0, 0.0, self.mean_motion * math.sqrt(1.0 - e * e) / (r * r))

    def gradient(self) -> Field | None:
        """n^2 (a / r)^3, 1/s^2."""
        if not self.gravity_gradient:
            return None
        r = self._radius()
        return self.mean_motion**2 / (r * r * r)

    def _radius(self) -> Field:
        """Distance of the target from the planet now, over the semi-major axis."""
        e = self.eccentricity
        return 1.0 - e * _cosine(eccentric_anomaly(self.mean_anomaly, e))

    def _passed(self, t: Field) -> tuple[Field, Field, Field, Field]:
        """Sine and cosine of the true anomaly at the start, and of half of its change over a time t (s)."""
        n = self.mean_motion
        e = self.eccentricity
        eta = math.sqrt(1.0 - e * e)

        # Eccentric anomaly at the start, and its change until the end: first the difference of two solutions of
        # Kepler's equation, then one step of Newton with the equation of the change itself.
        anomaly = eccentric_anomaly(self.mean_anomaly, e)
        end = eccentric_anomaly(self.mean_anomaly + n * t, e)
        half = (end - anomaly) * 0.5
        middle = anomaly + half
        short = (2.0 * half - 2.0 * e * _cosine(middle) * _sine(half)) - n * t
        half = half - 0.5 * short / (1.0 - e * _cosine(anomaly + 2.0 * half))
        middle = anomaly + half

        # Radii over the semi-major axis; sine and cosine of the true anomaly and of half of its change.
        r_0 = 1.0 - e * _cosine(anomaly)
        r_1 = 1.0 - e * _cosine(anomaly + 2.0 * half)
        sin_0 = eta * _sine(anomaly) / r_0
        cos_0 = (_cosine(anomaly) - e) / r_0
        scale = 1.0 / _root(r_0 * r_1)
        sin_h = eta * _sine(half) * scale
        cos_h = (_cosine(half) - e * _cosine(middle)) * scale
        return sin_0, cos_0, sin_h, cos_h


@dataclass(frozen=True)
class PerturbedOrbit(Drift):
    """Relative motion near a target on a nearly circular orbit around an oblate planet, with drag.

    The planet's oblateness (the term J2 of its gravity) changes the orbit of the target and pulls craft and target
    differently. The target is on the orbit that is nearest to a circle: with the argument of latitude u, the
    inclination i, the mean radius a and k = 3/2 J2 (R / a)^2, its radius is r = a (1 + k/6 sin(i)^2 cos 2u). W
    turns with the target, x radially outwards and z along its angular momentum, with the angular velocity

        n (-k sin(2i) sin u,  0,  1 + k/2 (1 - 3/2 sin(i)^2) + k/6 sin(i)^2 cos 2u).

    These pseudo-forces and the gradient of gravity are linear in the distance, and of the first order in k. A
    motion is that of `ClohessyWiltshire` and its first change by k, integrated by a rule of Gauss that is for at
    most half an orbit. What is left out is of the order of (k n t)^2: by then 1e-4 of the distance. Drag is a
    constant acceleration of the craft relative to the target, along -y.

    Source of the equations: S. A. Schweighart and R. J. Sedwick, "High-fidelity linearized J2 model for satellite
    formation flight", Journal of Guidance, Control, and Dynamics 25(6), 2002. Its mean over an orbit is not taken
    here: in less than an orbit the part that changes with u is as large.

    >>> import math
    >>> from rans.model.drift import PerturbedOrbit
    >>> orbit = PerturbedOrbit.around_earth(0.0011068, math.radians(51.6), drag=4e-7)
    >>> round(orbit.oblateness, 6)
    0.001396

    In the plane the motion across it is left out.

    Raises:
        ConfigError: the mean motion is not a finite number > 0, or oblateness, inclination or drag are not finite.
    """

    mean_motion: float
    """Mean motion n, rad/s: the square root of mu / a^3 for the mean radius a."""
    oblateness: float
    """k = 3/2 J2 (R / a)^2; 0: a sphere."""
    inclination: float
    """Inclination of the orbit, rad."""
    drag: float
    """Drag of the craft minus that of the target per mass, m/s^2; above 0 the craft is slowed down more."""
    latitude: Field
    """Argument of latitude of the target at the start of a motion, rad: its angle from the ascending node."""
    name: ClassVar[str] = "perturbed-orbit"
    in_straight_lines: ClassVar[bool] = False
    steady: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if not is_finite(self.mean_motion) or self.mean_motion <= 0:
            raise ConfigError(
                f"the mean motion of an orbit must be a finite number > 0 rad/s, got {self.mean_motion!r}."
            )
        for name in ("oblateness", "inclination", "drag"):
            value = getattr(self, name)
            if not is_finite(value):
                raise ConfigError(f"the {name} of an orbit must be a finite number, got {value!r}.")

    @classmethod
    def around_earth(
        cls, mean_motion: float, inclination: float, drag: float = 0.0, latitude: Field = 0.0
    ) -> PerturbedOrbit:
        """The orbit around the oblate Earth with a mean motion, rad/s, and an inclination, rad."""
        square = (EARTH_RADIUS / math.cbrt(EARTH / mean_motion**2)) ** 2
        return cls(mean_motion, 1.5 * J2 * square, inclination, drag, latitude)

    @property
    def latitude_rate(self) -> float:
        """Mean rate of the argument of latitude, rad/s: that of W, and of the node, which moves backwards."""
        s, c = math.sin(self.inclination), math.cos(self.inclination)
        return self.mean_motion * (1.0 + self.oblateness * (0.5 - 0.75 * s * s + c * c))

    def later(self, t: Field) -> PerturbedOrbit:
        """The drift of a motion that begins a time t (s) later."""
        return replace(self, latitude=self.latitude + self.latitude_rate * t)

    def carry(self, p: AnyVector, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """Position and velocity after a time t (s)."""
        p_1, v_1 = self._linear(p, v, t)
        if not self.drag:
            return p_1, v_1
        # Constant acceleration along the track; see `ClohessyWiltshire` for the digits at short times.
        n = self.mean_motion
        s, rise, *_ = _transition(n, t)
        x = (n * t - s) * (2.0 / (n * n))
        y = rise * (4.0 / (n * n)) - 1.5 * t * t
        pushed = (x, y), (rise * (2.0 / n), s * (4.0 / n) - 3.0 * t)
        zeros = (0.0,) * (len(p.columns()) - 2)
        vector = type(p)
        p_2, v_2 = (vector(*plane, *zeros).scale(-self.drag) for plane in pushed)
        return p_1 + p_2, v_1 + v_2

    def kicked(self, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """Change of a motion by a velocity change v (m/s) a time t (s) ago, at its start."""
        return self._linear(v.scale(0.0), v, t)

    def turn(self, t: Field) -> Quat:
        """Rotation about z, and a tilt that is exact to the first order in k.

        With the argument of latitude u in the middle and half of its change a, the rotation vector in the axes that
        W has in the middle is -k sin(2i) (n / u') (sin u (a + sin(2a) / 2), cos u (a - sin(2a) / 2), 0). Its halves
        in the quaternion are the same in the axes at the start, because both halves of the rotation about z meet.
        """
        faster = self.mean_motion / self.latitude_rate
        a = 0.5 * self.latitude_rate * t
        u = self.latitude + a
        s = _sine(u)
        c = _cosine(u)
        swing = 0.5 * _sine(2.0 * a)
        tilt = math.sin(self.inclination) ** 2
        mean = self.mean_motion * (1.0 + 0.5 * self.oblateness * (1.0 - 1.5 * tilt))
        uneven = (self.oblateness * faster * tilt / 6.0) * (1.0 - 2.0 * s * s) * swing
        half = 0.5 * mean * t + uneven
        across = -0.5 * self.oblateness * faster * math.sin(2.0 * self.inclination)
        x = across * s * (a + swing)
        y = across * c * (a - swing)
        rest = 1.0 - 0.5 * (x * x + y * y)
        return Quat(_cosine(half) * rest, x, y, _sine(half) * rest)

    def rate(self) -> Vec3:
        """Angular velocity of W, rad/s, as in the description of the class."""
        n, k = self.mean_motion, self.oblateness
        tilt = math.sin(self.inclination) ** 2
        s = _sine(self.latitude)
        uneven = (1.0 - 2.0 * s * s) * (n * k * tilt / 6.0)
        return Vec3(
            s * (-n * k * math.sin(2.0 * self.inclination)),
            0.0,
            uneven + n * (1.0 + 0.5 * k * (1.0 - 1.5 * tilt)),
        )

    def _linear(self, p: AnyVector, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """`carry` without drag."""
        sphere = ClohessyWiltshire(self.mean_motion)
        p_1, v_1 = sphere.carry(p, v, t)
        if not self.oblateness:
            return p_1, v_1
        # Times of kernels and of steps are numbers, whose size is known.
        short = isinstance(t, float) and abs(self.mean_motion * t) < _SHORT_ANGLE
        for node, weight in _rule(_SHORT_NODES if short else _OBLATE_NODES):
            then = t * node
            acceleration = self._oblate(*sphere.carry(p, v, then), then)
            p_2, v_2 = sphere.kicked(acceleration.scale(t * weight), t * (1.0 - node))
            p_1 = p_1 + p_2
            v_1 = v_1 + v_2
        return p_1, v_1

    def _oblate(self, p: AnyVector, v: AnyVector, t: Field) -> AnyVector:
        """Acceleration by oblateness, m/s^2, of the first order in k, a time t (s) after the start."""
        n = self.mean_motion
        tilt = math.sin(self.inclination) ** 2
        across = math.sin(2.0 * self.inclination)
        u = self.latitude + self.latitude_rate * t
        s = _sine(u)
        c = _cosine(u)
        twice_s = s * c * (2.0 * tilt)
        twice_c = (1.0 - s * s * 2.0) * tilt
        mean = 1.0 - 1.5 * tilt
        turn = twice_c * (1.0 / 3.0) + mean

        # Gradients in n^2, and Coriolis accelerations in n.
        scale = self.oblateness * n * n
        x = p.x * (twice_c * (16.0 / 3.0) + 5.0 * mean) + p.y * twice_s * (11.0 / 3.0)
        x = x + v.y * turn * (1.0 / n)
        y = p.x * twice_s * (13.0 / 3.0) - p.y * twice_c * (8.0 / 3.0) - v.x * turn * (1.0 / n)
        if isinstance(p, Vec2) or isinstance(v, Vec2):
            return Vec2(x * scale, y * scale)
        side = s * across
        x = x + p.z * side * 5.0
        y = y - p.z * c * (2.0 * across) - v.z * side * (2.0 / n)
        z = p.x * side * 5.0 - p.z * (twice_c * 2.0 + 3.0 * mean) + v.y * side * (2.0 / n)
        return Vec3(x * scale, y * scale, z * scale)


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
    s = _sine(n * t)
    half = _sine(0.5 * n * t)
    rise = 2.0 * half * half
    return s, rise, s / n, 2.0 * rise / n, 4.0 * s / n - 3.0 * t


@lru_cache
def _rule(nodes: int) -> tuple[tuple[float, float], ...]:
    """Nodes and weights of Gauss and Legendre on [0, 1]."""
    rule = zip(*np.polynomial.legendre.leggauss(nodes), strict=True)
    return tuple((0.5 * float(node + 1.0), 0.5 * float(weight)) for node, weight in rule)


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


def eccentric_anomaly(mean_anomaly: Field, eccentricity: float) -> Field:
    """Eccentric anomaly E, rad, of a mean anomaly M = E - e sin E (Kepler's equation), by Halley's method.

    Args:
        mean_anomaly: M, rad.
        eccentricity: e, from 0 to `MOST_ECCENTRIC`.
    """
    e = eccentricity
    turns = math.tau * _floor(mean_anomaly / math.tau + 0.5)
    m = mean_anomaly - turns
    # Exact to the second order in e.
    angle = m + e * _sine(m) / _root(1.0 - 2.0 * e * _cosine(m) + e * e)
    for _ in range(_HALLEY_STEPS):
        lifted = e * _sine(angle)
        slope = 1.0 - e * _cosine(angle)
        miss = angle - lifted - m
        angle = angle - miss * slope / (slope * slope - 0.5 * miss * lifted)
    return angle + turns


def mean_anomaly(true_anomaly: Field, eccentricity: float) -> Field:
    """Mean anomaly, rad, of a true anomaly from -pi to pi, rad."""
    eta = math.sqrt(1.0 - eccentricity * eccentricity)
    anomaly = arctangent(eta * _sine(true_anomaly), eccentricity + _cosine(true_anomaly))
    return anomaly - eccentricity * _sine(anomaly)


def _sine(angle: Field) -> Field:
    """Sine that is a Python float for a Python float; NumPy's scalar would turn float32 arrays into float64."""
    return math.sin(angle) if isinstance(angle, float) else sin(angle)


def _cosine(angle: Field) -> Field:
    """As `_sine`."""
    return math.cos(angle) if isinstance(angle, float) else cos(angle)


def _root(x: Field) -> Field:
    """Square root as `_sine`."""
    return math.sqrt(x) if isinstance(x, float) else sqrt(x)


def arctangent(y: Field, x: Field) -> Field:
    """Angle of the point (x, y), rad, as `_sine`."""
    return math.atan2(y, x) if isinstance(y, float) else atan2(y, x)


def _floor(x: Field) -> Field:
    """As `_sine`."""
    return float(math.floor(x)) if isinstance(x, float) else floor(x)


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
