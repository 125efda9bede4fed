"""Python interface of PPO: train on your own engine, predict, save and load."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from rans.errors import ConfigError, brief, fits, meant, whole
from rans.fast.agent_files.agent import read_policy
from rans.fast.engine import Engine
from rans.fast.learn.beginning import begin, statistics
from rans.fast.learn.config import PPOSettings
from rans.fast.learn.policy_file import adopt, write_learner
from rans.policy.predict import predict

if TYPE_CHECKING:
    from rans.fast.envs.sb3 import SB3VecEnv

_KNOWN = PPOSettings.__dataclass_fields__.keys() - {"n_envs"}


class PPO:
    """Proximal policy optimisation on an engine of your own, with the interface of Stable-Baselines3.

    >>> engine = rans.Engine("floating-platform", "go-to-pose", num_envs=64)
    >>> rans.PPO(engine, n_steps=16).learn(2048)
    <PPO on <Engine: 64 x floating-platform, GoToPose, on cpu>: 2,048 steps>

    Agents saved as ``NAME.zip`` open with ``stable_baselines3.PPO.load``. An update equals that of SB3 on the
    same minibatch; minibatches are whole environments, without shuffling.

    Args:
        env: engine, or the `SB3VecEnv` around it, which determines ``n_envs``.
        seed: seed of weights and actions.
        threads: number of threads of torch on a CPU, for the whole process; None: unchanged. One is nearly as fast
            as two for small networks, and many times faster beside other programs.
        plain: whether everything is computed by single operations of torch and gradients by autograd, so that
            breakpoints work (docs/plain.md); None: as the engine.
        **settings: fields of `PPOSettings` except ``n_envs``; by default a minibatch is a quarter of a rollout.

    Raises:
        ConfigError: the environment is of another class, or a setting is unknown or out of its range.
    """

    def __init__(
        self,
        env: Engine | SB3VecEnv,
        *,
        seed: int = 0,
        threads: int | None = 1,
        plain: bool | None = None,
        **settings: Any,
    ) -> None:
        self.engine = _engine_of(env)
        if threads is not None:
            torch.set_num_threads(whole("threads", threads))
        if unknown := settings.keys() - _KNOWN:
            names = ", ".join(name + meant(name, _KNOWN) for name in sorted(unknown))
            raise ConfigError(
                f"rans.PPO has no setting {names}; it has those of rans.fast.learn.config.PPOSettings "
                "except n_envs, which the engine determines."
            )
        count = self.engine.num_envs * self.engine.processes.size
        rollout = count * settings.get("n_steps", PPOSettings.n_steps)
        quarter = rollout // 4 if count % 4 == 0 else rollout
        sizes: dict[str, Any] = {"n_envs": count, "batch_size": quarter}
        self.settings = PPOSettings(**(sizes | settings))
        self.learner = begin(self.engine, self.settings, seed, plain)
        self.num_timesteps = 0
        self.network = self.learner.network
        """Network of actor and critic."""
        self.log: dict[str, float] = {}
        """Statistics of the last iteration, by the names of SB3."""

    def __repr__(self) -> str:
        return f"<PPO on {self.engine!r}: {self.num_timesteps:,} steps>"

    def learn(self, total_timesteps: int, report: Callable[[PPO], object] = lambda _: None) -> PPO:
        """Train for further environment steps, rounded up to whole rollouts.

        It changes weights, `num_timesteps` and `log`, and returns itself.

        Args:
            total_timesteps: number of further environment steps.
            report: called after every iteration with this object; see `log` and `num_timesteps`.

        Raises:
            NonFiniteState: a value became NaN or infinite.
            ConfigError: ``total_timesteps`` is not a number >= 0.
        """
        if not fits(total_timesteps, lambda x: x >= 0):
            raise ConfigError(
                f"total_timesteps must be a number >= 0, got {brief(total_timesteps)}."
            )
        begun = self.num_timesteps
        rollout = self.settings.n_envs * self.settings.n_steps
        while self.num_timesteps - begun < total_timesteps:
            self.learner.slow_down(1 - (self.num_timesteps - begun) / total_timesteps)
            values = self.learner.learn().tolist()
            self.num_timesteps += rollout
            self.log = statistics(values, self.learner, self.num_timesteps)
            report(self)
        return self

    def predict(
        self,
        observation: np.ndarray,
        state: tuple[np.ndarray, ...] | None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, tuple[np.ndarray, ...] | None]:
        """Commands (N, commands) for observations (N, width), and the memory of the network, as in SB3."""
        return predict(self.network, observation, state, episode_start, deterministic)

    def save(self, file: str | Path) -> None:
        """Write the agent with its critic and optimizer, for `load`.

        Args:
            file: ``agent.safetensors``, or a name that ends in ``.zip`` for a file that
                ``stable_baselines3.PPO.load`` opens too, which needs that package.

        Raises:
            ConfigError: the file cannot be written.
        """
        write_learner(Path(file), self.learner, self.settings, self.num_timesteps)

    @classmethod
    def load(cls, file: str | Path, env: Engine | SB3VecEnv, **settings: Any) -> PPO:
        """Continue the training of an agent from `rans train` or `save`, on an engine for its spacecraft.

        Args:
            file: ``agent.safetensors`` of a run folder, or what `save` wrote.
            env: engine, or the `SB3VecEnv` around it.
            **settings: fields of `PPOSettings` that differ from those of its training.

        Raises:
            ConfigError: the file is damaged, not for this engine, or has no critic.
        """
        engine = _engine_of(env)
        saved = read_policy(Path(file))
        if not saved.has_critic:
            raise ConfigError(
                f"{file} is an agent without its critic, so that PPO cannot continue its training: "
                "train it again from its recipe or config.json, or load the agent.safetensors of a "
                "run folder."
            )
        count = engine.num_envs
        accepted = {name: value for name, value in saved.settings.items() if name in _KNOWN}
        if saved.settings.get("n_envs") != count:
            accepted.pop("batch_size", None)
        model = cls(env, **accepted | settings)
        model.num_timesteps = saved.steps
        try:
            adopt(model.learner, saved)
        except (RuntimeError, KeyError) as error:
            raise ConfigError(
                f"{file} is not an agent for {model.engine.craft.name} with these settings: "
                f"{' '.join(str(error).split())}."
            ) from error
        return model


def _engine_of(env: Any) -> Engine:
    """The engine of an environment; `ConfigError` for environments of others."""
    engine = getattr(env, "engine", env)
    if not isinstance(engine, Engine):
        raise ConfigError(
            f"rans.PPO trains on a rans.Engine or the rans.SB3VecEnv around it, got "
            f"{type(env).__name__}; use stable_baselines3.PPO for other environments."
        )
    return engine
