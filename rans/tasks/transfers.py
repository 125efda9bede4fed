"""Transfers of few burns near a circular orbit that end at rest, in closed form over fields.

Equations of motion are linear (`rans.model.drift.ClohessyWiltshire`), so that the position and the velocity at the
arrival are sums of what every burn does. Across the orbital plane one burn reaches a position; in the plane two
burns along axes do. What is left of the velocity is braked at the arrival. Thrusters are along the axes, and pay
for the sum of the components.

The burns of a transfer are now, or after a tenth, two tenths, ... of the time. All pairs of a burn now and another
one are compared, each with its way past a keep-out ball.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from rans.model.fields import Field, Vec3, absolute, at_least, cos, sin, where

PARTS = 8
"""Number of equal parts of a transfer's time, between which burns are tried and the way past a ball is looked at."""
_AIMS = 8
"""Number of points on the edge of the position tolerance, in the orbital plane, at which transfers may end."""
_WORTH = 0.005
"""Least share of its price that postponing a burn must save."""
_NOTHING = 1e-9
"""Added to determinants so that none is zero, m^2 per (m/s)^2."""


class _After(NamedTuple):
    """What a burn has done after a time."""

    time: Field
    """s"""
    sine: Field
    """Of n t."""
    rise: Field
    """1 - cos(n t)."""

    def along_x(self, n: float) -> tuple[Field, Field]:
        """Change of position in the plane by 1 m/s along x, m."""
        return self.sine * (1.0 / n), self.rise * (-2.0 / n)

    def along_y(self, n: float) -> tuple[Field, Field]:
        """Change of position in the plane by 1 m/s along y, m."""
        return self.rise * (2.0 / n), self.sine * (4.0 / n) - self.time * 3.0

    def speeds(self) -> tuple[tuple[Field, Field], tuple[Field, Field]]:
        """Change of velocity by 1 m/s along x, and along y, m/s."""
        return (1.0 - self.rise, self.sine * -2.0), (self.sine * 2.0, 1.0 - self.rise * 4.0)

    def coast(self, n: float, p: Vec3, v: Vec3) -> Vec3:
        """Position, m, of a coast."""
        (a, b), (c, d) = self.along_x(n), self.along_y(n)
        return Vec3(
            p.x * (1.0 + 3.0 * self.rise) + v.x * a + v.y * c,
            p.y + p.x * (6.0 * (self.sine - n * self.time)) + v.x * b + v.y * d,
            p.z * (1.0 - self.rise) + v.z * a,
        )

    def speed(self, n: float, p: Vec3, v: Vec3) -> Vec3:
        """Velocity, m/s, of a coast."""
        (a, b), (c, d) = self.speeds()
        return Vec3(
            p.x * (3.0 * n * self.sine) + v.x * a + v.y * c,
            v.x * b + v.y * d - p.x * (6.0 * n * self.rise),
            v.z * a - p.z * (n * self.sine),
        )


@dataclass(frozen=True)
class Tolerance:
    """How far from the goal a transfer may end."""

    plane: float
    """Distance in the orbital plane, m."""
    across: float
    """Distance across it, m."""
    speed: float
    """Speed along each axis, m/s."""
    forgiven: float = 1.1
    """Nothing is corrected up to so many times these distances."""


@dataclass(frozen=True)
class KeepOut:
    """A ball at rest, around which transfers go."""

    centre: Vec3
    """m"""
    radius: Field
    """m, with a reserve."""


class Transfer(NamedTuple):
    """The cheapest transfer that was found."""

    burn: Vec3
    """What of it is burnt now, m/s."""
    price: Field
    """Velocity change of all burns, and of the way past the ball, m/s."""
    brake: Field
    """Largest component of the velocity change at the arrival, m/s."""


