"""Frugality of an agent for any craft: how much time its flights may take to save thrust, without other weights.

A value from 0 (the agent as it was trained) to 1 (frugal) becomes six numbers. They change the distance and the
angle to the goal and the accelerations that the network is given, the price of thrust in the allocation, and the
time for which a craft coasts near the goal.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rans.errors import ConfigError, brief

_VALUES = (0.0, 0.1, 0.2, 0.4, 0.5, 0.6, 0.8, 1.0)
"""Values between which the numbers below are interpolated."""
_SHORTENED = (1.0, 0.85, 0.85, 0.85, 0.85, 0.85, 0.85, 0.85)
"""Part of a distance that counts; 0.85 brakes earlier, which is quicker and cheaper on some craft and costs others
1 to 3 % of their time (docs/decisions/any_craft_frugal.md)."""
_DISTANCES = (3.0, 2.4, 2.0, 1.0, 0.46, 0.35, 0.15, 0.11)
"""Largest distance over that of the starts. The braking curve makes of it a largest speed."""
_UNBOUNDED = 1.5
"""Part of the starts' distance from which a bound is none: no flight begins farther away."""
_ANGLES = (math.pi, math.pi, math.pi, math.pi, math.pi, 1.5, 0.8, 0.6)
"""Largest angle, rad."""
_PRICES = {
    2: (1.0, 1.5, 1.5, 2.0, 2.0, 2.0, 2.0, 2.0),
    3: (1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 2.0),
}
"""Factor of the price of thrust, by dimension. At 3 some flights never settle, at 4 a quarter of them."""

_ACCELERATIONS = {2: (1.0, 1.2, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0), 3: (1.0,) * 8}
"""Factor of the linear accelerations, by dimension. A craft that is faster on the way and brakes earlier by a
shortened distance loses no time near the goal: with 1.2 the agent is quicker and cheaper than switching control on
six of fifteen planar craft, with 1 on four. In space it costs the free-flyer 60 % more thrust
(docs/decisions/any_craft_frugal.md)."""
_HURRY = 1.1
"""Factor of the linear accelerations at the value 0 for trained weights in space. Craft with pulsed thrusters then
take 3 to 5 % less time; the free flyer, throttled craft and those with wheels lose by it
(packages/any_craft/docs/decisions/any_craft_values.md)."""
_COASTS = {2: (1.0,) + (5.0 / 3.0,) * 7, 3: (1.0,) * 8}
"""Factor of the time for which a craft coasts near the goal, by dimension: in the plane five control periods in
place of three save 2 % of the thrust."""


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

    @classmethod
    def of_value(cls, value: float, distance: float, dimension: int) -> Frugality:
        """The numbers of a value from 0 to 1, for starts at a distance (m) from their goals, in 2 or 3 dimensions.

        >>> from rans.policy.frugality import Frugality
        >>> Frugality.of_value(1.0, 2.0, 3)[:4]
        (0.85, 0.22, 0.6, 2.0)

        Raises:
            ConfigError: the value is not from 0 to 1.
        """
        if not 0.0 <= value <= 1.0:
            raise ConfigError(
                f"the frugality of an agent for any craft is from 0 (fast) to 1 (frugal), got {brief(value)}."
            )
        shortened = float(np.interp(value, _VALUES, _SHORTENED))
        part = math.exp(np.interp(value, _VALUES, np.log(_DISTANCES)))
        angle = float(np.interp(value, _VALUES, _ANGLES))
        price = math.exp(np.interp(value, _VALUES, np.log(_PRICES[dimension])))
        return cls(
            shortened,
            0.0 if part > _UNBOUNDED else round(part * distance, 6),
            0.0 if angle == math.pi else angle,
            round(price, 6),
            float(np.interp(value, _VALUES, _ACCELERATIONS[dimension])),
            float(np.interp(value, _VALUES, _COASTS[dimension])),
        )

    @classmethod
    def trained(cls, value: float, is_continuous: bool, hurries: bool = False) -> Frugality:
        """The numbers of a value from 0 to 1 for an agent that has weights of its own for every value.

        Only the price of continuous thrusters and their coasting change: on/off thrusters whose pulses are large
        lose flights by it (docs/decisions/any_craft_frugal.md). A craft that ``hurries`` is given larger
        accelerations at fast values.
        """
        toward = min(2.0 * value, 1.0)
        part = toward if is_continuous else 0.0
        price, coast = _PRICES[2][-1] ** part, 1.0 + part * (_COASTS[2][-1] - 1.0)
        acceleration = 1.0 + (1.0 - toward) * (_HURRY - 1.0) if hurries else 1.0
        return cls(1.0, 0.0, 0.0, round(price, 6), round(acceleration, 6), coast)


AS_TRAINED = Frugality(1.0, 0.0, 0.0, 1.0)
"""The numbers of an agent as it was trained."""
