"""Approach to a goal near a circular orbit by few burns, inside a cone that opens along -x.

Everything is in closed form over fields. The motion is linear, so that position and velocity at the arrival are
sums of what every burn does (`rans_missions.guidance.impulses`). Thrusters are along the axes and throttled: a burn
is constant during a control period, which is as good as an impulse in its middle. The last burn is in the period
before the arrival. It brakes no more than the mission asks, because the velocity that remains needs no impulse.

A transfer burns now, or now and once more along y, so much that it arrives just inside the cone; the cheapest
that is inside is flown. It is traced into kernels and pages with the mission's step: only arithmetic on fields is
allowed.
"""

from __future__ import annotations

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
    Pair,
    axis_price,
    larger,
    two_impulses,
)

BURN_TIMES = tuple(1.4**k for k in range(4))
"""Times before the arrival at which later burns are tried, in multiples of the time that the craft is within reach
of the cone: from there on, which is the latest burn that does not bend the way inside the cone, to 2.7 times as
early; burns before that change no flight of `Rendezvous`."""
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
        committed = self.time_left < _COMMITTED_PERIODS * self.period
        last_period = self.time_left < 1.5 * self.period
        burn = self._cheapest_inside().replaced_where(committed, self._burning_now).burn
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

    @cached_property
    def _direct(self) -> Transfer:
        """The transfer with a burn now to the goal itself, as if there were no brake."""
        return self._transfer(self._burn_now(self.goal - self._coast[0]))

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
        return self._transfer(self._burn_now(self._missed), self._unbraked)

    def _burn_now(self, missed: Vec3) -> Vec3:
        """Velocity change now, m/s, that displaces the craft by a vector, m."""
        response = self._response_now
        x, y = (response.displacement(self.n, axis) for axis in (0, 1))
        in_plane = two_impulses(x, y, (missed.x, missed.y))
        return Vec3(*in_plane, missed.z * self.n / response.sine)

    def _transfer(
        self, burn: Vec3, unbraked: Field | None = None, bend: Field = 0.0, turn: Pair = (0.0, 0.0)
    ) -> Transfer:
        """The transfer by a burn now and perhaps one later.

        Args:
            burn: velocity change now, m/s.
            unbraked: size up to which components of the last velocity stay, m/s; None: all of it stays.
            bend: velocity change along y later, m/s.
            turn: what 1 m/s of it changes the last velocity by, in the plane.
        """
        response = self._response_now
        x, y = (response.velocity_change(axis) for axis in (0, 1))
        at_goal = self._coast[1] + Vec3(
            burn.x * x[0] + burn.y * y[0] + bend * turn[0],
            burn.x * x[1] + burn.y * y[1] + bend * turn[1],
            burn.z * (1.0 - response.versine),
        )
        price = axis_price(burn) + absolute(bend)
        if unbraked is not None:
            for speed in at_goal.columns():
                price = price + at_least(absolute(speed) - unbraked, 0.0)
        return Transfer(price, burn, at_goal)

    def _cheapest_inside(self) -> Transfer:
        """The cheapest transfer that is inside the cone, or the one that is least outside.

        A later burn counts only where it saves more than `LEAST_SAVING`, or the law would wait for ever.
        """
        best = self._penalized(self._burning_now)
        for later in self._later_responses:
            candidate = self._penalized(self._bent(later))
            better = (later.time < self._time) & (
                candidate.price < best.price * (1.0 - LEAST_SAVING)
            )
            best = best.replaced_where(better, candidate)
        return best

    def _bent(self, later: ImpulseResponse) -> Transfer:
        """The transfer with a burn now and one along y later, just so large that it arrives inside the cone (W)."""
        x, y = later.displacement(self.n, 1)
        change = later.velocity_change(1)
        # A burn now that undoes the displacement by 1 m/s later.
        undoing = self._burn_now(Vec3(0.0 - x, 0.0 - y, self._time * 0.0))
        u, w = undoing.x, undoing.y
        by_x, by_y = (self._response_now.velocity_change(axis) for axis in (0, 1))
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
        burn = self._burning_now.burn + undoing.scale(size)
        return self._transfer(burn, self._unbraked, size, change)

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
