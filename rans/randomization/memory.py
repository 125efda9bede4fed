"""How much of its past an episode keeps, because valves and sensors answer late."""

from __future__ import annotations

import math
from typing import NamedTuple

from rans.randomization.conditions import Conditions, largest


class Memory(NamedTuple):
    """Of all episodes under some conditions, in control periods."""

    felt: int = 0
    """Commands before the newest whose thrust may still be felt."""
    obeyed: int = 0
    """Commands that a valve may have to stay as it is for."""
    states: int = 0
    """States before the present one that a reading may be of."""

    @classmethod
    def of(cls, conditions: Conditions | None, period: float) -> Memory:
        """What a control period (s) asks for; nothing in a perfect world."""
        if conditions is None:
            return cls()
        widest = conditions.met(
            0.0
        )  # the bounds of its ranges are those of all that an episode may meet
        least = max(largest(widest.thrusters.least_on), largest(widest.thrusters.least_off))
        felt, obeyed = (math.ceil(seconds / period - 1e-9) for seconds in (widest.lasting, least))
        return cls(felt, obeyed, int(largest(widest.sensors.delay)))
