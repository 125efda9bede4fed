"""How time is cut: control periods, physics substeps, episodes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rans.errors import ConfigError


@dataclass(frozen=True)
class Timing:
    """Control rate, accuracy of the motion between two commands, and length of an episode.

    Raises:
        ConfigError: a value is not positive.
    """

    control_period: float = 0.2
    """Time a command is held, s: 5 Hz, as in the paper (section 3.1)."""
    substeps: int = 2
    """Integration steps a control period. In the plane one is exact to rounding already; in space two
    are more accurate than ten 50 Hz steps of the original system."""
    episode_steps: int = 125
    """Control periods until an episode is cut off: 25 s."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.control_period) and self.control_period > 0):
            raise ConfigError(f"control_period must be a finite number > 0 s, got {self.control_period}.")
        for key in ("substeps", "episode_steps"):
            value = getattr(self, key)
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise ConfigError(f"{key} must be a whole number >= 1, got {value!r}.")
