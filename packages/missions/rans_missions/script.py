"""Fixed sequences of commands as a controller: plans that are flown in both engines."""

from __future__ import annotations

from typing import Any

import numpy as np


class Script:
    """Gives a fixed sequence of commands, (T, N, commands)."""

    name = "script"
    observes = False

    def __init__(self, commands: np.ndarray) -> None:
        self._commands = commands
        self._step = 0

    def reset(self, count: int) -> None:
        """Begin the sequences of ``count`` episodes."""
        self._step = 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands of its sequence for this control period."""
        commands = self._commands[self._step]
        self._step += 1
        return commands
