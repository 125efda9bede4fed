"""Number of past commands and states that an episode stores for delays of valves and sensors."""

from __future__ import annotations

import math
from typing import NamedTuple

from rans.randomization.conditions import Conditions, largest


class Memory(NamedTuple):
    """Lengths of the histories that episodes under some conditions store, in control periods."""

    felt: int = 0
    """Commands before the newest one that may still affect the thrust."""
    obeyed: int = 0
    """Commands within the longest dwell time of a valve."""
    states: int = 0
    """States before the present one that a delayed reading may show."""

    @classmethod
    def of(cls, conditions: Conditions | None, period: float) -> Memory:
        """Histories that conditions need at a control period (s); none under nominal conditions."""
        if conditions is None:
            return cls()
        widest = conditions.met(
            0.0
        )  # the bounds of its ranges are those of all that an episode may meet
        least = largest(widest.thrusters.least_on)
        felt, obeyed = (math.ceil(seconds / period - 1e-9) for seconds in (widest.lasting, least))
        return cls(felt, obeyed, int(largest(widest.sensors.delay)))
