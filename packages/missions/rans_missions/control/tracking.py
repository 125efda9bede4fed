"""From changes of velocity to commands: what guidance on orbits asks for, as thrusters can give it in a period."""

from __future__ import annotations

from typing import Any

import numpy as np

from rans.control.allocation import Rounding
from rans.extend import Heading, Quat, Spacecraft, leaves


class Tracker:
    """Gives changes of velocity by thrusters, and no torque.

    Nothing is carried over to the next period: guidance sees what is missing in the next state.

    Args:
        craft: what flies.
        period: control period, s.
    """

    def __init__(self, craft: Spacecraft, period: float) -> None:
        self._level = Heading(0.0) if craft.dimension == 2 else Quat(1.0, 0.0, 0.0, 0.0)
        self._torques = craft.degrees_of_freedom - craft.dimension
        self._force = craft.mass / period
        self._rounding = Rounding(craft, period, np.zeros(craft.degrees_of_freedom, bool))

    def reset(self, count: int) -> None:
        """Begin ``count`` new episodes."""
        self._rounding.reset(count)

    def commands(self, state: Any, change: Any, burns: np.ndarray) -> np.ndarray:
        """Commands (N, commands) for changes of velocity, m/s, vectors of fields (N,) in W.

        Args:
            state: states (N,).
            change: changes.
            burns: which craft burn, (N,); the others keep shut.
        """
        force = state.attitude.to(self._level).rotate(change.scale(self._force))
        rows = np.stack(np.broadcast_arrays(*leaves(force)), axis=1)
        wrench = np.pad(rows, ((0, 0), (0, self._torques)))
        return self._rounding.round(wrench, ~(burns & wrench.any(axis=1)), state.stores)
