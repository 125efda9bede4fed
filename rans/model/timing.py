"""Time scales of an episode: control period, substeps, checks and length."""

from __future__ import annotations

from dataclasses import dataclass

from rans.base.errors import ConfigError, positive, whole
from rans.model.fields import Field

_SHORTEST = 1e-6
_LONGEST = 1e6
"""Bounds of a control period, s: no valve switches within a microsecond, and no craft holds a command for days."""
MOST_SUBSTEPS = 10_000
"""Largest number of substeps, a hundred times what any craft needs."""
MOST_CHECKS = 1_000
"""Largest number of checks in a control period; each costs as much as a step."""
MOST_STEPS = 2**20 - 1
"""Largest number of control periods in an episode. The engine counts them in the low bits of a 32-bit word, and
episodes in the high bits."""


@dataclass(frozen=True)
class Timing:
    """Control period, substeps and checks of a period, and length of an episode.

    >>> rans.Timing(control_period=0.1, episode_steps=250)
    Timing(control_period=0.1, substeps=None, episode_steps=250, checks=1)

    Raises:
        ConfigError: a value is not a positive number, a count is not whole, or above `MOST_STEPS`.
    """

    control_period: float = 0.2
    """Control period, s, for which a command is held; by default 5 Hz, as in the paper (section 3.1)."""
    substeps: int | None = None
    """Integration steps in a control period. None: as many as the craft needs (`rans.model.accuracy.chosen`).
    The spacecraft of RANS need one, which is exact to rounding in the plane and has an error of 0.01 mm after
    25 s in space; the original system's ten steps at 50 Hz have one of 3.5 mm."""
    episode_steps: int = 125
    """Control periods until an episode is truncated; by default 25 s."""
    checks: int = 1
    """Number of instants in a control period, evenly spaced with the last one at its end, at which constraints,
    success and memory of a task are evaluated (`rans.tasks.base.Task`)."""

    def __post_init__(self) -> None:
        period = positive("control_period", self.control_period)
        object.__setattr__(self, "control_period", period)
        if not _SHORTEST <= period <= _LONGEST:
            raise ConfigError(
                f"control_period must be from {_SHORTEST:g} to {_LONGEST:g} s, got {period:g} s; the usual cause "
                "is a period in other units, or a rate in its place."
            )
        # Counts, and the largest of each.
        most = {"substeps": MOST_SUBSTEPS, "episode_steps": MOST_STEPS, "checks": MOST_CHECKS}
        for key, largest in most.items():
            value = getattr(self, key)
            if value is None and key == "substeps":
                continue
            if (count := whole(key, value)) > largest:
                raise ConfigError(f"{key} must be <= {largest:,}, got {count:,}.")
            object.__setattr__(self, key, count)

    def step(self, clock: Field) -> Field:
        """Control periods since the episode's start: the low bits of a clock (`rans.episode.step.Episode`)."""
        return clock & self._mask

    def episode(self, clock: Field) -> Field:
        """Number of earlier episodes of the same environment: the high bits of a clock."""
        return clock >> self._mask.bit_length()

    def next_episode(self, clock: Field) -> Field:
        """Clock at the start of the next episode."""
        return (clock | self._mask) + 1

    @property
    def _mask(self) -> int:
        return 2 ** self.episode_steps.bit_length() - 1
