"""The spin of a rigid body in space, by the Taylor series of Euler's equation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rans.model.fields import Field, Vec3
from rans.model.magnus import Series, last_product, total

_ORDER = 8
"""Of the series of a body whose moments of inertia differ."""


def spin_series(w: Vec3, torque: Sequence[Any], inertia: Sequence[Field], h: Field,
                steady: Vec3 | None) -> Series:
    """Taylor series of the angular velocity over the share of h that is gone.

    Euler's equation, I w' = tau - w x (I - I_zz 1) w: a multiple of the unit tensor has no part in
    w x I w, so the series of a body with three equal moments ends after its second term. A torque that is
    constant in W turns in B: u' = u x w.

    Args:
        w: angular velocity in B, rad/s.
        torque: in B, by powers of that share: one entry if it is constant, N m.
        inertia: the six entries (I_xx, I_xy, I_xz, I_yy, I_yz, I_zz), kg m^2.
        h: length of the step, s.
        steady: a second torque, constant in W, as B sees it at the start, N m.
    """
    xx, xy, xz, yy, yz, zz = inertia
    excess, inverse = (_less(xx, zz), xy, xz, _less(yy, zz), yz, 0.0), _inverse(inertia)
    even = all(isinstance(x, float) and x == 0.0 for x in excess)
    turning = [] if steady is None else [steady]
    rate, momentum = [w], []
    for k in range(len(torque) if even and not turning else _ORDER):
        torques: list[Any] = list(torque[k:k + 1])
        if turning:
            torques.append(turning[k])
            turning.append(last_product(turning, rate).scale(h / (k + 1)))
        if not even:
            momentum.append(_symmetric_times(excess, rate[k]))
            torques.append(last_product(momentum, rate))
        rate.append(_symmetric_times(inverse, total(torques)).scale(h / (k + 1)))
    return rate


def _less(a: Field, b: Field) -> Field:
    """Their difference, known to be nothing where they are one and the same."""
    return 0.0 if a is b else a - b


def _symmetric_times(entries: Sequence[Field], v: Vec3) -> Vec3:
    """Product of a symmetric 3x3 tensor, given by its six entries, with a vector."""
    xx, xy, xz, yy, yz, zz = entries
    return Vec3(
        xx * v.x + xy * v.y + xz * v.z,
        xy * v.x + yy * v.y + yz * v.z,
        xz * v.x + yz * v.y + zz * v.z,
    )


def _inverse(entries: Sequence[Field]) -> tuple[Field, ...]:
    """Inverse of a symmetric 3x3 tensor by cofactors, as its six entries."""
    xx, xy, xz, yy, yz, zz = entries
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    s = 1.0 / (xx * a + xy * b + xz * c)
    return (a * s, b * s, c * s, (xx * zz - xz * xz) * s, (xy * xz - xx * yz) * s,
            (xx * yy - xy * xy) * s)
