"""On/off commands as the engines' equations fly them, and what they spend."""

from __future__ import annotations

import numpy as np

from rans.extend import Body, Spacecraft, advance
from rans.model.dynamics import AnyState, wrench


def state_after(
    craft: Spacecraft, start: AnyState, commands: np.ndarray, period: float, substeps: int = 1
) -> AnyState:
    """The state after all commands (T, thrusters), each held for a period (s), by the engines' equations.

    Commands that prove an optimum are flown by it and must end in the goal set.
    """
    state = start
    body = Body.of(craft)
    for command in commands:
        state = advance(
            state, wrench(craft, tuple(float(c) for c in command)), body, period, substeps
        )
    return state


def fuel(craft: Spacecraft, commands: np.ndarray, period: float) -> float:
    """Thrust times time, summed over the thrusters, N s."""
    return float(commands.sum(axis=0) @ [thruster.force for thruster in craft.thrusters]) * period
