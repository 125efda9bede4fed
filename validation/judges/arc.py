"""Positions relative to a target on an orbit, measured along its arc instead of along straight axes.

Equations of relative motion are of the first order in the distance over the radius of the orbit. Read along the
arc, their positions are right to a higher order: a craft 2 km behind its target on the same orbit has x = 0 along
the arc, and is d^2 / 2 R = 0.3 m below the axis y of the Hill frame.
"""

from __future__ import annotations

from rans.model.fields import Field, Vec3, atan2, cos, sin, sqrt


def along_arc(p: Vec3, v: Vec3, radius: Field, climb: Field) -> tuple[Vec3, Vec3]:
    """Position (m) and velocity (m/s) along the arc of a craft in the Hill frame of its target.

    With the distance q from the axis of the orbit, the angle a from the target and the target's radius R they are
    x = q - R, y = R a, and their changes in time; z stays.

    Args:
        p: position in the Hill frame, x radially outwards, y along the track, m.
        v: its rate in that frame, m/s.
        radius: distance R of the target from the planet, m.
        climb: rate of that distance, m/s; 0 on a circle.
    """
    out = radius + p.x
    distance = sqrt(out * out + p.y * p.y)
    angle = atan2(p.y, out)
    rising = climb + v.x
    turning = (out * v.y - p.y * rising) / (distance * distance)
    # The difference of two nearly equal distances keeps its digits as a quotient.
    above = (p.x * (2.0 * radius + p.x) + p.y * p.y) / (distance + radius)
    higher = (out * rising + p.y * v.y) / distance - climb
    return Vec3(above, radius * angle, p.z), Vec3(higher, radius * turning + climb * angle, v.z)


def from_arc(p: Vec3, v: Vec3, radius: Field, climb: Field) -> tuple[Vec3, Vec3]:
    """Position (m) and velocity (m/s) in the Hill frame of what `along_arc` gives; arguments are alike."""
    angle = p.y / radius
    turning = (v.y - climb * angle) / radius
    distance = radius + p.x
    rising = climb + v.x
    s = sin(angle)
    c = cos(angle)
    half = sin(0.5 * angle)
    position = Vec3(p.x * c - 2.0 * radius * half * half, distance * s, p.z)
    return position, Vec3(
        rising * c - distance * s * turning - climb, rising * s + distance * c * turning, v.z
    )