def cheapest(
    n: float,
    p: Vec3,
    v: Vec3,
    goal: Vec3,
    time: Field,
    ends: Tolerance,
    ball: KeepOut | None = None,
    later: bool = True,
) -> Transfer:
    """The cheapest transfer from a state to rest at a goal after a time.

    Args:
        n: mean motion of the orbit, rad/s.
        p: position in W, m.
        v: velocity in W, m/s.
        goal: position in W, m.
        time: until the arrival, > 0, s.
        ends: what counts as the goal.
        ball: is not entered, as far as can be seen from `PARTS` straight lines.
    """
    after = _clock(n, time)
    whole = after[PARTS]
    natural = [one.coast(n, p, v) for one in after]
    at_goal = whole.speed(n, p, v)
    missed = goal - natural[PARTS]
    zero = time * 0.0

    def left(speed: Field) -> Field:
        return at_least(absolute(speed) - ends.speed, 0.0)

    # Across the orbital plane: one burn, at the best time.
    z_price = left(at_goal.z)
    z_price = where(absolute(missed.z) < ends.across * ends.forgiven, z_price, zero + math.inf)
    z_brake = left(at_goal.z)
    z_burns = [zero] * PARTS
    for j in range(PARTS):
        then = after[PARTS - j]
        for side in (ends.across, -ends.across):
            size = (missed.z + side) * n / then.sine
            brake = left(at_goal.z + size * (1.0 - then.rise))
            price = absolute(size) + brake
            better = price < z_price if j == 0 else price < z_price * (1.0 - _WORTH)
            z_price = where(better, price, z_price)
            z_brake = where(better, brake, z_brake)
            z_burns = [
                where(better, size if k == j else zero, one) for k, one in enumerate(z_burns)
            ]
    zs = [
        natural[k].z
        + sum((z_burns[j] * after[k - j].sine * (1.0 / n) for j in range(min(k, PARTS))), zero)
        for k in range(PARTS + 1)
    ]

    # In the plane: where to arrive, for burns now.
    near = missed.x * missed.x + missed.y * missed.y < (ends.plane * ends.forgiven) ** 2
    brakes = left(at_goal.x), left(at_goal.y)
    best = _Best(
        where(near, brakes[0] + brakes[1], zero + math.inf), brakes, zero, zero, zero, zero
    )
    now = whole.along_x(n), whole.along_y(n)
    speeds = whole.speeds()
    for k in range(_AIMS):
        angle = 2.0 * math.pi * k / _AIMS
        a, b = ends.plane * math.cos(angle), ends.plane * math.sin(angle)
        u, w = _solved(*now, (missed.x + a, missed.y + b))
        brakes = (
            left(at_goal.x + u * speeds[0][0] + w * speeds[1][0]),
            left(at_goal.y + u * speeds[0][1] + w * speeds[1][1]),
        )
        price = absolute(u) + absolute(w) + brakes[0] + brakes[1]
        best = best.or_else(price < best.price, _Best(price, brakes, u, w, zero + a, zero + b))
    m = missed.x + best.a, missed.y + best.b

    # The way past the ball, which may come nearest halfway between two points.
    beside = natural
    squares = [zero] * (PARTS + 1)
    per_lack = zero
    if ball is not None:
        step = (goal - p).scale(0.5 / PARTS)
        square = ball.radius * ball.radius + step.dot(step)
        beside = [one - ball.centre for one in natural]
        squares = [square - (z - ball.centre.z) * (z - ball.centre.z) for z in zs]
        per_lack = DETOUR / (2.0 * ball.radius * time)

    def detour(*burns: tuple[int, Field, int]) -> Field:
        """Price of the way past the ball for burns along an axis of the plane, of a size, after so many parts."""
        if ball is None:
            return zero
        lack = zero
        for k in range(1, PARTS + 1):
            x, y = beside[k].x, beside[k].y
            for axis, size, begun in burns:
                if k > begun:
                    then = after[k - begun]
                    effect = then.along_y(n) if axis else then.along_x(n)
                    x = x + size * effect[0]
                    y = y + size * effect[1]
            short = squares[k] - x * x - y * y
            lack = where(short > lack, short, lack)
        return lack * per_lack

    best = best._replace(price=best.price + detour((0, best.u, 0), (1, best.w, 0)))

    # One of the two burns later, or both.
    for j in range(1, PARTS) if later else ():
        then = after[PARTS - j]
        later = then.along_x(n), then.along_y(n)
        then_speeds = then.speeds()
        for first, second in ((0, 1), (1, 0), (1, 1)):
            u, w = _solved(now[first], later[second], m)
            brakes = tuple(
                left(x + u * speeds[first][i] + w * then_speeds[second][i])
                for i, x in enumerate((at_goal.x, at_goal.y))
            )
            price = absolute(u) + absolute(w) + brakes[0] + brakes[1]
            price = price + detour((first, u, 0), (second, w, j))
            mine = _Best(
                price, brakes, u if first == 0 else zero, u if first == 1 else zero, zero, zero
            )
            best = best.or_else(price < best.price * (1.0 - _WORTH), mine)
        u, w = _solved(*later, m)
        brakes = tuple(
            left(x + u * then_speeds[0][i] + w * then_speeds[1][i])
            for i, x in enumerate((at_goal.x, at_goal.y))
        )
        price = absolute(u) + absolute(w) + brakes[0] + brakes[1]
        price = price + detour((0, u, j), (1, w, j))
        best = best.or_else(
            price < best.price * (1.0 - _WORTH), _Best(price, brakes, zero, zero, zero, zero)
        )
    brake = z_brake
    for one in best.brakes:
        brake = where(one > brake, one, brake)
    return Transfer(Vec3(best.u, best.w, z_burns[0]), best.price + z_price, brake)


DETOUR = 8.0
"""Velocity change, m/s, that an arrival after 1 s costs for every metre that a transfer is too near to a ball."""


class _Best(NamedTuple):
    price: Field
    brakes: tuple[Field, ...]
    u: Field
    w: Field
    a: Field
    b: Field

    def or_else(self, better: Any, other: _Best) -> _Best:
        return _Best(
            where(better, other.price, self.price),
            tuple(where(better, x, y) for x, y in zip(other.brakes, self.brakes, strict=True)),
            *(where(better, x, y) for x, y in zip(other[2:], self[2:], strict=True)),
        )


def _clock(n: float, time: Field) -> list[_After]:
    """After 0, 1, ..., `PARTS` parts of a time; sines of sums need no further sines."""
    half = 0.5 * n / PARTS * time
    first = sin(half), cos(half)
    s, c = time * 0.0, time * 0.0 + 1.0
    found = []
    for k in range(PARTS + 1):
        found.append(_After(time * (k / PARTS), 2.0 * s * c, 2.0 * s * s))
        s, c = s * first[1] + c * first[0], c * first[1] - s * first[0]
    return found


def _solved(
    first: tuple[Field, Field], second: tuple[Field, Field], missed: tuple[Field, Field]
) -> tuple[Field, Field]:
    """Factors of two vectors in the plane whose sum is a third."""
    determinant = first[0] * second[1] - first[1] * second[0]
    # Vectors along one line solve nothing: factors are huge then.
    scale = 1.0 / (determinant + _NOTHING)
    return (
        (missed[0] * second[1] - missed[1] * second[0]) * scale,
        (first[0] * missed[1] - first[1] * missed[0]) * scale,
    )
