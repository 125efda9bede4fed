"""Frugality of an agent for any craft: how much time its flights may take to save thrust, beside its weights.

A value from 0 (fast) to 1 (frugal) becomes numbers. They change the distance and the
angle to the goal and the accelerations that the network is given, the price of thrust in the allocation, far away
and near, the time for which a craft coasts near the goal, and whether pulses hold its pose there. Above 0.5 the
value is that of what the length of a flight allows.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from rans.extend import Architecture
from rans_any_craft.allocated import holds

NEAR = 0.15
"""Distance, m, within which a frugal network is given the whole error: three times the tolerance, so that it stops
where it should."""
_PRICE = 2.0
"""Factor of the price of continuous thrust from 0.5 on. At 3 some flights never settle, at 4 a quarter of them."""
_COAST = 5.0 / 3.0
"""Factor of the time for which craft with pulsed thrusters coast near the goal, from 0.5 on."""
_HURRY = 1.1
"""Factor of the linear accelerations at the value 0 for trained weights in space. Craft with pulsed thrusters then
take 3 to 5 % less time; the free flyer, throttled craft and those with wheels lose by it
(docs/decisions/any_craft.md)."""
_EVEN = 0.5
"""Value up to which the length of a flight changes nothing."""
_SETTLED_BY = 0.8, 0.75
"""Part of a flight by which the slowest starts have settled: with trained weights, and by slower ways. The last
fifth of a flight decides whether it is solved."""
_SLOWEST = {2: (1.25, 2.0), 3: (1.25, 2.6)}
"""Time in which the slowest starts settle at `_EVEN` and at 1, over twice the root of the mean distance over the
acceleration, by dimension."""
_SMALL_MARGIN = 0.75
"""Power of an authority margin below 1 with which the time at 1 grows: thrust costs such craft more."""
_SPARE = 1.1, 1.2
"""Time that a flight has over the one that weights of 1 take in the plane, from which its ways are slower, and
wholly so."""
_SLOW = 0.75
"""Value from which ways are slower."""
_SLOW_WEIGHTS = 0.85
"""Value of the weights of the slowest ways: those of larger ones hardly thrust at a short distance."""
_SLOW_PRICE = 1.5
"""Factor of the price of on/off thrust there. At 1.9 one flight of forty is lost."""
_SLOW_AWAY = {2: 8.0 / 3.0, 3: 1.0}
"""Further factor of that price beyond `NEAR`, by dimension: on the way a small error of the speed is worth no
pulse. At 10/3 one flight of 35 is late, and in space one of twenty at 8/3."""
_SLOW_ANGLE = 0.35
"""Largest angle there, rad."""
_GRADUAL = 1.25
"""Distance that on/off craft in the plane are given at the mean one, over that of the cruise speed. A bound is the
same for all starts, while this is larger for farther ones, so that all arrive at about the same time."""
_BENT = 0.9
"""Part of it that grows with the square of the distance, over what it leaves of the mean one. Without, the platform
takes 2 % more impulse at 1.2, and one flight of 250 is late."""
_BEGUN = 0.5
"""Part of the mean distance that a bound begins with: a larger one changes no speed of frugal weights."""
_STRAGGLES = {False: 2.5, True: 1.65}
"""Time in which the slowest starts settle over that of the braking curve from the mean one, by whether thrusters
are throttled or pulsed."""
_PUSHED = 0.4
"""Largest change of speed in a period, over the mean speed, that counts in the next number."""
_COARSE = 5.2
"""Part of the time of on/off craft, over the square of that ratio, which their pulses save: they exceed what was
asked for."""


class Leisure(NamedTuple):
    """What the length of a flight allows at a frugality."""

    value: float
    """Value of the weights."""
    slow: float = 0.0
    """Part of the way to the slowest ways, 0 to 1."""

    @classmethod
    def of_flight(
        cls,
        value: float,
        distance: float,
        seconds: float,
        acceleration: float,
        margin: float,
        dimension: int = 2,
        has_pulses: bool = True,
    ) -> Leisure:
        """What a flight allows: smaller values where it is short, slower ways than the weights' where it is long.

        >>> from rans_any_craft.frugality import Leisure
        >>> Leisure.of_flight(1.0, 3.5, 25.0, 0.38, 1.2)
        Leisure(value=0.85, slow=1.0)

        Args:
            value: frugality, 0 to 1.
            distance: mean distance of the starts, m; 0: only the value counts.
            seconds: length of the flight, s; infinite: only the value counts.
            acceleration: least linear one of the craft, m/s^2.
            margin: authority margin of the craft (`rans_any_craft.twists.authority_margin`).
            dimension: 2 or 3.
            has_pulses: whether thrusters are on/off or pulsed; throttled craft of small margin need no longer with
                the weights of a value.
        """
        if value <= _EVEN or math.isinf(seconds) or not distance:
            return cls(value)
        quick = 2.0 * math.sqrt(distance / acceleration)
        even, slowest = _SLOWEST[dimension]
        harder = min(1.0, margin) ** -_SMALL_MARGIN
        if has_pulses:
            slowest *= harder
        allowed = (_SETTLED_BY[0] * seconds / quick - even) / (slowest - even)
        weights = value
        if allowed < 1.0:
            weights = _EVEN + (value - _EVEN) * max(allowed, 0.0)
        low, high = _SPARE
        spare = (_SETTLED_BY[1] * seconds / (quick * harder * _SLOWEST[2][1]) - low) / (high - low)
        slow = min(max(spare, 0.0), 1.0) * max(0.0, value - _SLOW) / (1.0 - _SLOW)
        return cls(weights - slow * max(0.0, weights - _SLOW_WEIGHTS), slow)


def cruise_speed(
    distance: float, seconds: float, acceleration: float, period: float, is_continuous: bool
) -> float:
    """Speed, m/s, with which the slowest starts settle in three quarters of a flight.

    Args:
        distance: mean distance of the starts, m.
        seconds: length of the flight, s.
        acceleration: least linear one of the craft, m/s^2.
        period: control period, s.
        is_continuous: whether its thrusters are throttled or pulsed.
    """
    time = _SETTLED_BY[1] * seconds
    ratio = min(_PUSHED, acceleration * period * time / distance)
    time /= _STRAGGLES[is_continuous] - (0.0 if is_continuous else _COARSE * ratio * ratio)
    # Distance / speed + 1.2 speed / acceleration is that time: rest to rest, braking by 0.7 of the acceleration.
    left = max(time * time - 4.8 * distance / acceleration, 0.0)
    return 2.0 * distance / (time + math.sqrt(left))


class Frugality(NamedTuple):
    """What a network is given of the way to its goal, and what thrust costs."""

    shortened: float
    """Part of the distance beyond `NEAR` that counts."""
    farthest: float
    """Largest distance, m; 0: no bound."""
    largest_angle: float
    """Largest angle, rad; 0: no bound."""
    price: float
    """Factor of the price of thrust in the allocation."""
    acceleration: float = 1.0
    """Factor of the craft's linear accelerations that the network is given."""
    coast: float = 1.0
    """Factor of the control periods for which the craft coasts near the goal."""
    away: float = 1.0
    """Further factor of the price of on/off thrust beyond `NEAR`, unless ``farthest`` is nearer."""
    hold: float = 0.0
    """1: within the tolerances pulses hold the pose (`rans_any_craft.holding`); 0: the network's demand does."""
    growth: float = 0.0
    """What ``shortened`` grows by for each metre of distance beyond `NEAR`, 1/m."""
    finer: float = 1.0
    """5 cm over the tolerance of the position: factor of distances, velocities and linear accelerations."""
    finer_turn: float = 1.0
    """5 degrees over that of the attitude: factor of angles, angular velocities and accelerations."""

    @classmethod
    def trained(cls, value: float, is_continuous: bool, hurries: bool = False) -> Frugality:
        """The numbers of a value from 0 to 1 for an agent, which has weights of its own for every value.

        Only the price of continuous thrusters and their coasting change: on/off thrusters whose pulses are large
        lose flights by it (docs/decisions/any_craft.md). A craft that ``hurries`` is given larger
        accelerations at fast values.
        """
        toward = min(2.0 * value, 1.0)
        part = toward if is_continuous else 0.0
        price, coast = _PRICE**part, 1.0 + part * (_COAST - 1.0)
        acceleration = 1.0 + (1.0 - toward) * (_HURRY - 1.0) if hurries else 1.0
        return cls(1.0, 0.0, 0.0, price, acceleration, coast)

    def slower(
        self, slow: float, distance: float, farthest: float, dimension: int = 2
    ) -> Frugality:
        """The numbers on the way to the slowest ways.

        Args:
            slow: part of that way, above 0 to 1.
            distance: mean distance of the starts, m.
            farthest: largest distance at its end, m.
            dimension: 2 or 3.
        """
        begun = max(farthest, _BEGUN * distance)
        bound = begun ** (1.0 - slow) * farthest**slow
        # Weights with a price of their own keep it.
        price, away, shortened, growth = self.price, self.away, self.shortened, self.growth
        if price == 1.0:
            price, away = _SLOW_PRICE**slow, _SLOW_AWAY[dimension] ** slow
            if dimension == 2 and NEAR < farthest < distance:
                part = min(_GRADUAL * (farthest - NEAR) / (distance - NEAR), 1.0) ** slow
                bent = _BENT * (1.0 - part)
                shortened, bound = part * (1.0 - bent), 0.0
                growth = part * bent / (distance - NEAR)
        return self._replace(
            shortened=shortened,
            farthest=bound,
            largest_angle=math.pi + slow * (_SLOW_ANGLE - math.pi),
            price=price,
            away=away,
            growth=growth,
        )


