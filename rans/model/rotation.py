"""The rotation of a rigid body in space: spin and attitude as power series in time.

A series is a list of vectors, the coefficients of the powers of the share of a step that is gone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce
from operator import add
from typing import Any

from rans.model.fields import Field, Quat, Vec3

Series = Sequence[Vec3]

_ORDER = 8
"""Of the spin's series where moments of inertia differ."""
_EVEN_ORDER = 4
"""Of equal moments under a torque that turns: it only says where that points (`pulled`)."""

_IN_THE_MIDDLE = [[math.comb(j, k) * 0.5 ** (j - k) for j in range(_ORDER + 1)] for k in range(4)]
"""Share that every coefficient of a series has in its k-th derivative there, over k factorial."""
_ALTERNATING = {
    first: [(-1) ** k / math.perm(first - 1 + 2 * k, 2 * k) for k in range(4, -1, -1)]
    for first in (2, 3)
}
"""Coefficients by falling powers; all made beforehand, as torch traces few functions of numbers."""


def at(series: Series, share: float) -> Vec3:
    """Value of a series (Horner); an empty one is zero."""
    result = series[-1] if series else Vec3(0.0, 0.0, 0.0)
    for coefficient in reversed(series[:-1]):
        result = result.scale(share) + coefficient
    return result


def spin_series(
    w: Vec3,
    torque: Sequence[Any],
    inertia: Sequence[Field],
    h: Field,
    steady: Vec3 | None,
    stored: Sequence[Vec3] | None = None,
) -> Series:
    """Taylor series of the angular velocity over the share of h that is gone.

    Euler's equation, I w' = tau - w x ((I - I_zz 1) w + h): a multiple of the unit tensor has no part in
    w x I w, so the series of a body with three equal moments, in which nothing spins (h = 0), ends after its
    second term. A torque that is constant in W turns in B: u' = u x w.

    Args:
        w: angular velocity in B, rad/s.
        torque: in B, by powers of that share: one entry if it is constant, N m.
        inertia: the six entries (I_xx, I_xy, I_xz, I_yy, I_yz, I_zz), kg m^2.
        h: length of the step, s.
        steady: a second torque, constant in W, as B sees it at the start, N m.
        stored: angular momentum of what spins inside the body, in B, by powers of the share of h, N m s; None:
            nothing does.
    """
    xx, xy, xz, yy, yz, zz = inertia
    excess = (_less(xx, zz), xy, xz, _less(yy, zz), yz, 0.0)
    inverse = _inverse(inertia)
    is_even = even(inertia)
    calm = is_even and stored is None
    order = _ORDER if not calm else len(torque) if steady is None else _EVEN_ORDER
    turning = [] if steady is None else [steady]
    rate = [w]
    momentum = []
    for k in range(order):
        torques: list[Any] = list(torque[k : k + 1])
        if turning:
            torques.append(turning[k])
            turning.append(last_product(turning, rate).scale(h / (k + 1)))
        if not calm:
            own = [] if is_even else [_symmetric_times(excess, rate[k])]
            own += (stored or ())[k : k + 1]
            momentum.append(reduce(add, own) if own else Vec3(0.0, 0.0, 0.0))
            torques.append(last_product(momentum, rate))
        rate.append(_symmetric_times(inverse, reduce(add, torques)).scale(h / (k + 1)))
    return rate


def even(inertia: Sequence[Field]) -> bool:
    """Whether all moments of inertia, as in `spin_series`, are known to be equal."""
    xx, xy, xz, yy, yz, zz = inertia
    return all(
        isinstance(x, float) and x == 0.0 for x in (_less(xx, zz), xy, xz, _less(yy, zz), yz)
    )


def last_product(a: Series, b: Series) -> Vec3:
    """The last known coefficient of the vector product of two series of the same length."""
    return reduce(add, [x.cross(y) for x, y in zip(a, reversed(b), strict=True)])


def _less(a: Field, b: Field) -> Field:
    """Their difference, known to be nothing where they are one and the same."""
    return 0.0 if a is b else a - b


def _symmetric_times(entries: Sequence[Field], v: Vec3) -> Vec3:
    """Product of a symmetric 3x3 tensor, given by its six entries, with a vector."""
    xx, xy, xz, yy, yz, zz = entries
    return Vec3(
        *(x * v.x + y * v.y + z * v.z for x, y, z in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))
    )


def _inverse(entries: Sequence[Field]) -> tuple[Field, ...]:
    """Inverse of a symmetric 3x3 tensor by cofactors, as its six entries."""
    xx, xy, xz, yy, yz, zz = entries
    a = yy * zz - yz * yz
    b = xz * yz - xy * zz
    c = xy * yz - xz * yy
    s = 1.0 / (xx * a + xy * b + xz * c)
    return (
        a * s,
        b * s,
        c * s,
        (xx * zz - xz * xz) * s,
        (xy * xz - xx * yz) * s,
        (xx * yy - xy * xy) * s,
    )


