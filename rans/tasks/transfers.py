"""Transfers of few burns near a circular orbit that end at rest, in closed form over fields.

The motion is linear (`rans.model.drift.ClohessyWiltshire`), so that position and velocity at the arrival are sums
of what every burn does. Across the orbital plane one burn reaches a position, and in the plane two burns along axes
do. What is left of the velocity is braked at the arrival. Thrusters are along the axes: burns cost the sum of their
components.

A burn is now, or after one or more of `PARTS` equal parts of the time. Of every such burn across the plane, and of
the pairs in the plane of which one or none is now, the cheapest is taken. The best transfer of this kind is within
some percent of the optimum, which has few burns too, most of them at both ends (T. N. Edelbaum, "How many
impulses?", Astronautics & Aeronautics 5, 1967).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from rans.model.fields import Field, Vec3, absolute, at_least, cos, sin, where

PARTS = 8
"""Number of equal parts of a transfer's time, between which burns are tried and a ball is looked for."""
_AIMS = 8
"""Number of points on the edge of the position tolerance, in the orbital plane, at which transfers may end."""
_WORTH = 0.005
"""Least share of its price that postponing a burn must save."""
_DETOUR = 8.0
"""Price of every metre that a transfer is too near to a ball, times its time, m/s times s per metre."""
_NEVER = 1e6
"""Price of what is not possible, m/s."""
_NOTHING = 1e-9
"""Added to determinants so that none is zero, m^2 per (m/s)^2."""

Pair = tuple[Field, Field]
"""Components in the orbital plane, x and y."""


@dataclass(frozen=True)
class Ends:
    """Where a transfer may end, and how fast."""

    plane: float
    """Distance from the goal in the orbital plane, m."""
    across: float
    """Distance from the goal across it, m."""
    speed: float
    """Speed along each axis that is not braked, m/s."""
    forgiven: float = 1.1
    """Nothing is corrected within so many times the distances."""


@dataclass(frozen=True)
class KeepOut:
    """A ball at rest, around which transfers go."""

    centre: Vec3
    """m"""
    radius: Field
    """m"""


class Transfer(NamedTuple):
    """The cheapest transfer that was found."""

    burn: Vec3
    """What of it is burnt now, m/s."""
    price: Field
    """Velocity change of all burns, m/s, and a price of every metre within the ball."""
    brake: Field
    """Largest component of the velocity change at the arrival, m/s."""


class _Burn(NamedTuple):
    """A burn along an axis of the orbital plane."""

    axis: int
    """0: x, 1: y."""
    size: Field
    """m/s"""
    begun: int
    """After so many parts of the time."""


class _Choice(NamedTuple):
    """A transfer in the orbital plane."""

    price: Field
    """m/s"""
    brake: Field
    """Largest component of the velocity change at the arrival, m/s."""
    now: Pair
    """Burn now, m/s."""
    aside: Pair
    """Where it arrives, from the goal, m."""

    def or_else(self, better: Field, other: _Choice) -> _Choice:
        """The other one where it is better."""
        return _Choice(
            where(better, other.price, self.price),
            where(better, other.brake, self.brake),
            _chosen(better, other.now, self.now),
            _chosen(better, other.aside, self.aside),
        )


class Effect(NamedTuple):
    """What 1 m/s does within a time."""

    time: Field
    """s"""
    sine: Field
    """Of n t."""
    rise: Field
    """1 - cos(n t)."""

    def place(self, n: float, axis: int) -> Pair:
        """Change of position in the orbital plane, m, by 1 m/s along an axis of it."""
        if axis == 0:
            return self.sine * (1.0 / n), self.rise * (-2.0 / n)
        return self.rise * (2.0 / n), self.sine * (4.0 / n) - self.time * 3.0

    def speed(self, axis: int) -> Pair:
        """Change of velocity in the orbital plane, m/s, by 1 m/s along an axis of it."""
        if axis == 0:
            return 1.0 - self.rise, self.sine * -2.0
        return self.sine * 2.0, 1.0 - self.rise * 4.0


