"""Nearly circular orbits around an oblate planet, with drag.

SciPy's orbits check it (`tests/orbits/test_orbits.py`), and Drake flies it without these equations
(`rans_missions.orbits.frames`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np

from rans.extend import AnyVector, ClohessyWiltshire, Field, Quat, Vec2, Vec3, cos, sin
from rans_missions.orbits.earth import EARTH, EARTH_RADIUS, J2
from rans_missions.orbits.uneven import UnevenOrbit

_OBLATE_NODES = 6
"""Nodes that integrate oblateness: in half an orbit its fourth harmonic turns by 12.6 rad, and the error is 0.6 %
of what this harmonic does, as much as the second order in oblateness; in a quarter it is 0.0001 %."""
_SHORT_NODES = 2
"""Nodes for times in which the target turns by less than `_SHORT_ANGLE`: the error is 1e-9 of the effect."""
_SHORT_ANGLE = 0.0125
"""rad, 12 s of a low orbit: four times as much, to the fourth power, over 4320, is the error of two nodes."""


@dataclass(frozen=True)
class PerturbedOrbit(UnevenOrbit):
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
    >>> from rans_missions.orbits.perturbed import PerturbedOrbit
    >>> orbit = PerturbedOrbit.around_earth(0.0011068, math.radians(51.6), drag=4e-7)
    >>> round(orbit.oblateness, 6)
    0.001396

    In the plane the motion across it is left out. `rans_missions.tasks.orbital.TargetOrbit` checks its numbers.
    """

    mean_motion: float
    """Mean motion n, rad/s: the square root of mu / a^3 for the mean radius a."""
    oblateness: float
    """k = 3/2 J2 (R / a)^2; 0: a sphere."""
    inclination: float
    """Inclination of the orbit, rad."""
    drag: float
    """Drag of the craft minus that of the target per mass, m/s^2; above 0 the craft is slowed down more."""
    angle: Field  # pyrefly: ignore[bad-override]
    """Argument of latitude of the target at the start of a motion, rad: its angle from the ascending node."""
    name: ClassVar[str] = "perturbed-orbit"

    @classmethod
    def around_earth(
        cls, mean_motion: float, inclination: float, drag: float = 0.0, angle: Field = 0.0
    ) -> PerturbedOrbit:
        """The orbit around the oblate Earth; arguments are the fields of these names, in SI units."""
        square = (EARTH_RADIUS / math.cbrt(EARTH / mean_motion**2)) ** 2
        return cls(mean_motion, 1.5 * J2 * square, inclination, drag, angle)

    @property
    def latitude_rate(self) -> float:
        """Mean rate of the argument of latitude, rad/s: that of W, and of the node, which moves backwards."""
        s, c = math.sin(self.inclination), math.cos(self.inclination)
        return self.mean_motion * (1.0 + self.oblateness * (0.5 - 0.75 * s * s + c * c))

    def later(self, t: Field) -> PerturbedOrbit:
        """The drift of a motion that begins a time t (s) later."""
        return replace(self, angle=self.angle + self.latitude_rate * t)

    def carry(self, p: AnyVector, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """Position (m) and velocity (m/s), vectors of fields, after a time t (s).

        Oblateness to the first order, then drag.
        """
        p_1, v_1 = self._linear(p, v, t)
        if not self.drag:
            return p_1, v_1
        # Constant acceleration along the track; see `ClohessyWiltshire` for the digits at short times.
        n = self.mean_motion
        s, half = sin(n * t), sin(0.5 * n * t)
        rise = 2.0 * half * half
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
        u = self.angle + a
        s = sin(u)
        c = cos(u)
        swing = 0.5 * sin(2.0 * a)
        tilt = math.sin(self.inclination) ** 2
        mean = self.mean_motion * (1.0 + 0.5 * self.oblateness * (1.0 - 1.5 * tilt))
        uneven = (self.oblateness * faster * tilt / 6.0) * (1.0 - 2.0 * s * s) * swing
        half = 0.5 * mean * t + uneven
        across = -0.5 * self.oblateness * faster * math.sin(2.0 * self.inclination)
        x = across * s * (a + swing)
        y = across * c * (a - swing)
        rest = 1.0 - 0.5 * (x * x + y * y)
        return Quat(cos(half) * rest, x, y, sin(half) * rest)

    def rate(self) -> Vec3:
        """Angular velocity of W, rad/s, as in the description of the class."""
        n, k = self.mean_motion, self.oblateness
        tilt = math.sin(self.inclination) ** 2
        s = sin(self.angle)
        uneven = (1.0 - 2.0 * s * s) * (n * k * tilt / 6.0)
        return Vec3(
            s * (-n * k * math.sin(2.0 * self.inclination)),
            0.0,
            uneven + n * (1.0 + 0.5 * k * (1.0 - 1.5 * tilt)),
        )

    def _linear(self, p: AnyVector, v: AnyVector, t: Field) -> tuple[AnyVector, AnyVector]:
        """`carry` without drag, to the first order in k, by quadrature over the sphere's motion.

        How many nodes there are may depend on a number only, never on a field: kernels have no such branch.
        """
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
        """Acceleration by oblateness, m/s^2, of the first order in k, a time t (s) after the start.

        Vectors of fields in the Hill frame.
        """
        n = self.mean_motion
        tilt = math.sin(self.inclination) ** 2
        across = math.sin(2.0 * self.inclination)
        u = self.angle + self.latitude_rate * t
        s = sin(u)
        c = cos(u)
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
            return Vec2(x * scale, y * scale)  # pyrefly: ignore[bad-return]
        side = s * across
        x = x + p.z * side * 5.0
        y = y - p.z * c * (2.0 * across) - v.z * side * (2.0 / n)
        z = p.x * side * 5.0 - p.z * (twice_c * 2.0 + 3.0 * mean) + v.y * side * (2.0 / n)
        return Vec3(x * scale, y * scale, z * scale)  # pyrefly: ignore[bad-return]


@lru_cache
def _rule(nodes: int) -> tuple[tuple[float, float], ...]:
    """Nodes and weights of Gauss and Legendre on [0, 1]."""
    rule = zip(*np.polynomial.legendre.leggauss(nodes), strict=True)
    return tuple((0.5 * float(node + 1.0), 0.5 * float(weight)) for node, weight in rule)
