"""Elliptic orbits: relative motion near a target in closed form, and Kepler's equation."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

from rans.extend import AnyVector, Field, Quat, Vec2, Vec3, cos, floor, sin, sqrt
from rans.model.drift import arctangent
from rans_missions.orbits.uneven import UnevenOrbit

MOST_ECCENTRIC = 0.9
"""Largest eccentricity of an orbit: that of a transfer to geostationary orbit is 0.73, of a Molniya orbit 0.74."""
_HALLEY_STEPS = 3
"""Steps that solve Kepler's equation to rounding up to an eccentricity of 0.95."""


@dataclass(frozen=True)
class EllipticOrbit(UnevenOrbit):
    """Relative motion near a target on an elliptic orbit (Tschauner-Hempel equations), in closed form.

    W turns with the line from the planet to the target: x radially outwards, y along the track, z across it. To
    first order in the distance over the radius r of the orbit, with the angular velocity w of that line and the
    planet's gravitational parameter mu,

        x'' = (w^2 + 2 mu / r^3) x + w' y + 2 w y',  y'' = (w^2 - mu / r^3) y - w' x - 2 w x',  z'' = -(mu / r^3) z.

    The solution is the state transition of K. Yamanaka and F. Ankersen, "New state transition matrix for relative
    motion on an arbitrary elliptical orbit", Journal of Guidance, Control, and Dynamics 25(1), 2002. With an
    eccentricity of zero it is that of `rans.model.drift.ClohessyWiltshire`.

    >>> from rans_missions.orbits.elliptic import EllipticOrbit
    >>> orbit = EllipticOrbit(mean_motion=0.001027, eccentricity=0.1, angle=0.0)
    >>> orbit.later(1000.0).angle
    1.027

    `rans_missions.tasks.orbital.TargetOrbit` checks its numbers.
    """

    mean_motion: float
    """Mean motion n, rad/s: the square root of mu / a^3 for a semi-major axis a."""
    eccentricity: float
    """Eccentricity e, from 0 (circle) to `MOST_ECCENTRIC`."""
    angle: Field  # pyrefly: ignore[bad-override]
    """Mean anomaly of the target at the start of a motion, rad: n times the time since its periapsis."""
    gravity_gradient: bool = False
    """Whether the gradient of gravity turns craft in space."""
    name: ClassVar[str] = "elliptic-orbit"

    def later(self, t: Field) -> EllipticOrbit:
        """The drift of a motion that begins a time t (s) later."""
        return replace(self, angle=self.angle + self.mean_motion * t)

    def carry(self, p: AnyVector, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """Position and velocity after a time t (s).

        Changes over the time are computed from half the angle that is passed, which keeps their digits at short
        times. In the names, 0 is the start, 1 the end, and m halfway in angle. It must agree with
        `rans.model.drift` rules: fields, smooth in t, and two coasts after one another are one.
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
        return 1.0 - e * cos(eccentric_anomaly(self.angle, e))

    def _passed(self, t: Field) -> tuple[Field, Field, Field, Field]:
        """Sine and cosine of the true anomaly at the start, and of half of its change over a time t (s).

        The difference of two anomalies loses its digits at short times, which the step of Newton gives back.
        """
        n = self.mean_motion
        e = self.eccentricity
        eta = math.sqrt(1.0 - e * e)

        # Eccentric anomaly at the start, and its change until the end: first the difference of two solutions of
        # Kepler's equation, then one step of Newton with the equation of the change itself.
        anomaly = eccentric_anomaly(self.angle, e)
        end = eccentric_anomaly(self.angle + n * t, e)
        half = (end - anomaly) * 0.5
        middle = anomaly + half
        short = (2.0 * half - 2.0 * e * cos(middle) * sin(half)) - n * t
        half = half - 0.5 * short / (1.0 - e * cos(anomaly + 2.0 * half))
        middle = anomaly + half

        # Radii over the semi-major axis; sine and cosine of the true anomaly and of half of its change.
        r_0 = 1.0 - e * cos(anomaly)
        r_1 = 1.0 - e * cos(anomaly + 2.0 * half)
        sin_0 = eta * sin(anomaly) / r_0
        cos_0 = (cos(anomaly) - e) / r_0
        scale = 1.0 / root(r_0 * r_1)
        sin_h = eta * sin(half) * scale
        cos_h = (cos(half) - e * cos(middle)) * scale
        return sin_0, cos_0, sin_h, cos_h


def eccentric_anomaly(mean_anomaly: Field, eccentricity: float) -> Field:
    """Eccentric anomaly E, rad, of a mean anomaly M = E - e sin E (Kepler's equation), by Halley's method.

    Args:
        mean_anomaly: M, rad.
        eccentricity: e, from 0 to `MOST_ECCENTRIC`.
    """
    e = eccentricity
    turns = math.tau * whole(mean_anomaly / math.tau + 0.5)
    m = mean_anomaly - turns
    # Exact to the second order in e.
    angle = m + e * sin(m) / root(1.0 - 2.0 * e * cos(m) + e * e)
    for _ in range(_HALLEY_STEPS):
        lifted = e * sin(angle)
        slope = 1.0 - e * cos(angle)
        miss = angle - lifted - m
        angle = angle - miss * slope / (slope * slope - 0.5 * miss * lifted)
    return angle + turns


def mean_anomaly(true_anomaly: Field, eccentricity: float) -> Field:
    """Mean anomaly, rad, of a true anomaly from -pi to pi, rad."""
    eta = math.sqrt(1.0 - eccentricity * eccentricity)
    anomaly = arctangent(eta * sin(true_anomaly), eccentricity + cos(true_anomaly))
    return anomaly - eccentricity * sin(anomaly)


def root(x: Field) -> Field:
    """Square root that is a Python float for a Python float, as `rans.model.drift.sine`."""
    return math.sqrt(x) if isinstance(x, float) else sqrt(x)


def whole(x: Field) -> Field:
    """Largest whole number up to x, as `root`."""
    return float(math.floor(x)) if isinstance(x, float) else floor(x)
