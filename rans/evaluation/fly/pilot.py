"""Controllers in an ordinary Gymnasium environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from rans.base.errors import ConfigError, brief
from rans.base.registry import typed
from rans.episode.environment import Environment
from rans.episode.flight import Controller, begin_flight
from rans.episode.step import Setup
from rans.evaluation.fly.agent import run_of
from rans.evaluation.fly.make_controller import controller
from rans.model.fields import map_leaves


class Pilot:
    """A controller or an agent that decides for one environment, from its public ``state`` and ``goal``.

    >>> env = gymnasium.make("rans/GoToPose2D-v0")
    >>> observation, _ = env.reset(seed=0)
    >>> agent = rans.load_agent("go-to-pose-2d")
    >>> rans.Pilot("lqr", env).act(observation).shape, rans.Pilot(agent, env).act(observation).shape
    ((8,), (8,))

    Args:
        who: a name of `rans.evaluation.fly.controllers.CONTROLLERS`, or MODULE:NAME, see `controller`; or
            the result of `rans.load_agent`.
        env: environment of `rans.episode.environment`, in any wrappers.

    Raises:
        ConfigError: the environment is another, there is no such controller, or it is not for this craft.
    """

    def __init__(self, who: object, env: gymnasium.Env[Any, Any]) -> None:
        result = env.unwrapped if isinstance(env, gymnasium.Env) else env
        if not isinstance(result, Environment):
            raise ConfigError(
                f"a pilot flies one of RANS's environments for one spacecraft, got {result!r}."
            )
        self._env = result
        self._space = env.action_space
        setup = Setup(result.craft, result.task, result.timing)
        self._controller = (
            controller(typed(who), setup) if isinstance(who, str) else _agent(who, setup)
        )
        self.reset()

    def __repr__(self) -> str:
        return f"<Pilot: {self._controller.name} in {self._env}>"

    def reset(self) -> None:
        """Begin an episode; call it after ``env.reset``."""
        self._controller = begin_flight(self._controller, 1)

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Action (thrusters,) of the environment's action space for an observation."""
        state, goal = (
            map_leaves(lambda x: np.array([x], np.float64), s)
            for s in (self._env.state, self._env.goal)
        )
        return self._controller.act(state, goal, observation[None])[0].astype(self._space.dtype)


def _agent(who: object, setup: Setup) -> Controller:
    """The controller of an agent, if it is one of this task and spacecraft."""
    run = run_of(who)
    if run is None:
        raise ConfigError(
            f"a pilot is the name of a controller, or the result of rans.load_agent, got {brief(who)}."
        )
    if run.craft != setup.craft or type(run.task) is not type(setup.task):
        raise ConfigError(
            f"{run!r} cannot fly {type(setup.task).__name__} with {setup.craft.name}; make the "
            "environment of its task, with its spacecraft."
        )
    return run.controller
