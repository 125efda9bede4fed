"""Control periods that tests of tasks are rewarded for."""

from __future__ import annotations

from typing import Any

from rans.tasks.rewards import Transition

COUNT = 64
"""Spacecraft in every batch."""


def arrival(state: Any, goal: Any, command: Any, previous: Any) -> Transition:
    """A control period of 0.2 s that ends in the state it began in, of thrusters of 1 N."""
    forces = (1.0,) * len(command)
    return Transition(state, goal, tuple(command), tuple(previous), state, 0.2, forces)
