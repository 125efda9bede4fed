"""Frugality of an agent for any craft: how much time its flights may take to save thrust, without other weights.

A value from 0 (fast, the agent as it was trained) to 1 (frugal) becomes four numbers, which change the distance and
the angle to the goal that the network is given, and the price of thrust in the allocation.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rans.errors import ConfigError, brief

_VALUES = (0.0, 0.2, 0.4, 0.5, 0.6, 0.8, 1.0)
"""Values between which the numbers below are interpolated."""
_SHORTENED = (1.0, 0.85, 0.85, 0.85, 0.85, 0.85, 0.85)
"""Part of a distance that counts; 0.85 brakes earlier, which is quicker and cheaper on some craft and costs others
1 to 3 % of their time (docs/decisions/any_craft.md)."""
_DISTANCES = (3.0, 2.0, 1.0, 0.46, 0.35, 0.15, 0.11)
"""Largest distance over that of the starts. The braking curve makes of it a largest speed."""
_UNBOUNDED = 1.5
"""Part of the starts' distance from which a bound is none: no flight begins farther away."""
_ANGLES = (math.pi, math.pi, math.pi, math.pi, 1.5, 0.8, 0.6)
"""Largest angle, rad."""
_PRICES = (1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 2.0)
"""Factor of the price of thrust. At 3 some flights never settle, at 4 a quarter of them."""


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

    @classmethod
    def of_value(cls, value: float, distance: float) -> Frugality:
        """The numbers of a value from 0 to 1, for starts at a distance (m) from their goals.

        >>> from rans.policy.frugality import Frugality
        >>> Frugality.of_value(1.0, 2.0)
        Frugality(shortened=0.85, farthest=0.22, largest_angle=0.6, price=2.0)

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
        price = math.exp(np.interp(value, _VALUES, np.log(_PRICES)))
        return cls(
            shortened,
            0.0 if part > _UNBOUNDED else round(part * distance, 6),
            0.0 if angle == math.pi else angle,
            round(price, 6),
        )


AS_TRAINED = Frugality(1.0, 0.0, 0.0, 1.0)
"""The numbers of an agent as it was trained."""