class Rotation:
    """The rotation of a body that turns at a given rate, by Magnus' series of order six.

    Blanes, Casas and Ros, "Improved high order integrators based on the Magnus expansion", BIT 40, 2000: with
    C = [a, b] and D = -[a, 2 c + C] / 60, the rotation vector is a + c / 12 + [-20 a - c + C, b + D] / 240,
    where a, b and c stand for the rate's first moments: here r0 + r4 / 80, r1 + 3 r3 / 20 and r2 of its
    Taylor coefficients in the middle of the step, times the duration. They multiply from the other side, so
    that every bracket has its sign changed here. A rate that never changes is exact. The rate is the angular
    velocity in the body's frame, rad/s; the step lasts for the duration, s.
    """

    def __init__(self, rate: Series, duration: Field) -> None:
        self.brackets = _brackets(rate, duration)
        """What the rotation vector has beside the integral of the rate, for the whole step."""
        self.whole = (
            _sum(rate, [1.0 / k for k in range(1, len(rate) + 1)]).scale(duration) + self.brackets
        )
        """Rotation vector of the whole step, in the frame at its start."""
        # Its Taylor series as far as that is short, and one more term that ends it where the step ends.
        zero = Vec3(0.0, 0.0, 0.0)
        w0, w1, w2, w3 = (*rate, zero, zero, zero, zero)[:4]
        second, third = (
            w0.cross(rate[k]).scale(duration / 12.0) if k < len(rate) else zero for k in (1, 2)
        )
        path = [w0, w1.scale(1.0 / 2.0), w2.scale(1.0 / 3.0) + second, w3.scale(1.0 / 4.0) + third]
        self._path = [zero, *(x.scale(duration) for x in path)]
        self._path.append(self.whole - reduce(add, self._path))

    def vector(self, share: float) -> Vec3:
        """Rotation vector from the start until this share of the step is gone, of order five."""
        return at(self._path, share)


def _brackets(rate: Series, duration: Field) -> Vec3:
    r0, r1, r2, r3 = (_derivative(rate, k).scale(duration) for k in range(4))
    slope = r1 + r3.scale(3.0 / 20.0)
    first = slope.cross(r0)
    second = (r2.scale(2.0) + first).cross(r0).scale(-1.0 / 60.0)
    return (slope + second).cross(first - r0.scale(20.0) - r2).scale(1.0 / 240.0)


def _derivative(series: Series, k: int) -> Vec3:
    """The k-th of a series in the middle, over k factorial."""
    return _sum(series[k:], _IN_THE_MIDDLE[k][k : len(series)])


def _sum(vectors: Sequence[Vec3], factors: Sequence[float]) -> Vec3:
    terms = [x.scale(factor) for x, factor in zip(vectors, factors, strict=True)]
    return reduce(add, terms) if terms else Vec3(0.0, 0.0, 0.0)


def pulled(
    torque: Sequence[Any], turns: Sequence[tuple[Vec3, float, float]], steady: Vec3
) -> tuple[Vec3, Vec3]:
    """A torque and one that is constant in W, integrated once and twice over the share of a step gone.

    Where moments of inertia are equal nothing else changes the spin, and this is closer to the truth than
    the end of a series.

    Args:
        torque: in B, by powers of that share, N m.
        turns: rotation vectors at the nodes of a rule, the nodes and their weights.
        steady: the other, as B sees it at the start, N m.
    """
    seen = [turned(turn.scale(-1.0), steady) for turn, _, _ in turns]
    powers = range(1, len(torque) + 1)
    return (
        _sum(torque, [1.0 / k for k in powers]) + _sum(seen, [weight for *_, weight in turns]),
        _sum(torque, [1.0 / (k * (k + 1)) for k in powers])
        + _sum(seen, [weight * (1.0 - node) for _, node, weight in turns]),
    )


def turned(rotation: Vec3, v: Vec3) -> Vec3:
    """A vector after a rotation (Rodrigues' formula)."""
    sine, cosine = _sine_and_cosine(rotation.dot(rotation))
    across = rotation.cross(v)
    return v + across.scale(sine) + rotation.cross(across).scale(cosine)


def exponential(rotation: Vec3) -> Quat:
    """The quaternion of a rotation vector."""
    square = 0.25 * rotation.dot(rotation)
    sine, cosine = _sine_and_cosine(square)
    return Quat(1.0 - square * cosine, *rotation.scale(0.5 * sine).columns())


def _sine_and_cosine(square: Field) -> tuple[Field, Field]:
    """sin(x) / x and (1 - cos(x)) / x^2 from the square of x, by Taylor series: 3e-8 off at 1 rad."""
    return _alternating(square, 2), 0.5 * _alternating(square, 3)


def _alternating(square: Field, first: int) -> Field:
    """1 - s / (n (n + 1)) + s^2 / (n (n + 1) (n + 2) (n + 3)) - ..., five terms."""
    result, *factors = _ALTERNATING[first]
    for factor in factors:
        result = square * result + factor
    return result
