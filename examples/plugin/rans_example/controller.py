"""Fly where the task's first vector points, and brake in time."""

from typing import Any

import numpy as np

from rans import ConfigError, Spacecraft, Timing
from rans.extend import Task


class Steer:
    """Opens the thrusters that push towards the wanted velocity, half the way still to go in a second.

    Raises:
        ConfigError: the spacecraft moves in space.
    """

    name = "steer"

    def __init__(self, craft: Spacecraft, task: Task, timing: Timing) -> None:
        if craft.dimension != 2:
            raise ConfigError(f"steer flies in the plane only, not {craft.name}.")
        self._wrenches = np.array(craft.wrench_map)

    def reset(self, count: int) -> None:
        """It remembers nothing."""

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.episode.flight.Controller`; `rans list keep-distance` names the observation's columns."""
        cosine, sine, v_x, v_y, spin, _, way_x, way_y = observation.T[:8]
        x = 0.5 * way_x - v_x
        y = 0.5 * way_y - v_y
        wanted = np.stack((cosine * x + sine * y, cosine * y - sine * x, -0.5 * spin))  # in B
        return (self._wrenches @ wanted).T > 0.02
