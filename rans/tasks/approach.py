"""Approach to a goal near a circular orbit by few burns, inside a cone that opens along -x.

Everything is in closed form over fields. The motion is linear, so that position and velocity at the arrival are
sums of what every burn does (`rans.tasks.transfers`). Thrusters are along the axes and throttled: a burn is
constant during a control period, which is as good as an impulse in its middle. The last burn is in the period
before the arrival. It brakes no more than the mission asks, because what is left of the velocity needs no impulse.

Two transfers are found: the cheapest one, and the cheapest one that stays inside the cone. Transfers to the same
place may be mixed, because the motion is linear, and a mixture of two places in a cone is inside it. What is flown
is a mixture: as much of the cheapest transfer as the cone allows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import NamedTuple

from rans.model.drift import ClohessyWiltshire
from rans.model.fields import Field, Vec3, absolute, at_least, cos, map_leaves, sin, sqrt, where
from rans.tasks.transfers import Effect, solved

LATER = tuple(1.4**k for k in range(6))
"""Times before the arrival at which later burns are tried, over that at which the cone begins to apply."""
_CHECKED = (0.25, 1.0)
"""Distances from the goal where a transfer is compared with the cone, over that within which the cone applies."""
_WORTH = 0.005
"""Least share of its price that postponing a burn must save."""
_SOON = 4.5
"""Control periods before the arrival from which on no burn is postponed."""
_OUTSIDE = 1e3
"""Price of each unit of the slope by which a transfer is outside the cone, m/s."""
_WITHIN = 0.98
"""Share of the cone that a transfer uses whose later burn is made for it."""
_STEPS = 2
"""Number of times that the size of this burn is improved."""
_SLOWEST = 0.01
"""Speed along the axis of the cone that is expected at least, m/s."""
_NOTHING = 1e-9
"""Added to divisors so that none is zero."""


class Burn(NamedTuple):
    """A burn along an axis."""

    axis: int
    """0, 1, 2: x, y, z."""
    size: Field
    """m/s"""
    begun: int
    """0: now; k: at the kth of the times `LATER`."""


class Transfer(NamedTuple):
    """A transfer that reaches the goal."""

    price: Field
    """Velocity change of all burns, m/s."""
    burn: Vec3
    """What of it is burnt now, m/s."""
    at_goal: Vec3
    """Velocity at the arrival before the brake, m/s."""

    def or_else(self, better: Field, other: Transfer) -> Transfer:
        """The other one where it is better."""
        chosen = map_leaves(lambda mine, its: where(better, its, mine), tuple(self), tuple(other))
        return Transfer(*chosen)

    def mixed(self, other: Transfer, share: Field) -> Transfer:
        """A mixture with a share of another one; its price is at most this."""
        mixture = map_leaves(lambda a, b: a + (b - a) * share, tuple(self), tuple(other))
        return Transfer(*mixture)


@dataclass(frozen=True)
class Approach:
    """Transfers from a state to a goal at rest, with a brake in the last control period.

    Args:
        n: mean motion of the orbit, rad/s.
        p: position in W, the target's Hill frame, m.
        v: velocity in W, m/s.
        goal: position in W, m.
        left: until the arrival, which is the end of a control period, s.
        period: control period, s.
        speed: speed that is not braked, m/s.
        slope: tangent of the angle from the axis of the cone up to which transfers go.
        reach: distance from the goal along the axis within which the cone applies, m.
        depth: distance of the cone's apex behind the goal, m.
    """

    n: float
    p: Vec3
    v: Vec3
    goal: Vec3
    left: Field
    period: float
    speed: float
    slope: float
    reach: float
    depth: float

    def burn(self) -> Vec3:
        """Velocity change in W for the control period that begins now, m/s."""
        cheapest = self._cheapest()
        inside = self._inside()
        chosen = cheapest.mixed(inside, self._share(cheapest, inside))
        soon = self.left < _SOON * self.period
        last = self.left < 1.5 * self.period
        burn = chosen.or_else(soon, self._at_once).burn
        return map_leaves(lambda brake, other: where(last, brake, other), self._brake(), burn)

    def price(self) -> Field:
        """Velocity change of going to the goal with a burn now and a brake at the arrival, m/s."""
        return self._at_once.price

    @cached_property
    def _time(self) -> Field:
        """From the middle of this period to that of the last one, s."""
        return at_least(self.left - self.period, 0.5 * self.period)

    @cached_property
    def _coast(self) -> tuple[Vec3, Vec3]:
        """Position, m, and velocity, m/s, in the middle of the last period without any burn."""
        return ClohessyWiltshire(self.n).carry(self.p, self.v, self._time + 0.5 * self.period)

    @cached_property
    def _now(self) -> Effect:
        """What 1 m/s now does until the arrival."""
        return self._effect(self._time)

    @cached_property
    def _later(self) -> list[Effect]:
        """What 1 m/s does until the arrival at the times `LATER`; burns nearer to the goal leave the cone."""
        entered = self.reach / at_least(self._first.at_goal.x, _SLOWEST)
        found = []
        for k in LATER:
            rest = entered * k
            found.append(self._effect(where(rest < self._time, rest, self._time)))
        return found

    def _effect(self, time: Field) -> Effect:
        """What 1 m/s does within a time, s."""
        return Effect(time, sin(self.n * time), 1.0 - cos(self.n * time))

    def _of(self, begun: int) -> Effect:
        """What 1 m/s of a burn does that begins now or at the kth of the times `LATER`."""
        return self._later[begun - 1] if begun else self._now

    @cached_property
    def _first(self) -> Transfer:
        """The transfer with a burn now to the goal itself; its price is that without a brake at most."""
        return self._by(self._plane(0, 0, 1, 0, self.goal - self._coast[0]), None)

    @cached_property
    def _kept(self) -> Field:
        """Size up to which components of the velocity are not braked, m/s."""
        return unbraked(self._first.at_goal, self.speed)

    @cached_property
    def _missed(self) -> Vec3:
        """Vector from where the coast ends to the brake, from where the velocity that is left reaches the goal."""
        after = _clipped(self._first.at_goal, self._kept).scale(0.5 * self.period)
        return self.goal - after - self._coast[0]

    @cached_property
    def _at_once(self) -> Transfer:
        """The transfer with a burn now."""
        return self._by(self._plane(0, 0, 1, 0, self._missed), self._kept)

    def _plane(self, a: int, j: int, b: int, k: int, missed: Vec3, across: int = 0) -> list[Burn]:
        """Burns along axes a and b of the plane at times j and k, and one across it, that reach what is missed."""
        one, other = self._of(j).place(self.n, a), self._of(k).place(self.n, b)
        first, second = solved(one, other, (missed.x, missed.y))
        height = missed.z * self.n / self._of(across).sine
        return [Burn(a, first, j), Burn(b, second, k), Burn(2, height, across)]

    def _by(self, burns: Sequence[Burn], kept: Field | None) -> Transfer:
        """A transfer by burns, which ends with components of the velocity up to a size, m/s."""
        price = self._time * 0.0
        now = [price, price, price]
        v = list(self._coast[1].columns())
        for axis, size, begun in burns:
            effect = self._of(begun)
            price = price + absolute(size)
            if axis == 2:
                v[2] = v[2] + size * (1.0 - effect.rise)
            else:
                along, beside = effect.speed(axis)
                v[0] = v[0] + size * along
                v[1] = v[1] + size * beside
            if begun == 0:
                now[axis] = now[axis] + size
        if kept is not None:
            for speed in v:
                price = price + at_least(absolute(speed) - kept, 0.0)
        return Transfer(price, Vec3(*now), Vec3(*v))

    @cached_property
    def _postponed(self) -> list[tuple[Field, Transfer]]:
        """Transfers of which burns are later, and whether that is possible."""
        found = []
        for j in range(1, len(LATER) + 1):
            possible = self._of(j).time < self._time
            for across in (0, j):
                for a, b, first in ((0, 1, 0), (1, 0, 0), (0, 0, 0), (1, 1, 0), (0, 1, j)):
                    burns = self._plane(a, first, b, j, self._missed, across)
                    found.append((possible, self._by(burns, self._kept)))
        return found

    def _cheapest(self) -> Transfer:
        """The cheapest transfer, inside the cone or not."""
        best = self._at_once
        for possible, other in self._postponed:
            best = best.or_else(possible & (other.price < best.price * (1.0 - _WORTH)), other)
        return best

    def _inside(self) -> Transfer:
        """The cheapest transfer that is inside the cone, or the one that is least outside."""
        best = self._dearer(self._at_once)
        others = [*self._postponed, *(self._bent(j) for j in range(1, len(LATER) + 1))]
        for possible, transfer in others:
            other = self._dearer(transfer)
            best = best.or_else(possible & (other.price < best.price * (1.0 - _WORTH)), other)
        return best

    def _bent(self, j: int) -> tuple[Field, Transfer]:
        """The transfer with a burn now and one along y later, of the size that the cone asks for."""
        later = self._of(j)
        place, speed = later.place(self.n, 1), later.speed(1)
        x, y = (self._now.place(self.n, axis) for axis in (0, 1))
        u, w = solved(x, y, (0.0 - place[0], 0.0 - place[1]))
        along, beside = self._now.speed(0), self._now.speed(1)
        # Of 1 m/s later, with burns now that undo its displacement.
        ahead = u * along[0] + w * beside[0] + speed[0]
        aside = u * along[1] + w * beside[1] + speed[1]
        once = self._at_once.at_goal
        size = self._time * 0.0
        for _ in range(_STEPS):
            most = size * 0.0
            forward = at_least(once.x + size * ahead, _SLOWEST)
            for beyond, slope in self._checks():
                radius = slope * _WITHIN * forward
                width = sqrt(at_least(radius * radius - once.z * once.z, 0.0))
                offset = once.y + beyond
                wanted = where(offset > width, width, where(offset < -width, -width, offset))
                change = wanted - offset
                most = where(absolute(change) > absolute(most), change, most)
            size = most * aside / (aside * aside + _NOTHING)
        burns = self._plane(0, 0, 1, 0, self._missed)
        burns[0] = burns[0]._replace(size=burns[0].size + u * size)
        burns[1] = burns[1]._replace(size=burns[1].size + w * size)
        return later.time < self._time, self._by([*burns, Burn(1, size, j)], self._kept)

    def _checks(self) -> list[tuple[float, float]]:
        """Speed across the axis by which the arc of a coast differs from a line, m/s, and slope of the cone there.

        On the last d metres the frame turns by n d / v, so that velocity and chord differ by n d.
        """
        found = []
        for share in _CHECKED:
            distance = self.reach * share
            found.append((self.n * distance, self.slope * (1.0 + self.depth / distance)))
        return found

    def _slopes(self, at_goal: Vec3) -> list[Field]:
        """By how much a transfer's slope is above that of the cone, at both checks."""
        forward = at_least(at_goal.x, _NOTHING)
        found = []
        for beyond, slope in self._checks():
            offset = at_goal.y + beyond
            found.append(sqrt(offset * offset + at_goal.z * at_goal.z) / forward - slope)
        return found

    def _dearer(self, transfer: Transfer) -> Transfer:
        """The transfer with a price for being outside the cone."""
        over = at_least(reduce(_larger, self._slopes(transfer.at_goal)), 0.0)
        return transfer._replace(price=transfer.price + over * _OUTSIDE)

    def _share(self, cheapest: Transfer, inside: Transfer) -> Field:
        """Share of the transfer inside the cone with which a mixture is inside, too: distances mix at most so."""
        share = self._time * 0.0
        pairs = zip(self._slopes(cheapest.at_goal), self._slopes(inside.at_goal), strict=True)
        for far, near in pairs:
            over = at_least(far, 0.0)
            under = at_least(0.0 - near, 0.0)
            share = _larger(share, over / (over + under + _NOTHING))
        return share

    def _brake(self) -> Vec3:
        """The brake of a period that begins now, m/s."""
        after = self._time * 0.0 + self.period
        _, at_goal = ClohessyWiltshire(self.n).carry(self.p, self.v, after)
        brake = _clipped(at_goal, unbraked(at_goal, self.speed)) - at_goal
        # In the rest of the period the frame turns what is braked.
        _, aside = self._effect(0.5 * after).speed(0)
        at_goal = at_goal + Vec3(0.0 - brake.y * aside, brake.x * aside, brake.z * 0.0)
        return _clipped(at_goal, unbraked(at_goal, self.speed)) - at_goal


def unbraked(velocity: Vec3, speed: float) -> Field:
    """Size up to which components stay, m/s, so that thrusters along the axes brake least to a speed, m/s.

    Components that are smaller stay as they are, and the others are braked to this size.
    """
    sizes = [absolute(x) for x in velocity.columns()]
    largest = reduce(_larger, sizes)
    smallest = 0.0 - reduce(_larger, [0.0 - x for x in sizes])
    middle = sizes[0] + sizes[1] + sizes[2] - largest - smallest
    square = largest * 0.0 + speed * speed
    of_three = sqrt(square * (1.0 / 3.0))
    rest = at_least(square - smallest * smallest, 0.0)
    of_two = sqrt(rest * 0.5)
    of_one = sqrt(at_least(rest - middle * middle, 0.0))
    size = where(middle < of_two, of_one, of_two)
    return where(smallest < of_three, size, of_three)


def _clipped(velocity: Vec3, size: Field) -> Vec3:
    """Components no larger than a size."""
    return Vec3(
        *(where(x > size, size, where(x < 0.0 - size, 0.0 - size, x)) for x in velocity.columns())
    )


def _larger(a: Field, b: Field) -> Field:
    return where(a > b, a, b)
