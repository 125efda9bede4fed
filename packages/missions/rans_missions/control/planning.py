"""Base of guidance that plans whole flights by optimization, follows its plans, and plans again when off them."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Generic, TypeVar

from rans.extend import ConfigError, Spacecraft, Task, Timing, is_finite
from rans.optimal.control.regulator import ModelBased

Plan = TypeVar("Plan")


class PlanningGuidance(ModelBased, Generic[Plan]):
    """A controller with one plan for each episode, which leaves a reserve of limits for the correction of errors.

    Args:
        craft: by name, TOML file or as such.
        task: by name or as such.
        timing: control period, and length of the episode; None: the task's own.
        reserve: share of limits that plans leave.

    Raises:
        ConfigError: there is no such spacecraft or task, or the reserve is not at least 0 and below 0.5.
    """

    slow = True
    heeds_constraints: ClassVar[bool] = True

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None,
        reserve: float,
    ) -> None:
        super().__init__(craft, task, timing)
        if not (is_finite(reserve) and 0.0 <= reserve < 0.5):
            raise ConfigError(f"reserve must be at least 0 and below 0.5, got {reserve!r}.")
        self._reserve = reserve
        self._plans: list[Plan | None] = []
        self.failures = 0
        """Number of times that no plan was found."""

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`; plans are forgotten."""
        self._plans = [None] * count
