"""Controllers in an ordinary Gymnasium environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from rans.environment import Environment
from rans.errors import ConfigError
from rans.evaluation.fly.controllers import controller
from rans.evaluation.fly.protocols import Setup
from rans.model.fields import map_leaves


class Pilot:
    """A controller that decides for one environment, from its public ``state`` and ``goal``.

    Args:
        name: of `rans.evaluation.fly.controllers.CONTROLLERS`, or MODULE:NAME; see `controller`.
        env: of `rans.environment`, in whatever wrappers.

    Raises:
        ConfigError: it is another environment, there is no such controller, or not for this craft.
    """

    def __init__(self, name: str, env: gymnasium.Env[Any, Any]) -> None:
        found = env.unwrapped
        if not isinstance(found, Environment):
            raise ConfigError(f"a pilot flies one of RANS's environments for one spacecraft, got {found!r}.")
        self._env, self._space = found, env.action_space
        self._controller = controller(name, Setup(found.craft, found.task, found.timing))
        self.reset()

    def reset(self) -> None:
        """Forget the past; call it after ``env.reset``."""
        self._controller.reset(1)

    def act(self, observation: np.ndarray) -> np.ndarray:
        """The action for what is seen now: (thrusters,), of the environment's action space."""
        state, goal = (map_leaves(lambda x: np.array([x], np.float64), s)
                       for s in (self._env.state, self._env.goal))
        return self._controller.act(state, goal, observation[None])[0].astype(self._space.dtype)
