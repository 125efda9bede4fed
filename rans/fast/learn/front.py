"""PPO for Python: train on an engine of your own, predict, save and load."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from rans.errors import ConfigError, brief, fits, meant, whole
from rans.fast.agent_files.agent import read_policy
from rans.fast.engine import Engine
from rans.fast.envs.sb3 import SB3VecEnv
from rans.fast.learn.config import PPOSettings
from rans.fast.learn.member import begin, statistics
from rans.fast.learn.policy_file import adopt, write_learner
from rans.fast.policy import predict

_KNOWN = PPOSettings.__dataclass_fields__.keys() - {"n_envs"}


class PPO:
    """The trainer behind `rans train`, on an engine of your own.

    >>> engine = rans.Engine("floating-platform", "go-to-pose", num_envs=64)
    >>> rans.PPO(engine, n_steps=16).learn(2048)
    <PPO on <Engine: 64 x floating-platform, GoToPose, on cpu>: 2,048 steps>

    What it saves opens with ``stable_baselines3.PPO.load``. Its update equals SB3's on the same minibatch;
    minibatches are whole environments, unshuffled.

    Args:
        env: the engine, or the `SB3VecEnv` around it; its environments are ``n_envs``.
        seed: of weights and actions.
        threads: torch's on a CPU, for the whole process; None leaves them as they are. One is nearly as
            fast as two for small networks, and many times faster when anything else runs.
        plain: whether everything is computed as it is written, with autograd's gradients, so that a breakpoint
            stops (docs/plain.md); None: if the engine is plain.
        **settings: of `PPOSettings`, except ``n_envs``; by default a minibatch is a quarter of a rollout.

    Raises:
        ConfigError: the environment is of another kind, or a setting is unknown or out of its range.
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
            said = ", ".join(name + meant(name, _KNOWN) for name in sorted(unknown))
            raise ConfigError(
                f"rans.PPO has no setting {said}; those of rans.fast.learn.config.PPOSettings "
                "are known, except n_envs, which the engine decides."
            )
        count = self.engine.num_envs * self.engine.processes.size
        rollout = count * settings.get("n_steps", PPOSettings.n_steps)
        quarter = rollout // 4 if count % 4 == 0 else rollout
        self.settings = PPOSettings(**{"n_envs": count, "batch_size": quarter} | settings)
        self.learner = begin(self.engine, [self.settings], [seed], plain)
        self.num_timesteps = 0
        self.network = self.learner.network
        """Actor and critic."""
        self.log: dict[str, float] = {}
        """What the last iteration said, by SB3's names."""

    def __repr__(self) -> str:
        return f"<PPO on {self.engine!r}: {self.num_timesteps:,} steps>"

    def learn(self, total_timesteps: int, report: Callable[[PPO], object] = lambda _: None) -> PPO:
        """Learn from so many more environment steps, rounded up to whole rollouts.

        After every iteration ``report`` is called; `log` and `num_timesteps` say how it went. NonFiniteState
        where a value became NaN or infinite, ConfigError where ``total_timesteps`` is no number.
        """
        if not fits(total_timesteps, lambda x: x >= 0):
            raise ConfigError(
                f"total_timesteps must be a number >= 0, got {brief(total_timesteps)}."
            )
        begun = self.num_timesteps
        rollout = self.settings.n_envs * self.settings.n_steps
        while self.num_timesteps - begun < total_timesteps:
            self.learner.slow_down(1 - (self.num_timesteps - begun) / total_timesteps)
            (said,) = self.learner.learn().tolist()
            self.num_timesteps += rollout
            self.log = statistics(said, self.learner, self.num_timesteps, rollout)
            report(self)
        return self

    def predict(
        self,
        observation: np.ndarray,
        state: tuple[np.ndarray, ...] | None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, tuple[np.ndarray, ...] | None]:
        """Commands (N, thrusters) for observations (N, width), and the network's memory; as SB3's."""
        return predict(self.network, observation, state, episode_start, deterministic)

    def save(self, file: str | Path) -> None:
        """Write ``policy.zip``; ConfigError where the disk refuses."""
        write_learner(Path(file), self.learner, self.settings, self.num_timesteps)

    @classmethod
    def load(cls, file: str | Path, env: Engine | SB3VecEnv, **settings: Any) -> PPO:
        """Go on with an agent that `rans train` or `save` wrote, on an engine for its spacecraft.

        Settings are as in the constructor, where they are others than it was trained with.

        Raises:
            ConfigError: the file is damaged, not for this engine, or holds no critic to go on with.
        """
        engine = _engine_of(env)
        saved = read_policy(Path(file))
        if not saved.has_critic:
            raise ConfigError(
                f"{file} is an agent without its critic, as one ships, so that PPO cannot go on with "
                "it: train it anew from its recipe or config.json, or load the policy.zip of a run "
                "folder."
            )
        count = engine.num_envs
        kept = {name: value for name, value in saved.settings.items() if name in _KNOWN}
        if saved.settings.get("n_envs") != count:
            kept.pop("batch_size", None)
        model = cls(env, **kept | settings)
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
    engine = env.engine if isinstance(env, SB3VecEnv) else env
    if not isinstance(engine, Engine):
        raise ConfigError(
            f"rans.PPO trains on a rans.Engine or the rans.SB3VecEnv around it, got "
            f"{type(env).__name__}; use stable_baselines3.PPO for other environments."
        )
    return engine
