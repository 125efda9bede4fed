"""A controller that plays commands back."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np


class Played:
    """Commands (T, N, commands) that are written beforehand, or that a function of period and N gives."""

    name = "played"

    def __init__(self, commands: np.ndarray | Callable[[int, int], Any]) -> None:
        self.commands = commands

    def reset(self, count: int) -> None:
        self.count = count
        self.step = -1

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> Any:
        self.step += 1
        given = self.commands
        return given(self.step, self.count) if callable(given) else given[self.step]
