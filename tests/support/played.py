"""A controller that plays commands back."""

from __future__ import annotations

from typing import Any

import numpy as np


class Played:
    """Commands (T, N, commands) that are written beforehand."""

    name = "played"

    def __init__(self, commands: np.ndarray) -> None:
        self.commands = commands

    def reset(self, count: int) -> None:
        self.step = -1

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        self.step += 1
        return self.commands[self.step]
