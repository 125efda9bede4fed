"""Trainings that tests share: so small that an iteration takes milliseconds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import stable_baselines3
import torch
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import Tensor

from rans.fast.engine import Engine
from rans.fast.envs.sb3 import SB3VecEnv
from rans.fast.learn.config import PPOSettings, TrainConfig
from rans.fast.learn.ppo import PPO
from rans.fast.learn.run_folder import RunFolder
from rans.fast.learn.trainer import Trainer, make_ppo
from rans.tasks import GoToPose
from tests.fast.engines import NEAR, PLATFORM, SHORT

TINY = PPOSettings(n_envs=16, n_steps=8, batch_size=64, n_epochs=2, layers=(16, 16))
CONFIG = TrainConfig("go-to-pose", GoToPose(), "floating-platform", TINY, SHORT, total_timesteps=2048,
                     solved_share=None)


def tiny_ppo(craft: Any = PLATFORM, seed: int = 0, dtype: torch.dtype = torch.float32, task: Any = NEAR,
             **settings: Any) -> PPO:
    """PPO, by default on `NEAR`, where many episodes fail and others are cut off by time."""
    chosen = replace(TINY, **{"symmetric": False} | settings)
    return make_ppo(Engine(craft, task, chosen.n_envs, SHORT, seed=seed, dtype=dtype), chosen, seed)


def tiny_trainer(path: Path, config: TrainConfig = CONFIG) -> Trainer:
    """A trainer in a new run folder."""
    run = RunFolder(path)
    run.begin(config, "rans train")
    return Trainer(config, run.spacecraft(), run)


def weights(policy: ActorCriticPolicy) -> Tensor:
    """Every parameter and statistic of a policy, in one row."""
    return torch.cat([value.detach().flatten() for value in policy.state_dict().values()])


def scatter(policy: ActorCriticPolicy, seed: int = 3) -> None:
    """Make weights large, so that probabilities and values differ visibly between observations."""
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for parameter in policy.parameters():
            parameter.copy_(torch.randn(parameter.shape, generator=generator) * 0.5)


class Buffer64(RolloutBuffer):
    """SB3's buffer with its arithmetic in float64, to compare to more than seven digits."""

    def reset(self) -> None:
        super().reset()
        for name in ("rewards", "returns", "values", "log_probs", "advantages", "episode_starts"):
            setattr(self, name, getattr(self, name).astype(np.float64))


def sb3_twin(model: PPO, **settings: Any) -> stable_baselines3.PPO:
    """Stable-Baselines3's own PPO with the same settings and weights, on an engine of the same seed."""
    engine = model.env.engine  # type: ignore[union-attr]
    env = SB3VecEnv(Engine(engine.craft, engine.task, engine.num_envs, engine.timing, dtype=engine.dtype))
    names = ("n_steps", "n_epochs", "gamma", "gae_lambda", "ent_coef", "vf_coef", "max_grad_norm",
             "policy_kwargs", "learning_rate", "seed")
    given = {name: getattr(model, name) for name in names} | settings
    twin = stable_baselines3.PPO(
        "MlpPolicy", env, batch_size=engine.num_envs * model.n_steps, clip_range=model.clip_range(1.0),  # type: ignore[operator]
        rollout_buffer_class=Buffer64, device="cpu", **given)
    twin.policy.to(engine.dtype)
    twin.policy.load_state_dict(model.policy.state_dict())
    twin.set_logger(Logger(None, []))
    return twin


def ignore(_: Any) -> None:
    """A report to nobody."""


def resumed(path: Path) -> Trainer:
    run = RunFolder(path)
    trainer = Trainer(run.config(), run.spacecraft(), run)
    trainer.resume()
    return trainer


def after(count: int) -> Any:
    """Asks for a stop after so many iterations."""
    asked = iter(range(10**9))
    return lambda: next(asked) + 1 >= count
