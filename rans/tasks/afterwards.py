"""What a controller without training does once the mission of its task is over."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np


class Afterwards(Protocol):
    """Stays where a mission ended, or plans again, in place of a controller that plans arrivals.

    A simulator of somebody else, or a robot, goes on after a success and after a deadline.
    """

    stays: np.ndarray
    """(N,) bool: whether each episode stays."""

    def reset(self, count: int) -> None:
        """Forget arrivals and plans: ``count`` new episodes begin."""
        ...

    def goal(self, state: Any, goal: Any, exact: bool = True) -> Any:
        """The goal to fly to now; called once in every control period, it updates `stays`."""
        ...

    def commands(
        self, state: Any, goal: Any, others: np.ndarray, acceleration: Any = None
    ) -> np.ndarray:
        """Commands (N, commands) of craft that stay, and ``others`` of those that do not."""
        ...
