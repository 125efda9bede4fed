"""Stable-Baselines3 ``VecEnv`` of an engine, for any SB3 algorithm."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs, VecEnvStepReturn
from torch import Tensor

from rans import Engine
from rans.base.settled import settled
from rans.episode.environment import within
from rans.extend import ConfigError, action_space, brief, checked, observation_space
from rans.fast.envs.actions import Actions


class SB3VecEnv(VecEnv):
    """Stable-Baselines3 vector environment of an `Engine`.

    >>> rans.SB3VecEnv(rans.Engine("floating-platform", "go-to-pose", num_envs=4)).reset().shape
    (4, 10)

    Return and length of every ended episode are in its info as "episode", so that SB3 logs ``rollout/ep_rew_mean``
    without a monitor.

    SB3 needs NumPy arrays and one dict per environment and step, which costs more than the simulation; `rans.train`
    avoids both.
    """

    @settled
    def __init__(self, engine: Engine) -> None:
        self.engine = engine = checked("engine", engine, Engine)
        # SB3's constructor asks its environments, which are this object, for their render_mode.
        self.render_mode = None
        super().__init__(
            engine.num_envs,
            observation_space(engine.task, engine.craft.dimension),
            action_space(engine.craft),
        )
        self._action = torch.zeros(0)
        self._actions = Actions(engine)
        self._returns = np.zeros(engine.num_envs)
        self._lengths = np.zeros(engine.num_envs, dtype=int)
        self._begun = time.time()

    def __repr__(self) -> str:
        return f"<SB3VecEnv around {self.engine!r}>"

    @settled
    def reset(self) -> VecEnvObs:
        """Start new episodes; returns the observation (N, width), float32.

        Seeds that were set hold for this reset alone.

        Raises:
            ConfigError: options were set; there are none.
        """
        options = self._options
        self._reset_options()
        for option in (name for own in options for name in own):
            raise ConfigError(f"unknown option {brief(option)} of reset; SB3VecEnv has none.")
        seed = self._seeds[0]
        self._reset_seeds()
        self.reset_infos = [{} for _ in range(self.num_envs)]
        self._returns[:] = 0.0
        self._lengths[:] = 0
        return within(self.observation_space, _float32(self.engine.reset(seed)))

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions (N, commands) for `step_wait`.

        Raises:
            ConfigError: an action is out of range.
        """
        self._action = self._actions.checked(actions)

    @settled
    def step_wait(self) -> VecEnvStepReturn:
        """Step one control period; episodes restart in the step that ends them, as SB3 expects.

        Keys of the information are those that Stable-Baselines3 reads.
        """
        step = self.engine.step(self._action)
        done = (step.terminated | step.truncated).cpu().numpy()
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        ended = np.flatnonzero(done)
        reward = _float32(step.reward)
        self._returns += reward
        self._lengths += 1
        if len(ended):
            final = within(self.observation_space, _float32(step.final_observation))
            truncated = step.truncated.cpu().numpy()
            at_goal = step.at_goal.cpu().numpy()
            for i in ended:
                infos[i] = {
                    "terminal_observation": final[i],
                    "TimeLimit.truncated": bool(truncated[i]),
                    self.engine.task.end_key: bool(at_goal[i]),
                    "episode": {
                        "r": round(float(self._returns[i]), 6),
                        "l": int(self._lengths[i]),
                        "t": round(time.time() - self._begun, 6),
                    },
                }
            self._returns[ended] = 0.0
            self._lengths[ended] = 0
        return within(self.observation_space, _float32(step.observation)), reward, done, infos

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Set the seed of all scenarios from the next reset on.

        The whole batch has one seed; episode k is the same for any number of environments.
        """
        self._seeds = [seed] * self.num_envs
        return self._seeds

    def close(self) -> None:
        """Close the environment; there is nothing to release."""

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Attribute of the batch, once per requested environment."""
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the whole batch; single environments do not exist."""
        setattr(self, attr_name, value)

    def env_method(
        self,
        method_name: str,
        *method_args: Any,
        indices: VecEnvIndices = None,
        **method_kwargs: Any,
    ) -> list[Any]:
        """Result of a method of the batch, once per requested environment."""
        result = getattr(self, method_name)(*method_args, **method_kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type, indices: VecEnvIndices = None) -> list[bool]:
        """False for every environment, because single environments do not exist."""
        return [False for _ in self._get_indices(indices)]


def _float32(tensor: Tensor) -> np.ndarray:
    """NumPy float32 array of a tensor, as SB3 stores it."""
    return tensor.to(torch.float32).cpu().numpy()
