"""Guidance law for landing that minimises squared acceleration and time, in closed form over fields.

Source: C. N. D'Souza, "An optimal guidance law for planetary landing", AIAA Guidance, Navigation, and Control
Conference, 1997, paper 97-3709.
"""

from __future__ import annotations

from dataclasses import dataclass

from rans.extend import Field, Vec3, at_least, sqrt, where

_NEWTON_STEPS = 6
"""Iterations of Newton's method. The relative error of the time to go is then below 7e-5 in 99 of 100 states
between 1 cm and 4 km and between 1 cm/s and 200 m/s; it is larger in states that need 5 m/s^2 or more to brake
in time."""
_SOFTENING = 1e-6
"""Added to squared distances, m^2, and squared speeds, m^2/s^2, to avoid division by zero at the site."""

_LEAST_SQUARE_SPEED = 1e-9
"""Lower bound of the squared transverse speed, m^2/s^2, which divides."""


@dataclass(frozen=True)
class DescentLaw:
    """Thrust that brings a point to rest at the origin and minimises time and squared acceleration.

    The cost is haste * time + integral of |acceleration|^2 / 2. The acceleration is that of the motion; thrust must
    also balance the weight. It changes linearly with time, from -6 p / t^2 - 4 v / t now to 6 p / t^2 + 2 v / t at
    the end of the time to go t, which is the root of

        (haste + g^2 / 2) t^4 - 2 |v|^2 t^2 - 12 p . v t - 18 |p|^2 = 0.

    The law considers neither bounds on the thrust nor the ground.
    """

    time: Field
    """Time to go, s."""
    thrust: Vec3
    """Commanded acceleration by thrust now, in W, m/s^2."""
    speed: Field
    """Velocity change by thrust until then, m/s: root mean square of its acceleration times the time to go."""

    @classmethod
    def of(cls, p: Vec3, v: Vec3, gravity: float, haste: float) -> DescentLaw:
        """Guidance law at a position and velocity, with gravity along -z of W.

        Args:
            p: position relative to the landing site, m.
            v: velocity relative to the landing site, m/s.
            gravity: acceleration of free fall, > 0, m/s^2.
            haste: weight of time, m^2/s^4; a larger one lands sooner.
        """
        time = 1.0 / _rate(p.dot(p) + _SOFTENING, v.dot(v) + _SOFTENING, p.dot(v), gravity, haste)
        by_position = p.scale(6.0 / (time * time))
        by_velocity = v.scale(2.0 / time)
        zero = time * 0.0
        weight = Vec3(zero, zero, zero + gravity)
        now = weight - by_position - by_velocity.scale(2.0)
        final = weight + by_position + by_velocity
        # Mean square of a vector that changes linearly.
        square = (now.dot(now) + now.dot(final) + final.dot(final)) * (1.0 / 3.0)
        return cls(time, now, time * sqrt(square))


def _rate(square: Field, speed: Field, closing: Field, gravity: float, haste: float) -> Field:
    """Inverse of the time to go, 1/s: largest root s of 18 |p|^2 s^4 + 12 p . v s^3 + 2 |v|^2 s^2 = cost.

    It is found by Newton's method from above, where the polynomial is convex; a step at most halves s. All are
    fields.

    Args:
        square: |p|^2, m^2.
        speed: |v|^2, m^2/s^2.
        closing: p . v, m^2/s.
        gravity: acceleration of free fall, m/s^2.
        haste: weight of time, m^2/s^4.
    """
    cost = haste + 0.5 * gravity * gravity
    distance = sqrt(square)
    # Two upper bounds: for a velocity directed at the site, and from its transverse component alone.
    bound = sqrt(speed) / (3.0 * distance) + (cost / 18.0) ** 0.25 / sqrt(distance)
    towards = at_least(-closing, 0.0)
    across = at_least(speed - towards * towards / square, _LEAST_SQUARE_SPEED)
    across_bound = sqrt(0.5 * cost / across)
    rate = where(across_bound < bound, across_bound, bound)
    for _ in range(_NEWTON_STEPS):
        value = ((18.0 * square * rate + 12.0 * closing) * rate + 2.0 * speed) * rate * rate - cost
        slope = ((72.0 * square * rate + 36.0 * closing) * rate + 4.0 * speed) * rate
        newer = rate - value / slope
        rate = where(newer > 0.5 * rate, newer, 0.5 * rate)
    return rate
