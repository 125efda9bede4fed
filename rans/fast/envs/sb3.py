"""The engine as a Stable-Baselines3 ``VecEnv``: any SB3 algorithm trains on it unchanged."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs, VecEnvStepReturn
from torch import Tensor

from rans.effectors.commands import action_space
from rans.environment import observation_space
from rans.errors import checked
from rans.fast.engine import Engine
from rans.fast.envs.actions import Actions


class SB3VecEnv(VecEnv):
    """An `Engine` seen through SB3's interface, without a copy.

    >>> rans.SB3VecEnv(rans.Engine("floating-platform", "go-to-pose", num_envs=4)).reset().shape
    (4, 10)

    Every ended episode's return and length are in its info as "episode", so that SB3 logs
    ``rollout/ep_rew_mean`` without a monitor.

    SB3 wants NumPy arrays and one dict per environment and step, which costs more than the
    simulation; `rans.PPO` takes the same object and goes around both.
    """

    def __init__(self, engine: Engine) -> None:
        self.engine = engine = checked("engine", engine, Engine)
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

    def reset(self) -> VecEnvObs:
        """Start every episode anew; (N, width) float32."""
        seed = self._seeds[0]
        self._reset_seeds()
        self._reset_options()
        self.reset_infos = [{} for _ in range(self.num_envs)]
        self._returns[:] = 0.0
        self._lengths[:] = 0
        return _float32(self.engine.reset(seed))

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions (N, thrusters) for `step_wait`; ConfigError where thrusters cannot follow them."""
        self._action = self._actions.checked(actions)

    def step_wait(self) -> VecEnvStepReturn:
        """One control period; ends are reported in SB3's way, with same-step reset."""
        step = self.engine.step(self._action)
        done = (step.terminated | step.truncated).cpu().numpy()
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        ended = np.flatnonzero(done)
        reward = _float32(step.reward)
        self._returns += reward
        self._lengths += 1
        if len(ended):
            final = _float32(step.final_observation)
            truncated = step.truncated.cpu().numpy()
            success = step.success.cpu().numpy()
            for i in ended:
                infos[i] = {
                    "terminal_observation": final[i],
                    "TimeLimit.truncated": bool(truncated[i]),
                    "is_success": bool(success[i]),
                    "episode": {
                        "r": round(float(self._returns[i]), 6),
                        "l": int(self._lengths[i]),
                        "t": round(time.time() - self._begun, 6),
                    },
                }
            self._returns[ended] = 0.0
            self._lengths[ended] = 0
        return _float32(step.observation), reward, done, infos

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Choose the seed of all scenarios; takes effect at the next reset.

        The whole batch has one seed: episode k is the same however many environments share it.
        """
        self._seeds = [seed] * self.num_envs
        return self._seeds

    def close(self) -> None:
        """Nothing to release."""

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """The attribute of the batch, once per environment asked for."""
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
        """Call a method of the batch, its result once per environment asked for."""
        result = getattr(self, method_name)(*method_args, **method_kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type, indices: VecEnvIndices = None) -> list[bool]:
        """Single environments do not exist, so none is wrapped."""
        return [False for _ in self._get_indices(indices)]


def _float32(tensor: Tensor) -> np.ndarray:
    """What SB3 keeps in its buffers, whatever the engine's dtype and device."""
    return tensor.to(torch.float32).cpu().numpy()