@dataclass(frozen=True)
class Coast:
    """A coast near a circular orbit, from which transfers to a goal are found.

    Args:
        n: mean motion of the orbit, rad/s.
        p: position in W, the target's Hill frame, m.
        v: velocity in W, m/s.
        goal: position in W, m.
        time: until the arrival, > 0, s.
        ends: what counts as the goal.
        acceleration: by thrust along each axis, m/s^2. A later burn that lasts longer than a part of the time is
            dearer.
    """

    n: float
    p: Vec3
    v: Vec3
    goal: Vec3
    time: Field
    ends: Ends
    acceleration: float

    def cheapest(self, ball: KeepOut | None = None) -> Transfer:
        """The cheapest transfer whose burns in the plane may be postponed, beside a ball."""
        across, price, brake, heights = self._across()
        at_once = self._at_once
        best = at_once
        if ball is not None:
            apart = self._apart(ball, heights)
            both = _Burn(0, at_once.now[0], 0), _Burn(1, at_once.now[1], 0)
            best = at_once._replace(price=at_once.price + self._detour(ball, apart, both))
            for choice, burns in self._postponed():
                dearer = choice._replace(price=choice.price + self._detour(ball, apart, burns))
                best = best.or_else(dearer.price < best.price * (1.0 - _WORTH), dearer)
        else:
            for choice, _ in self._postponed():
                best = best.or_else(choice.price < best.price * (1.0 - _WORTH), choice)
        return Transfer(Vec3(*best.now, across), best.price + price, _larger(best.brake, brake))

    def at_once(self) -> Transfer:
        """The cheapest transfer of which at most the burn across the plane is postponed, whatever is in the way."""
        across, price, brake, _ = self._across()
        best = self._at_once
        return Transfer(Vec3(*best.now, across), best.price + price, _larger(best.brake, brake))

    @cached_property
    def _effects(self) -> list[Effect]:
        """After 0, 1, ..., `PARTS` parts of the time; sines of sums are sums of products."""
        half = 0.5 * self.n / PARTS * self.time
        one = sin(half), cos(half)
        s, c = self.time * 0.0, self.time * 0.0 + 1.0
        found = []
        for k in range(PARTS + 1):
            found.append(Effect(self.time * (k / PARTS), 2.0 * s * c, 2.0 * s * s))
            s, c = s * one[1] + c * one[0], c * one[1] - s * one[0]
        return found

    def _place(self, k: int) -> Vec3:
        """Position after so many parts of the time, without burns, m."""
        p, v, effect = self.p, self.v, self._effects[k]
        (a, b), (c, d) = effect.place(self.n, 0), effect.place(self.n, 1)
        return Vec3(
            p.x * (1.0 + 3.0 * effect.rise) + v.x * a + v.y * c,
            p.y + p.x * (6.0 * (effect.sine - self.n * effect.time)) + v.x * b + v.y * d,
            p.z * (1.0 - effect.rise) + v.z * a,
        )

    @cached_property
    def _missed(self) -> Vec3:
        """Vector from the place at the arrival, without burns, to the goal, m."""
        return self.goal - self._place(PARTS)

    @cached_property
    def _at_goal(self) -> Vec3:
        """Velocity at the arrival without burns, m/s."""
        p, v, effect = self.p, self.v, self._effects[PARTS]
        (a, b), (c, d) = effect.speed(0), effect.speed(1)
        return Vec3(
            p.x * (3.0 * self.n * effect.sine) + v.x * a + v.y * c,
            v.x * b + v.y * d - p.x * (6.0 * self.n * effect.rise),
            v.z * a - p.z * (self.n * effect.sine),
        )

    def _left(self, speed: Field) -> Field:
        """What is braked of a speed along an axis, m/s."""
        return at_least(absolute(speed) - self.ends.speed, 0.0)

    def _across(self) -> tuple[Field, Field, Field, list[Field]]:
        """Burn now across the plane, price and brake of the best one, m/s, and its heights, m."""
        n = self.n
        missed, at_goal = self._missed.z, self._at_goal.z
        brake = self._left(at_goal)
        near = absolute(missed) < self.ends.across * self.ends.forgiven
        zero = self.time * 0.0
        price = where(near, brake, zero + _NEVER)
        now, size = zero, zero
        sine, rise, begun = zero, zero, zero
        for j in range(PARTS):
            rest, effect = self._effects[PARTS - j], self._effects[j]
            for side in (self.ends.across, -self.ends.across):
                burn = (missed + side) * n / rest.sine
                braked = self._left(at_goal + burn * (1.0 - rest.rise))
                total = absolute(burn) + braked
                better = total < (price * (1.0 - _WORTH) if j else price)
                price = where(better, total, price)
                brake = where(better, braked, brake)
                now = where(better, zero if j else burn, now)
                size = where(better, burn, size)
                sine = where(better, effect.sine, sine)
                rise = where(better, effect.rise, rise)
                begun = where(better, effect.time, begun)
        heights = []
        for k, effect in enumerate(self._effects):
            # sin(a - b), after the burn.
            since = effect.sine * (1.0 - rise) - (1.0 - effect.rise) * sine
            burnt = where(effect.time > begun, since * size * (1.0 / n), zero)
            heights.append(self._place(k).z + burnt)
        return now, price, brake, heights

    @cached_property
    def _at_once(self) -> _Choice:
        """The cheapest transfer in the plane with a burn now and a brake at the arrival."""
        missed, ends = self._missed, self.ends
        zero = self.time * 0.0
        whole = self._effects[PARTS]
        places = whole.place(self.n, 0), whole.place(self.n, 1)
        speeds = whole.speed(0), whole.speed(1)
        price, brake = self._braked((zero, zero), speeds)
        near = missed.x * missed.x + missed.y * missed.y < (ends.plane * ends.forgiven) ** 2
        best = _Choice(where(near, price, zero + _NEVER), brake, (zero, zero), (zero, zero))
        for k in range(_AIMS):
            angle = 2.0 * math.pi * k / _AIMS
            aside = zero + ends.plane * math.cos(angle), zero + ends.plane * math.sin(angle)
            sizes = solved(*places, (missed.x + aside[0], missed.y + aside[1]))
            price, brake = self._braked(sizes, speeds)
            best = best.or_else(price < best.price, _Choice(price, brake, sizes, aside))
        return best

    def _postponed(self) -> list[tuple[_Choice, tuple[_Burn, _Burn]]]:
        """Transfers in the plane to the same place, of which one or both burns are later."""
        aside = self._at_once.aside
        missed = self._missed.x + aside[0], self._missed.y + aside[1]
        zero = self.time * 0.0
        whole = self._effects[PARTS]
        found = []
        for j in range(1, PARTS):
            rest = self._effects[PARTS - j]
            for first, second, begun in ((0, 1, 0), (1, 0, 0), (1, 1, 0), (0, 1, j)):
                effect = rest if begun else whole
                sizes = solved(effect.place(self.n, first), rest.place(self.n, second), missed)
                price, brake = self._braked(sizes, (effect.speed(first), rest.speed(second)))
                price = price + self._too_long(sizes[1])
                if begun:
                    price = price + self._too_long(sizes[0])
                burnt = zero if begun else sizes[0]
                now = (burnt, zero) if first == 0 else (zero, burnt)
                burns = _Burn(first, sizes[0], begun), _Burn(second, sizes[1], j)
                found.append((_Choice(price, brake, now, aside), burns))
        return found

    def _too_long(self, size: Field) -> Field:
        """What is too much of a later burn for a part of the time, m/s."""
        return at_least(absolute(size) - self.time * (self.acceleration / PARTS), 0.0)

    def _braked(self, sizes: Pair, speeds: tuple[Pair, Pair]) -> tuple[Field, Field]:
        """Price of two burns in the plane with the brake at the arrival, and its larger component, m/s."""
        (u, w), (first, second) = sizes, speeds
        x = self._left(self._at_goal.x + u * first[0] + w * second[0])
        y = self._left(self._at_goal.y + u * first[1] + w * second[1])
        return absolute(u) + absolute(w) + x + y, _larger(x, y)

    def _apart(self, ball: KeepOut, heights: Sequence[Field]) -> list[tuple[Field, Field, Field]]:
        """Position in the plane from a ball's centre, and the square of the least distance there, after each part.

        A transfer may be nearest halfway between two of these points, which the square includes.
        """
        halfway = (self.goal - self.p).scale(0.5 / PARTS)
        square = ball.radius * ball.radius + halfway.dot(halfway)
        found = []
        for k, height in enumerate(heights):
            place = self._place(k) - ball.centre
            above = height - ball.centre.z
            found.append((place.x, place.y, square - above * above))
        return found

    def _detour(
        self,
        ball: KeepOut,
        apart: Sequence[tuple[Field, Field, Field]],
        burns: tuple[_Burn, _Burn],
    ) -> Field:
        """Price of the way past a ball, m/s."""
        most = self.time * 0.0
        for k in range(1, PARTS + 1):
            x, y, least = apart[k]
            for axis, size, begun in burns:
                if k > begun:
                    effect = self._effects[k - begun].place(self.n, axis)
                    x = x + size * effect[0]
                    y = y + size * effect[1]
            most = _larger(most, least - x * x - y * y)
        return most * (_DETOUR / (2.0 * ball.radius * self.time))


def solved(first: Pair, second: Pair, missed: Pair) -> Pair:
    """Factors of two vectors in the plane whose sum is a third."""
    determinant = first[0] * second[1] - first[1] * second[0]
    # Vectors along one line solve nothing: factors are huge then.
    scale = 1.0 / (determinant + _NOTHING)
    return (
        (missed[0] * second[1] - missed[1] * second[0]) * scale,
        (first[0] * missed[1] - first[1] * missed[0]) * scale,
    )


def _larger(a: Field, b: Field) -> Field:
    return where(a > b, a, b)


def _chosen(condition: Field, a: Pair, b: Pair) -> Pair:
    return where(condition, a[0], b[0]), where(condition, a[1], b[1])
