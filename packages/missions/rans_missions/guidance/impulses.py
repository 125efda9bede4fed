"""What impulses do near a circular orbit, and what they cost thrusters along the axes."""

from __future__ import annotations

from functools import reduce
from operator import add
from typing import NamedTuple

from rans.extend import Field, Vector, absolute, sin, where

SINGULAR_OFFSET = 1e-9
"""Added to determinants and other divisors that may be zero, in the units of each: a division by nearly nothing
then gives a huge number, which no comparison of prices chooses, instead of none."""
LEAST_SAVING = 0.005
"""Part of its price that postponing a burn must save, or the craft burns now: less is within the errors of impulses
that last for a control period."""

Pair = tuple[Field, Field]
"""Components in the orbital plane, x and y."""


class ImpulseResponse(NamedTuple):
    """Response to an impulse of 1 m/s after a time, by the Clohessy-Wiltshire equations."""

    time: Field
    """Time t since the impulse, s."""
    sine: Field
    """sin(n t)."""
    versine: Field
    """1 - cos(n t)."""

    @classmethod
    def after(cls, n: float, time: Field) -> ImpulseResponse:
        """Response after a time, s, at the mean motion n, rad/s; the half angle keeps digits at short times."""
        half = sin(time * (0.5 * n))
        return cls(time, sin(time * n), 2.0 * half * half)

    def displacement(self, n: float, axis: int) -> Pair:
        """Change of position in the orbital plane, m, by 1 m/s along an axis of it, at the mean motion n, rad/s."""
        if axis == 0:
            return self.sine * (1.0 / n), self.versine * (-2.0 / n)
        return self.versine * (2.0 / n), self.sine * (4.0 / n) - self.time * 3.0

    def velocity_change(self, axis: int) -> Pair:
        """Change of velocity in the orbital plane, m/s, by 1 m/s along an axis of it."""
        if axis == 0:
            return 1.0 - self.versine, self.sine * -2.0
        return self.sine * 2.0, 1.0 - self.versine * 4.0


def two_impulses(first: Pair, second: Pair, displacement: Pair) -> Pair:
    """Sizes of two impulses, m/s, which together displace a craft in the orbital plane.

    Args:
        first: displacement by 1 m/s of the first impulse, m.
        second: displacement by 1 m/s of the second one, m.
        displacement: of both together, m. Where both impulses displace along one line the sizes are huge
            (`SINGULAR_OFFSET`).
    """
    determinant = first[0] * second[1] - first[1] * second[0]
    scale = 1.0 / (determinant + SINGULAR_OFFSET)
    return (
        (displacement[0] * second[1] - displacement[1] * second[0]) * scale,
        (first[0] * displacement[1] - first[1] * displacement[0]) * scale,
    )


def axis_price(v: Vector) -> Field:
    """Sum of the absolute components of a velocity change, m/s: what thrusters along the axes pay for it."""
    return reduce(add, map(absolute, v.columns()))


def larger(a: Field, b: Field) -> Field:
    """The larger of two fields."""
    return where(a > b, a, b)
