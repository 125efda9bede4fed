"""Velocity with which a free point reaches a target: Lambert's problem in a drift."""

from __future__ import annotations

from typing import Any

from rans.extend import AnyVector, Drift, Field, Vec2, Vec3


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
        return Vec2(  # pyrefly: ignore[bad-return]
            (missing.x * b.y - missing.y * b.x) * scale, (a.x * missing.y - a.y * missing.x) * scale
        )
    a, b, c = reach
    across = b.cross(c)
    scale = 1.0 / a.dot(across)
    return Vec3(  # pyrefly: ignore[bad-return]
        missing.dot(across) * scale,
        missing.dot(c.cross(a)) * scale,
        missing.dot(a.cross(b)) * scale,
    )
