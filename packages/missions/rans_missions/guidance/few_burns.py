"""Transfers of few burns near a circular orbit that end at rest, in closed form over fields.

The motion is linear (`rans.model.drift.ClohessyWiltshire`), so that position and velocity at the arrival are sums
of what every burn does. Across the orbital plane one burn reaches a position, and in the plane two burns along axes
do. What is left of the velocity is braked at the arrival. Thrusters are along the axes: burns cost the sum of their
components.

A burn is now, or after one or more of `INTERVALS` equal intervals of the time. Of every such burn across the plane,
and of the pairs in the plane of which one or none is now, the cheapest is taken. The best transfer of this kind is
within some percent of the optimum, which has few burns too, the largest of them at both ends (T. N. Edelbaum, "How
many impulses?", Astronautics & Aeronautics 5, 1967). All numbers are fields in the Hill frame, so that mission
steps are traced with it; the order of comparisons decides which of equal plans flies.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from rans.extend import Field, Vec3, absolute, at_least, cos, sin, where
from rans_missions.guidance.impulses import (
    LEAST_SAVING,
    ImpulseResponse,
    Pair,
    larger,
    two_impulses,
)

INTERVALS = 8
"""Number of equal intervals of a transfer's time, between which burns are tried and a ball's distance is checked.
Twice as many take four times the comparisons, and postponed burns change little in one of them."""
_EDGE_POINTS = 8
"""Number of points on the edge of the position tolerance, in the orbital plane, at which transfers may end."""
_DETOUR_PRICE = 8.0
"""Price of every metre that a transfer is too near to a ball, times its time, m/s times s per metre. A craft that
leaves its way by 1 m after half of the time T and is back at the end changes its velocity by 2 / T, 4 / T and 2 /
T."""
_IMPOSSIBLE_PRICE = 1e6
"""Price of a coast that misses the tolerance without a burn, m/s: more than any transfer costs."""


@dataclass(frozen=True)
class ArrivalTolerance:
    """Largest distances and speed with which a transfer may end."""

    plane: float
    """Distance from the goal in the orbital plane, m."""
    across: float
    """Distance from the goal across it, m."""
    speed: float
    """Speed along each axis that is not braked, m/s."""
    deadband: float = 1.1
    """Factor of both distances within which a coast is not corrected, so that a craft that has aimed at their edge
    does not correct rounding errors."""


@dataclass(frozen=True)
class KeepOut:
    """A ball at rest, around which transfers go."""

    centre: Vec3
    """Centre in W, m."""
    radius: Field
    """Radius, with a reserve, m."""


class Transfer(NamedTuple):
    """A transfer to the goal."""

    burn: Vec3
    """Velocity change of its burns that are now, in W, m/s."""
    price: Field
    """Velocity change of all burns, m/s, and the price of a detour around the ball."""
    brake: Field
    """Largest component of the velocity change at the arrival, m/s."""


class _Burn(NamedTuple):
    """A burn along an axis of the orbital plane."""

    axis: int
    """0: x, 1: y."""
    size: Field
    """Velocity change, m/s."""
    start: int
    """Number of intervals of the time before it."""


class _PlaneTransfer(NamedTuple):
    """A transfer in the orbital plane."""

    price: Field
    """Velocity change of all burns, m/s."""
    brake: Field
    """Largest component of the velocity change at the arrival, m/s."""
    now: Pair
    """Velocity change of its burns that are now, m/s."""
    offset: Pair
    """Position at the arrival relative to the goal, m."""

    def replaced_where(self, better: Field, candidate: _PlaneTransfer) -> _PlaneTransfer:
        """This transfer, or another one where that is better."""
        return _PlaneTransfer(
            where(better, candidate.price, self.price),
            where(better, candidate.brake, self.brake),
            _pair_where(better, candidate.now, self.now),
            _pair_where(better, candidate.offset, self.offset),
        )


@dataclass(frozen=True)
class Coast:
    """A coast near a circular orbit, from which transfers to a goal are found.

    Args:
        n: mean motion of the orbit, rad/s.
        p: position in W, the target's Hill frame, m.
        v: velocity in W, m/s.
        goal: position in W, m.
        time: until the arrival, > 0, s.
        tolerance: distances from the goal and speed with which transfers may end.
        acceleration: by thrust along each axis, m/s^2. A later burn that lasts longer than an interval of the time
            is dearer.
    """

    n: float
    p: Vec3
    v: Vec3
    goal: Vec3
    time: Field
    tolerance: ArrivalTolerance
    acceleration: float

    def cheapest(self, ball: KeepOut | None = None) -> Transfer:
        """The cheapest transfer whose burns in the plane may be postponed, beside a ball.

        Earlier ones win ties, so that a rounding does not change the plan from one period to the next.
        """
        across, price, brake, heights = self._across()
        burning_now = self._plane_burning_now
        best = burning_now
        if ball is None:
            for transfer, _ in self._postponed():
                better = transfer.price < best.price * (1.0 - LEAST_SAVING)
                best = best.replaced_where(better, transfer)
        else:
            clearances = self._clearances(ball, heights)
            both = _Burn(0, burning_now.now[0], 0), _Burn(1, burning_now.now[1], 0)
            detour = self._detour(ball, clearances, both)
            best = burning_now._replace(price=burning_now.price + detour)
            for transfer, burns in self._postponed():
                detour = self._detour(ball, clearances, burns)
                dearer = transfer._replace(price=transfer.price + detour)
                better = dearer.price < best.price * (1.0 - LEAST_SAVING)
                best = best.replaced_where(better, dearer)
        return Transfer(Vec3(*best.now, across), best.price + price, larger(best.brake, brake))

    def burning_now(self) -> Transfer:
        """The cheapest transfer of which at most the burn across the plane is postponed; it ignores balls."""
        across, price, brake, _ = self._across()
        best = self._plane_burning_now
        return Transfer(Vec3(*best.now, across), best.price + price, larger(best.brake, brake))

    @cached_property
    def _responses(self) -> list[ImpulseResponse]:
        """Responses to impulses after 0, 1, ..., `INTERVALS` intervals of the time.

        Sines and cosines of sums of half angles are sums of products, so that only two are computed.
        """
        half_angle = 0.5 * self.n / INTERVALS * self.time
        sine, cosine = sin(half_angle), cos(half_angle)
        s, c = self.time * 0.0, self.time * 0.0 + 1.0
        responses = []
        for k in range(INTERVALS + 1):
            responses.append(ImpulseResponse(self.time * (k / INTERVALS), 2.0 * s * c, 2.0 * s * s))
            s, c = s * cosine + c * sine, c * cosine - s * sine
        return responses

    def _coast_position(self, k: int) -> Vec3:
        """Position after k of `INTERVALS` parts of the time, without burns, m in the Hill frame.

        The same equations as `ClohessyWiltshire.carry`, from responses that all transfers share.
        """
        p, v, response = self.p, self.v, self._responses[k]
        (a, b), (c, d) = response.displacement(self.n, 0), response.displacement(self.n, 1)
        return Vec3(
            p.x * (1.0 + 3.0 * response.versine) + v.x * a + v.y * c,
            p.y + p.x * (6.0 * (response.sine - self.n * response.time)) + v.x * b + v.y * d,
            p.z * (1.0 - response.versine) + v.z * a,
        )

    @cached_property
    def _missed(self) -> Vec3:
        """Goal relative to the position at the arrival without burns, m."""
        return self.goal - self._coast_position(INTERVALS)

    @cached_property
    def _at_goal(self) -> Vec3:
        """Velocity at the arrival without burns, m/s in the Hill frame."""
        p, v, response = self.p, self.v, self._responses[INTERVALS]
        (a, b), (c, d) = response.velocity_change(0), response.velocity_change(1)
        return Vec3(
            p.x * (3.0 * self.n * response.sine) + v.x * a + v.y * c,
            v.x * b + v.y * d - p.x * (6.0 * self.n * response.versine),
            v.z * a - p.z * (self.n * response.sine),
        )

    def _braking(self, speed: Field) -> Field:
        """Velocity change that brakes a speed along an axis to the tolerance, m/s."""
        return at_least(absolute(speed) - self.tolerance.speed, 0.0)

    def _across(self) -> tuple[Field, Field, Field, list[Field]]:
        """The cheapest burn across the plane, at any interval.

        `_detour` needs the heights after this burn, so that it is chosen before those in the plane.

        Returns:
            The part of it that is now, price with brake, and brake, m/s; and the height after each interval, m.
        """
        n = self.n
        missed, at_goal = self._missed.z, self._at_goal.z
        # Without a burn, where the coast is near enough.
        brake = self._braking(at_goal)
        near = absolute(missed) < self.tolerance.across * self.tolerance.deadband
        zero = self.time * 0.0
        price = where(near, brake, zero + _IMPOSSIBLE_PRICE)
        now, size = zero, zero
        sine, versine, start = zero, zero, zero
        # With a burn at each interval, to either edge of the tolerance.
        for j in range(INTERVALS):
            rest, response = self._responses[INTERVALS - j], self._responses[j]
            for edge in (self.tolerance.across, -self.tolerance.across):
                burn = (missed + edge) * n / rest.sine
                braked = self._braking(at_goal + burn * (1.0 - rest.versine))
                total = absolute(burn) + braked
                better = total < (price * (1.0 - LEAST_SAVING) if j else price)
                price = where(better, total, price)
                brake = where(better, braked, brake)
                now = where(better, zero if j else burn, now)
                size = where(better, burn, size)
                sine = where(better, response.sine, sine)
                versine = where(better, response.versine, versine)
                start = where(better, response.time, start)
        heights = []
        for k, response in enumerate(self._responses):
            # sin(a - b) of the angles now and at the burn.
            since = response.sine * (1.0 - versine) - (1.0 - response.versine) * sine
            burnt = where(response.time > start, since * size * (1.0 / n), zero)
            heights.append(self._coast_position(k).z + burnt)
        return now, price, brake, heights

    @cached_property
    def _plane_burning_now(self) -> _PlaneTransfer:
        """The cheapest transfer in the plane with a burn now and a brake at the arrival."""
        missed, tolerance = self._missed, self.tolerance
        zero = self.time * 0.0
        whole = self._responses[INTERVALS]
        displacements = whole.displacement(self.n, 0), whole.displacement(self.n, 1)
        speeds = whole.velocity_change(0), whole.velocity_change(1)
        # Without a burn, where the coast is near enough.
        price, brake = self._price_and_brake((zero, zero), speeds)
        radius = tolerance.plane * tolerance.deadband
        near = missed.x * missed.x + missed.y * missed.y < radius**2
        price = where(near, price, zero + _IMPOSSIBLE_PRICE)
        best = _PlaneTransfer(price, brake, (zero, zero), (zero, zero))
        # To points on the edge of the tolerance.
        for k in range(_EDGE_POINTS):
            angle = 2.0 * math.pi * k / _EDGE_POINTS
            offset = (
                zero + tolerance.plane * math.cos(angle),
                zero + tolerance.plane * math.sin(angle),
            )
            sizes = two_impulses(*displacements, (missed.x + offset[0], missed.y + offset[1]))
            price, brake = self._price_and_brake(sizes, speeds)
            transfer = _PlaneTransfer(price, brake, sizes, offset)
            best = best.replaced_where(price < best.price, transfer)
        return best

    def _postponed(self) -> list[tuple[_PlaneTransfer, tuple[_Burn, _Burn]]]:
        """Transfers in the plane to the same position, of which one or both burns are later."""
        offset = self._plane_burning_now.offset
        missed = self._missed.x + offset[0], self._missed.y + offset[1]
        zero = self.time * 0.0
        whole = self._responses[INTERVALS]
        transfers = []
        for j in range(1, INTERVALS):
            rest = self._responses[INTERVALS - j]
            # Axes of both burns, and the interval of the first one.
            for first, second, start in ((0, 1, 0), (1, 0, 0), (1, 1, 0), (0, 1, j)):
                response = rest if start else whole
                displacement = response.displacement(self.n, first)
                sizes = two_impulses(displacement, rest.displacement(self.n, second), missed)
                speeds = response.velocity_change(first), rest.velocity_change(second)
                price, brake = self._price_and_brake(sizes, speeds)
                price = price + self._excess(sizes[1])
                if start:
                    price = price + self._excess(sizes[0])
                burnt = zero if start else sizes[0]
                now = (burnt, zero) if first == 0 else (zero, burnt)
                burns = _Burn(first, sizes[0], start), _Burn(second, sizes[1], j)
                transfers.append((_PlaneTransfer(price, brake, now, offset), burns))
        return transfers

    def _excess(self, size: Field) -> Field:
        """Velocity change by which a later burn exceeds that of full thrust during an interval, m/s."""
        return at_least(absolute(size) - self.time * (self.acceleration / INTERVALS), 0.0)

    def _price_and_brake(self, sizes: Pair, speeds: tuple[Pair, Pair]) -> tuple[Field, Field]:
        """Price of two burns in the plane with the brake at the arrival, and its larger component, m/s.

        Fields; a burn of none costs its brake alone.

        Args:
            sizes: of both burns, m/s.
            speeds: change of the velocity at the arrival by 1 m/s of each, m/s.
        """
        (u, w), (first, second) = sizes, speeds
        x = self._braking(self._at_goal.x + u * first[0] + w * second[0])
        y = self._braking(self._at_goal.y + u * first[1] + w * second[1])
        return absolute(u) + absolute(w) + x + y, larger(x, y)

    def _clearances(
        self, ball: KeepOut, heights: Sequence[Field]
    ) -> list[tuple[Field, Field, Field]]:
        """Position in the plane from a ball's centre, and the square of the least distance there, by interval.

        A transfer may be nearest halfway between two of these points, which the square includes.
        """
        halfway = (self.goal - self.p).scale(0.5 / INTERVALS)
        square = ball.radius * ball.radius + halfway.dot(halfway)
        clearances = []
        for k, height in enumerate(heights):
            offset = self._coast_position(k) - ball.centre
            above = height - ball.centre.z
            clearances.append((offset.x, offset.y, square - above * above))
        return clearances

    def _detour(
        self,
        ball: KeepOut,
        clearances: Sequence[tuple[Field, Field, Field]],
        burns: tuple[_Burn, _Burn],
    ) -> Field:
        """Price of the detour around a ball that a transfer by two burns needs, m/s; see `_clearances`.

        It only prices: `Coasts.within` is what keeps a flight out of the ball.
        """
        violation = self.time * 0.0
        for k in range(1, INTERVALS + 1):
            x, y, least_square = clearances[k]
            for axis, size, start in burns:
                if k > start:
                    response = self._responses[k - start].displacement(self.n, axis)
                    x = x + size * response[0]
                    y = y + size * response[1]
            violation = larger(violation, least_square - x * x - y * y)
        # (r^2 - d^2) / 2 r is about r - d.
        return violation * (_DETOUR_PRICE / (2.0 * ball.radius * self.time))


def _pair_where(condition: Field, a: Pair, b: Pair) -> Pair:
    return where(condition, a[0], b[0]), where(condition, a[1], b[1])
