"""A controller that flies a craft with six throttles at its target."""

from __future__ import annotations

from typing import Any

import numpy as np


class Ramming:
    """Full thrust towards the target."""

    name = "ramming"

    def reset(self, count: int) -> None:
        """Nothing to forget."""

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        way = np.array((goal.p - state.p).columns())
        return np.array([x for axis in np.sign(way) for x in (axis > 0, axis < 0)], float).T
