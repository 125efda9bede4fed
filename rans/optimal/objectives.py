"""What a trajectory can be optimal for."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca

from rans.dynamics import State
from rans.errors import ConfigError
from rans.optimal.guess import transfer_time
from rans.spacecraft import Spacecraft


class Objective(Protocol):
    """What a trajectory is optimal for."""

    @property
    def name(self) -> str:
        """What to call it in tables."""
        ...

    @property
    def intervals(self) -> int:
        """Control periods of the trajectory."""
        ...

    @property
    def control_period(self) -> float | None:
        """s; None where the optimiser chooses it."""
        ...

    def periods(self, craft: Spacecraft, start: State, goal: State) -> tuple[float, float, float]:
        """Least, first guessed and greatest control period, s; equal where it is given."""
        ...

    def cost(self, craft: Spacecraft, commands: Any, period: Any) -> Any:
        """Of CasADi commands (thrusters, intervals) and control period."""
        ...


@dataclass(frozen=True)
class MinimumFuel:
    """Least thrust impulse, N s, that arrives within a given time.

    Raises:
        ConfigError: a value is not positive.
    """

    horizon: float = 20.0
    """Time of arrival, s; cut into whole control periods."""
    control_period: float = 0.2
    """s."""

    def __post_init__(self) -> None:
        for key in ("horizon", "control_period"):
            value = getattr(self, key)
            if not (math.isfinite(value) and value > 0):
                raise ConfigError(f"minimum fuel: {key} must be a finite number > 0 s, got {value}.")

    @property
    def name(self) -> str:
        """See `Objective`."""
        return f"minimum fuel in {self.horizon:g} s"

    @property
    def intervals(self) -> int:
        """See `Objective`."""
        return max(1, round(self.horizon / self.control_period))

    def periods(self, craft: Spacecraft, start: State, goal: State) -> tuple[float, float, float]:
        """See `Objective`."""
        return self.control_period, self.control_period, self.control_period

    def cost(self, craft: Spacecraft, commands: Any, period: Any) -> Any:
        """Thrust times time, summed over the thrusters, N s."""
        forces = ca.DM([t.force for t in craft.thrusters])
        return period * ca.dot(forces, ca.sum2(commands))


@dataclass(frozen=True)
class MinimumTime:
    """Least time, s, in a given number of equal control periods.

    Raises:
        ConfigError: ``intervals`` is not positive.
    """

    intervals: int = 50
    """For the paper's starts, 5 s away, this is finer than the default 5 Hz."""

    name = "minimum time"
    control_period = None

    def __post_init__(self) -> None:
        if self.intervals < 1:
            raise ConfigError(f"minimum time: intervals must be >= 1, got {self.intervals}.")

    def periods(self, craft: Spacecraft, start: State, goal: State) -> tuple[float, float, float]:
        """Within a factor of ten of the guess: without it the optimiser can wander to zero."""
        guess = transfer_time(craft, start, goal) / self.intervals
        return 0.1 * guess, guess, 10.0 * guess

    def cost(self, craft: Spacecraft, commands: Any, period: Any) -> Any:
        """Time of arrival, s."""
        return self.intervals * period
