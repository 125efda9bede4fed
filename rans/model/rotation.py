"""Rotation of a rigid body in space: spin and attitude as power series in time.

A series is a list of vectors: the coefficients of the powers of the elapsed share of a step.
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
"""Order of the series of the spin where moments of inertia differ."""
_EVEN_ORDER = 4
"""Order of the series for equal moments under a torque that rotates in B; only its direction follows from the
series (`pulled`)."""

_IN_THE_MIDDLE = [[math.comb(j, k) * 0.5 ** (j - k) for j in range(_ORDER + 1)] for k in range(4)]
"""Factor of every coefficient of a series in its k-th derivative at the middle of the step, over k factorial."""
_ALTERNATING = {
    first: [(-1) ** k / math.perm(first - 1 + 2 * k, 2 * k) for k in range(4, -1, -1)]
    for first in (2, 3)
}
"""Coefficients by descending powers, computed once because torch can trace few functions of numbers."""


def at(series: Series, elapsed: float) -> Vec3:
    """Value of a series (Horner); an empty one is zero."""
    result = series[-1] if series else Vec3(0.0, 0.0, 0.0)
    for coefficient in reversed(series[:-1]):
        result = result.scale(elapsed) + coefficient
    return result


def spin_series(
    w: Vec3,
    torque: Sequence[Any],
    inertia: Sequence[Field],
    h: Field,
    steady: Vec3 | None,
    stored: Sequence[Vec3],
    swell: Sequence[Field],
    carried: Sequence[Vec3],
    radial: Vec3 | None,
    gradient: Sequence[Field],
    rotors: Sequence[Sequence[Field]],
    added: Sequence[Sequence[Field]],
) -> tuple[Series, Series]:
    """Taylor series of the angular velocity and of its derivative in the elapsed share of a step.

    Euler's equation is I w' = tau - w x ((I - I_zz 1) w + H), with the angular momentum H of the wheels: a
    multiple of the unit tensor does not contribute to w x I w. The series of a body with three equal moments of
    inertia and without wheels therefore ends after its second term. A torque u that is constant in W rotates in
    B: u' = u x (w - f), with the angular velocity f of W. The unit vector r away from a planet, which is
    constant in W, does likewise, and the gradient of gravity has the torque 3 mu / R^3 r x I r with the planet's
    gravitational parameter mu and its distance R.

    Args:
        w: angular velocity in B, rad/s.
        torque: torque in B by powers of the elapsed share, N m; one entry if it is constant.
        inertia: the six entries (I_xx, I_xy, I_xz, I_yy, I_yz, I_zz), kg m^2.
        h: length of the step, s.
        steady: second torque, constant in W, expressed in B at the start, N m.
        stored: angular momentum of the wheels in B by powers of the elapsed share, N m s; empty: no wheels.
        swell: factor on the second torque by powers of the elapsed share; empty: 1.
        carried: angular velocity of W by powers of the elapsed share, expressed in B at the start, rad/s; at most
            two entries; none: W does not turn.
        radial: unit vector away from the planet, constant in W, expressed in B at the start; None: no planet.
        gradient: 3 mu / R^3 by powers of the elapsed share, 1/s^2.
        rotors: what the wheels add to the inertia on which gravity acts, as its six entries, by powers of the
            elapsed share; at most two; empty: nothing.
        added: what the inertia exceeds ``inertia`` by, likewise, two or none.
    """
    is_even = even(inertia) and not added
    rises: Sequence[Sequence[Field]] = added[1:]
    if added:
        inertia = [x + y for x, y in zip(inertia, added[0], strict=True)]
    xx, xy, xz, yy, yz, zz = inertia
    # The part of the tensor that contributes, and how many terms the series has.
    excess = (_less(xx, zz), xy, xz, _less(yy, zz), yz, 0.0)
    mobility = symmetric_inverse(inertia)
    calm = is_even and not stored
    order = _ORDER if not calm else len(torque) if steady is None else _EVEN_ORDER
    turning = [] if steady is None else [steady]
    pulled_on: Sequence[Field] = excess
    if rotors:
        pulled_on = tuple(x + y for x, y in zip(excess, rotors[0], strict=True))
    pulled_rises = [*rotors[1:], *rises]
    outwards = [] if radial is None or (is_even and not rotors) else [radial]
    stretched: list[Vec3] = []
    tides: list[Vec3] = []
    rate = [w]
    faster: list[Vec3] = []
    # Vectors that are constant in axes that do not turn, as B sees them.
    frame: list[list[Vec3]] = [[vector] for vector in carried]
    relative = [w - carried[0]] if carried else rate
    momentum: list[Vec3] = []
    for k in range(order):
        torques: list[Any] = list(torque[k : k + 1])
        if turning:
            torques += _swollen(turning[: k + 1], swell)
            turning.append(last_product(turning, relative).scale(h / (k + 1)))
        if outwards:
            stretched.append(symmetric_times(pulled_on, outwards[k]))
            for rise in pulled_rises if k else ():
                stretched[k] += symmetric_times(rise, outwards[k - 1])
            tides.append(last_product(outwards, stretched))
            torques += _swollen(tides, gradient)
            outwards.append(last_product(outwards, relative).scale(h / (k + 1)))
        if not calm:
            own = [] if is_even else [symmetric_times(excess, rate[k])]
            own += stored[k : k + 1]
            own += [symmetric_times(rise, rate[k - 1]) for rise in rises if k]
            momentum.append(reduce(add, own) if own else Vec3(0.0, 0.0, 0.0))
            torques.append(last_product(momentum, rate))
        torques += [symmetric_times(rise, faster[k - 1]).scale(-1.0) for rise in rises if k]
        for seen in frame:
            seen.append(last_product(seen, rate).scale(h / (k + 1)))
        faster.append(symmetric_times(mobility, reduce(add, torques)))
        rate.append(faster[k].scale(h / (k + 1)))
        if frame:
            later = [seen[-1 - power] for power, seen in enumerate(frame)]
            relative.append(rate[-1] - reduce(add, later))
    return rate, faster


def _swollen(turning: Series, swell: Sequence[Field]) -> Series:
    """Terms of the last coefficient of a series times a factor by powers of the elapsed share; empty: 1."""
    if not swell:
        return turning[-1:]
    return [x.scale(factor) for x, factor in zip(reversed(turning), swell, strict=False)]


def even(inertia: Sequence[Field]) -> bool:
    """Whether all moments of inertia, as in `spin_series`, are the same number or the same field."""
    xx, xy, xz, yy, yz, zz = inertia
    return all(
        isinstance(x, float) and x == 0.0 for x in (_less(xx, zz), xy, xz, _less(yy, zz), yz)
    )


def last_product(a: Series, b: Series) -> Vec3:
    """Last coefficient that two series of the same length determine of their vector product."""
    return reduce(add, [x.cross(y) for x, y in zip(a, reversed(b), strict=True)])


def _less(a: Field, b: Field) -> Field:
    """Difference a - b; the number 0.0 if both are the same object."""
    return 0.0 if a is b else a - b


def symmetric_times(entries: Sequence[Field], v: Vec3) -> Vec3:
    """Product of a symmetric 3x3 tensor, given by its six entries, with a vector."""
    xx, xy, xz, yy, yz, zz = entries
    return Vec3(
        *(x * v.x + y * v.y + z * v.z for x, y, z in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))
    )


def symmetric_inverse(entries: Sequence[Field]) -> tuple[Field, ...]:
    """Inverse of a symmetric 3x3 tensor by cofactors; entries (fields) in the order xx, xy, xz, yy, yz, zz."""
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
    """Rotation of a body with a known angular velocity over a step, by a Magnus series of order six.

    Source: Blanes, Casas and Ros, "Improved high order integrators based on the Magnus expansion", BIT 40, 2000.
    With C = [a, b] and D = -[a, 2 c + C] / 60 the rotation vector is a + c / 12 + [-20 a - c + C, b + D] / 240.
    Here a, b and c are the first moments of the rate: r0 + r4 / 80, r1 + 3 r3 / 20 and r2, with its Taylor
    coefficients r0, r1, ... at the middle of the step times the duration. The source multiplies from the other
    side, so every bracket has the opposite sign here. A constant rate is exact.

    Args:
        rate: series of the angular velocity in the body frame, rad/s.
        duration: length of the step, s.
    """

    def __init__(self, rate: Series, duration: Field) -> None:
        self.brackets = _brackets(rate, duration)
        """Rotation vector of the whole step less the integral of the rate."""
        self.whole = (
            _sum(rate, [1.0 / k for k in range(1, len(rate) + 1)]).scale(duration) + self.brackets
        )
        """Rotation vector of the whole step, in the frame at its start."""
        # The first terms of its Taylor series, and one more term that makes the end of the step exact.
        zero = Vec3(0.0, 0.0, 0.0)
        w0, w1, w2, w3 = (*rate, zero, zero, zero, zero)[:4]
        second, third = (
            w0.cross(rate[k]).scale(duration / 12.0) if k < len(rate) else zero for k in (1, 2)
        )
        path = [w0, w1.scale(1.0 / 2.0), w2.scale(1.0 / 3.0) + second, w3.scale(1.0 / 4.0) + third]
        self._path = [zero, *(x.scale(duration) for x in path)]
        self._path.append(self.whole - reduce(add, self._path))

    def vector(self, elapsed: float) -> Vec3:
        """Rotation vector from the start to this share of the step, of order five."""
        return at(self._path, elapsed)


def _brackets(rate: Series, duration: Field) -> Vec3:
    # Derivatives of the series at the middle of the step, the k-th over k factorial.
    r0, r1, r2, r3 = (
        _sum(rate[k:], _IN_THE_MIDDLE[k][k : len(rate)]).scale(duration) for k in range(4)
    )
    slope = r1 + r3.scale(3.0 / 20.0)
    first = slope.cross(r0)
    second = (r2.scale(2.0) + first).cross(r0).scale(-1.0 / 60.0)
    return (slope + second).cross(first - r0.scale(20.0) - r2).scale(1.0 / 240.0)


def _sum(vectors: Sequence[Vec3], factors: Sequence[float]) -> Vec3:
    terms = [x.scale(factor) for x, factor in zip(vectors, factors, strict=True)]
    return reduce(add, terms) if terms else Vec3(0.0, 0.0, 0.0)


def pulled(
    torque: Sequence[Any],
    turns: Sequence[tuple[Vec3, float, float]],
    steady: Sequence[Vec3],
    swell: Sequence[Field] = (),
) -> tuple[Vec3, Vec3]:
    """First and second integral over a step of a torque in B plus a torque that is constant in W.

    If all moments of inertia are equal, these integrals alone change the spin, and they are more accurate than
    the series.

    Args:
        torque: torque in B by powers of the elapsed share, N m.
        turns: rotation vectors at the nodes of a quadrature rule, the nodes and their weights.
        steady: torque that is constant in W at each node, expressed in B at the start, N m.
        swell: factor on it by powers of the elapsed share; empty: 1.
    """
    rotated = [turned(turn.scale(-1.0), u) for (turn, _, _), u in zip(turns, steady, strict=True)]
    if swell:
        rotated = [
            vector.scale(swell[0] + swell[1] * node)
            for vector, (_, node, _) in zip(rotated, turns, strict=True)
        ]
    powers = range(1, len(torque) + 1)
    return (
        _sum(torque, [1.0 / k for k in powers]) + _sum(rotated, [weight for *_, weight in turns]),
        _sum(torque, [1.0 / (k * (k + 1)) for k in powers])
        + _sum(rotated, [weight * (1.0 - node) for _, node, weight in turns]),
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
    """sin(x) / x and (1 - cos(x)) / x^2 from the square of x, by Taylor series with an error of 3e-8 at 1 rad."""
    return _alternating(square, 2), 0.5 * _alternating(square, 3)


def _alternating(square: Field, first: int) -> Field:
    """Five terms of 1 - s / (n (n + 1)) + s^2 / (n (n + 1) (n + 2) (n + 3)) - ..."""
    result, *factors = _ALTERNATING[first]
    for factor in factors:
        result = square * result + factor
    return result
