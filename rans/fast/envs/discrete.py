"""Discrete actions: every combination of open thrusters as one number."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from rans.errors import ConfigError

MOST_THRUSTERS = 10
"""Largest number of thrusters: 1,024 actions are about the limit of a Q-network."""


class DiscreteThrusters(gymnasium.ActionWrapper[np.ndarray, np.int64, np.ndarray]):
    """Wrapper of an environment with on/off thrusters whose action is one number, for DQN and similar algorithms.

    It wraps environments such as ``gymnasium.make("rans/GoToPose2D-v0")``. Bit i of the number, the lowest first,
    opens thruster i: 5 opens thrusters 0 and 2.

    Raises:
        ConfigError: its thrusters are not on/off ones, or more than `MOST_THRUSTERS`.
    """

    def __init__(self, env: gymnasium.Env[np.ndarray, np.ndarray]) -> None:
        super().__init__(env)
        space: Any = env.action_space
        if not isinstance(space, spaces.MultiDiscrete) or (space.nvec != 2).any():
            raise ConfigError(
                f"DiscreteThrusters needs on/off thrusters, got the action space {space}; SAC "
                "and TD3 train thrusters that take numbers from 0 to 1."
            )
        if space.shape[0] > MOST_THRUSTERS:
            raise ConfigError(
                f"DiscreteThrusters is for up to {MOST_THRUSTERS} thrusters, got "
                f"{space.shape[0]}, which are {2 ** space.shape[0]:,} combinations; PPO decides "
                "each on its own."
            )
        self._thrusters = np.arange(space.shape[0])
        self.action_space = spaces.Discrete(2 ** space.shape[0])

    def action(self, action: np.int64) -> np.ndarray:
        """Command (thrusters,) of an action number."""
        return int(action) >> self._thrusters & 1