AS_TRAINED = Frugality(1.0, 0.0, 0.0, 1.0)
"""The numbers of an agent as it was trained."""


def numbers_of(architecture: Architecture) -> Frugality:
    """The numbers of a network, of which those of older files end sooner."""
    return Frugality(*architecture.frugal) if architecture.frugal else AS_TRAINED


def check_frugality(architecture: Architecture) -> None:
    """Refuse (`ValueError`) numbers of an agent's file that are none."""
    frugal = architecture.frugal
    by_pulses = holds(architecture.tokens) and not architecture.adapts
    # Older files end before the factor of the price far away, with it, or with the growth.
    if frugal and (
        not architecture.authority
        or len(AS_TRAINED) - len(frugal) not in (0, 2, 4, 5)
        or not 0.0 < frugal[0] <= 1.0
        or min(frugal[1:3]) < 0.0
        or frugal[2] > math.pi
        or min(frugal[3:7]) <= 0.0
        or (frugal[7:] and (frugal[7] not in (0.0, 1.0)[: 1 + by_pulses] or frugal[8] < 0.0))
        or min(frugal[9:], default=1.0) <= 0.0
    ):
        raise ValueError(
            "its frugality is not a part of a distance, a distance, an angle, factors of a price, of "
            "accelerations, of a time and of the price far away, whether pulses hold the pose, a growth and "
            "factors of finer tolerances, or it is no agent for any craft that can"
        )
