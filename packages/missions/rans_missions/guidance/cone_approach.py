"""Approach to a goal near a circular orbit by few burns, inside a cone that opens along -x.

Everything is in closed form over fields. The motion is linear, so that position and velocity at the arrival are
sums of what every burn does (`rans_missions.guidance.impulses`). Thrusters are along the axes and throttled: a burn
is constant during a control period, which is as good as an impulse in its middle. The last burn is in the period
before the arrival. It brakes no more than the mission asks, because the velocity that remains needs no impulse.

Two transfers are computed: the cheapest one, and the cheapest one that stays inside the cone. Transfers to the same
position may be mixed, because the motion is linear, and a mixture of two points of a cone is inside it. The craft
flies a mixture: as much of the cheapest transfer as the cone allows. It is traced into kernels and pages with the
mission's step: only arithmetic on fields is allowed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import NamedTuple

from rans.extend import (
    ClohessyWiltshire,
    Field,
    Vec3,
    absolute,
    at_least,
    map_leaves,
    sqrt,
    where,
)
from rans_missions.guidance.impulses import (
    LEAST_SAVING,
    SINGULAR_OFFSET,
    ImpulseResponse,
    larger,
    two_impulses,
)

BURN_TIMES = tuple(1.4**k for k in range(6))
"""Times before the arrival at which later burns are tried, in multiples of the time that the craft is within reach
of the cone: from there on, which is the latest burn that does not bend the way inside the cone, to 5.4 times as
early."""
_CHECKED_DISTANCES = (0.25, 1.0)
"""Distances from the goal at which a transfer is compared with the cone, in multiples of the cone's reach: near the
goal, where the arc has turned into the final direction, and where the cone begins to apply."""
_COMMITTED_PERIODS = 4.5
"""Control periods before the arrival from which on no burn is postponed: those left are needed for corrections."""
_OUTSIDE_PRICE = 1e3
"""Price of each unit of the slope by which a transfer is outside the cone, m/s: more than any transfer costs."""
_CONE_USE = 0.98
"""Part of the cone's slope that a bent transfer uses: the rest is for errors of its burns."""
_BEND_ITERATIONS = 2
"""Number of corrections to the size of the later burn of a bent transfer; the cone's width changes with it."""
_LEAST_CLOSING_SPEED = 0.01
"""Lower bound of the speed along the axis of the cone in divisions, m/s."""


class Burn(NamedTuple):
    """A burn along an axis."""

    axis: int
    """0, 1, 2: x, y, z."""
    size: Field
    """Velocity change, m/s."""
    start: int
    """0: now; k: at the kth of `BURN_TIMES`."""


class Transfer(NamedTuple):
    """A transfer that reaches the goal."""

    price: Field
    """Velocity change of all burns, m/s."""
    burn: Vec3
    """Velocity change of its burns that are now, m/s."""
    at_goal: Vec3
    """Velocity at the arrival before the brake, m/s."""

    def replaced_where(self, better: Field, candidate: Transfer) -> Transfer:
        """This transfer, or another one where that is better."""
        leaves = map_leaves(
            lambda mine, its: where(better, its, mine), tuple(self), tuple(candidate)
        )
        return Transfer(*leaves)

    def mixed(self, other: Transfer, fraction: Field) -> Transfer:
        """A mixture with a fraction of another transfer; its true price is at most that of the mixture."""
        mixture = map_leaves(lambda a, b: a + (b - a) * fraction, tuple(self), tuple(other))
        return Transfer(*mixture)


