"""A controller that gives commands whatever the state is."""

from __future__ import annotations

from typing import Any

import numpy as np

from rans_missions.control.afterwards import Afterwards


class Script:
    """Gives a fixed sequence of commands, and from the arrival on stays if it is told how.

    Args:
        commands: (T, N, commands).
        afterwards: what it does from the arrival on; None: what the sequence says.
    """

    name = "script"
    observes = False

    def __init__(self, commands: np.ndarray, afterwards: Afterwards | None = None) -> None:
        self._commands = commands
        self._afterwards = afterwards
        self._step = 0

    def reset(self, count: int) -> None:
        """Begin the sequences of ``count`` episodes."""
        self._step = 0
        if self._afterwards is not None:
            self._afterwards.reset(count)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands of its sequence for this control period, and after an arrival those that stay there."""
        commands = self._commands[self._step]
        self._step += 1
        if self._afterwards is None:
            return commands
        goal = self._afterwards.goal(state, goal)
        return self._afterwards.commands(state, goal, commands)