@dataclass(frozen=True)
class ConeApproach:
    """Transfers from a state to a goal at rest, with a brake in the last control period.

    Args:
        n: mean motion of the orbit, rad/s.
        p: position in W, the target's Hill frame, m.
        v: velocity in W, m/s.
        goal: position in W, m.
        time_left: until the arrival, which is the end of a control period, s.
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
    time_left: Field
    period: float
    speed: float
    slope: float
    reach: float
    depth: float

    def burn(self) -> Vec3:
        """Velocity change in W for the control period that begins now, m/s.

        The last period brakes whatever the plan is, and shortly before it nothing is postponed any more.
        """
        cheapest = self._cheapest()
        inside = self._cheapest_inside()
        mixture = cheapest.mixed(inside, self._inside_fraction(cheapest, inside))
        committed = self.time_left < _COMMITTED_PERIODS * self.period
        last_period = self.time_left < 1.5 * self.period
        burn = mixture.replaced_where(committed, self._burning_now).burn
        return map_leaves(
            lambda brake, other: where(last_period, brake, other), self._brake(), burn
        )

    def price(self) -> Field:
        """Velocity change of going to the goal with a burn now and a brake at the arrival, m/s."""
        return self._burning_now.price

    @cached_property
    def _time(self) -> Field:
        """Time from the middle of this period to that of the last one, s."""
        return at_least(self.time_left - self.period, 0.5 * self.period)

    @cached_property
    def _coast(self) -> tuple[Vec3, Vec3]:
        """Position, m, and velocity, m/s, in the middle of the last period without any burn."""
        return ClohessyWiltshire(self.n).carry(self.p, self.v, self._time + 0.5 * self.period)

    @cached_property
    def _response_now(self) -> ImpulseResponse:
        """Response at the arrival to an impulse now."""
        return ImpulseResponse.after(self.n, self._time)

    @cached_property
    def _later_responses(self) -> list[ImpulseResponse]:
        """Responses at the arrival to impulses at `BURN_TIMES`."""
        time_in_cone = self.reach / at_least(self._direct.at_goal.x, _LEAST_CLOSING_SPEED)
        responses = []
        for k in BURN_TIMES:
            rest = time_in_cone * k
            responses.append(
                ImpulseResponse.after(self.n, where(rest < self._time, rest, self._time))
            )
        return responses

    def _response(self, start: int) -> ImpulseResponse:
        """Response at the arrival to an impulse now (0) or at the kth of `BURN_TIMES`."""
        return self._later_responses[start - 1] if start else self._response_now

    @cached_property
    def _direct(self) -> Transfer:
        """The transfer with a burn now to the goal itself, as if there were no brake."""
        return self._transfer(self._burns(0, 0, 1, 0, self.goal - self._coast[0]), None)

    @cached_property
    def _unbraked(self) -> Field:
        """Size up to which components of the velocity are not braked, m/s."""
        return unbraked(self._direct.at_goal, self.speed)

    @cached_property
    def _missed(self) -> Vec3:
        """Displacement to the point of the brake, m; from there the velocity that is left reaches the goal."""
        after = _clipped(self._direct.at_goal, self._unbraked).scale(0.5 * self.period)
        return self.goal - after - self._coast[0]

    @cached_property
    def _burning_now(self) -> Transfer:
        """The transfer whose burns are all now."""
        return self._transfer(self._burns(0, 0, 1, 0, self._missed), self._unbraked)

    def _burns(self, a: int, j: int, b: int, k: int, missed: Vec3, across: int = 0) -> list[Burn]:
        """Burns that together displace the craft by a vector, m.

        Args:
            a: axis of the first burn in the orbital plane.
            j: its start.
            b: axis of the second burn in the plane.
            k: its start.
            missed: displacement, m.
            across: start of the burn across the plane.
        """
        first = self._response(j).displacement(self.n, a)
        second = self._response(k).displacement(self.n, b)
        sizes = two_impulses(first, second, (missed.x, missed.y))
        height = missed.z * self.n / self._response(across).sine
        return [Burn(a, sizes[0], j), Burn(b, sizes[1], k), Burn(2, height, across)]

    def _transfer(self, burns: Sequence[Burn], unbraked: Field | None) -> Transfer:
        """The transfer by burns (fields); its last velocity keeps components up to a size, m/s; None: all of it.

        Only burns that begin now are its command; later ones count in its price and its last velocity.
        """
        price = self._time * 0.0
        now = [price, price, price]
        v = list(self._coast[1].columns())
        for axis, size, start in burns:
            response = self._response(start)
            price = price + absolute(size)
            if axis == 2:
                v[2] = v[2] + size * (1.0 - response.versine)
            else:
                change = response.velocity_change(axis)
                v[0] = v[0] + size * change[0]
                v[1] = v[1] + size * change[1]
            if start == 0:
                now[axis] = now[axis] + size
        if unbraked is not None:
            for speed in v:
                price = price + at_least(absolute(speed) - unbraked, 0.0)
        return Transfer(price, Vec3(*now), Vec3(*v))

    @cached_property
    def _postponed(self) -> list[tuple[Field, Transfer]]:
        """Transfers of which burns are later, and whether (fields) there is time for each.

        Their order decides ties.
        """
        transfers = []
        for j in range(1, len(BURN_TIMES) + 1):
            possible = self._response(j).time < self._time
            for across in (0, j):
                # Axes of both burns in the plane, and the start of the first one.
                for a, b, first in ((0, 1, 0), (1, 0, 0), (0, 0, 0), (1, 1, 0), (0, 1, j)):
                    burns = self._burns(a, first, b, j, self._missed, across)
                    transfers.append((possible, self._transfer(burns, self._unbraked)))
        return transfers

    def _cheapest(self) -> Transfer:
        """The cheapest transfer, inside the cone or not."""
        best = self._burning_now
        for possible, candidate in self._postponed:
            better = possible & (candidate.price < best.price * (1.0 - LEAST_SAVING))
            best = best.replaced_where(better, candidate)
        return best

    def _cheapest_inside(self) -> Transfer:
        """The cheapest transfer that is inside the cone, or the one that is least outside.

        Postponed burns count only where they save more than `LEAST_SAVING`, or the law would wait for ever.
        """
        best = self._penalized(self._burning_now)
        others = [*self._postponed, *(self._bent(j) for j in range(1, len(BURN_TIMES) + 1))]
        for possible, transfer in others:
            candidate = self._penalized(transfer)
            better = possible & (candidate.price < best.price * (1.0 - LEAST_SAVING))
            best = best.replaced_where(better, candidate)
        return best

    def _bent(self, j: int) -> tuple[Field, Transfer]:
        """The transfer with a burn now and one along y later, just so large that it arrives inside the cone (W).

        Args:
            j: start of the later burn.
        """
        later = self._response(j)
        displacement, change = later.displacement(self.n, 1), later.velocity_change(1)
        x, y = (self._response_now.displacement(self.n, axis) for axis in (0, 1))
        # Burns now, along x and y, that undo the displacement by 1 m/s later.
        u, w = two_impulses(x, y, (0.0 - displacement[0], 0.0 - displacement[1]))
        by_x, by_y = self._response_now.velocity_change(0), self._response_now.velocity_change(1)
        # Change of the velocity at the arrival by all three.
        ahead = u * by_x[0] + w * by_y[0] + change[0]
        aside = u * by_x[1] + w * by_y[1] + change[1]
        at_goal = self._burning_now.at_goal
        size = self._time * 0.0
        for _ in range(_BEND_ITERATIONS):
            correction = size * 0.0
            closing = at_least(at_goal.x + size * ahead, _LEAST_CLOSING_SPEED)
            for arc, slope in self._cone_checks():
                # How far the velocity across the axis is outside the cone at this distance.
                radius = slope * _CONE_USE * closing
                width = sqrt(at_least(radius * radius - at_goal.z * at_goal.z, 0.0))
                offset = at_goal.y + arc
                inside = where(offset > width, width, where(offset < -width, -width, offset))
                change_in_y = inside - offset
                larger_one = absolute(change_in_y) > absolute(correction)
                correction = where(larger_one, change_in_y, correction)
            size = correction * aside / (aside * aside + SINGULAR_OFFSET)
        burns = self._burns(0, 0, 1, 0, self._missed)
        burns[0] = burns[0]._replace(size=burns[0].size + u * size)
        burns[1] = burns[1]._replace(size=burns[1].size + w * size)
        return later.time < self._time, self._transfer([*burns, Burn(1, size, j)], self._unbraked)

    def _cone_checks(self) -> list[tuple[float, float]]:
        """Speed across the axis by which the arc of a coast differs from a line, m/s, and slope of the cone there.

        On the last d metres the frame turns by n d / v, so that velocity and chord differ by n d.
        """
        checks = []
        for multiple in _CHECKED_DISTANCES:
            distance = self.reach * multiple
            checks.append((self.n * distance, self.slope * (1.0 + self.depth / distance)))
        return checks

    def _excess_slopes(self, at_goal: Vec3) -> list[Field]:
        """Slope of a transfer less that of the cone, at both checks, from its velocity at the arrival, m/s."""
        closing = at_least(at_goal.x, SINGULAR_OFFSET)
        slopes = []
        for arc, slope in self._cone_checks():
            offset = at_goal.y + arc
            slopes.append(sqrt(offset * offset + at_goal.z * at_goal.z) / closing - slope)
        return slopes

    def _penalized(self, transfer: Transfer) -> Transfer:
        """The transfer with a price for being outside the cone."""
        over = at_least(reduce(larger, self._excess_slopes(transfer.at_goal)), 0.0)
        return transfer._replace(price=transfer.price + over * _OUTSIDE_PRICE)

    def _inside_fraction(self, cheapest: Transfer, inside: Transfer) -> Field:
        """Least fraction (field) of the transfer inside the cone with which a mixture is inside, too.

        Excesses are mixed linearly, which is never less than the mixture's own, since the cone is convex.
        """
        fraction = self._time * 0.0
        slopes = self._excess_slopes(cheapest.at_goal), self._excess_slopes(inside.at_goal)
        for far, near in zip(*slopes, strict=True):
            over = at_least(far, 0.0)
            under = at_least(0.0 - near, 0.0)
            fraction = larger(fraction, over / (over + under + SINGULAR_OFFSET))
        return fraction

    def _brake(self) -> Vec3:
        """Velocity change of the brake in a period that begins now, m/s."""
        after = self._time * 0.0 + self.period
        _, at_goal = ClohessyWiltshire(self.n).carry(self.p, self.v, after)
        brake = _clipped(at_goal, unbraked(at_goal, self.speed)) - at_goal
        # In the rest of the period the frame turns the brake.
        _, aside = ImpulseResponse.after(self.n, 0.5 * after).velocity_change(0)
        at_goal = at_goal + Vec3(0.0 - brake.y * aside, brake.x * aside, brake.z * 0.0)
        return _clipped(at_goal, unbraked(at_goal, self.speed)) - at_goal


def unbraked(velocity: Vec3, speed: float) -> Field:
    """Size up to which components stay, m/s, so that thrusters along the axes brake least to a speed, m/s.

    Components that are smaller stay as they are, and the others are braked to this size. Fields; in closed form,
    since guidance is traced.
    """
    sizes = [absolute(x) for x in velocity.columns()]
    largest = reduce(larger, sizes)
    smallest = 0.0 - reduce(larger, [0.0 - x for x in sizes])
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
