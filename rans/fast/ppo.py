"""PPO whose rollouts, advantages and updates stay on the device, behind SB3's interface."""

from __future__ import annotations

from typing import Any

import numpy as np
import stable_baselines3
import torch
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv
from torch import Tensor, nn

from rans.errors import ConfigError, NonFiniteState
from rans.fast.engine import Engine
from rans.fast.graph import fused, graphed
from rans.fast.loss import Losses, ppo_loss
from rans.fast.policy import NormalisedMlp
from rans.fast.rollout import Batch, Rollout, minibatches
from rans.fast.sb3 import SB3VecEnv

_LEARNING_RATES = (1e-5, 1e-2)
"""Bounds of the adapted step size."""


class PPO(stable_baselines3.PPO):
    """`stable_baselines3.PPO` with everything between the callbacks replaced.

    Constructor, callbacks, logger, ``predict``, ``save`` and ``load`` are SB3's, and what it saves
    opens with ``stable_baselines3.PPO.load``. The update equals SB3's on the same minibatch;
    different are: minibatches are whole environments, unshuffled; ``on_step`` callbacks come after
    each rollout, one a step; ``env`` must be an `SB3VecEnv`. On a GPU, float32 matrix products use
    TF32, for the whole process.

    Args:
        policy: as SB3.
        env: the batched episodes.
        desired_kl: divergence a whole iteration should cause; the step size is adapted to it
            between 1e-5 and 1e-2. None: ``learning_rate`` as given.
        reward_scale: factor on every reward, so that values are of order one.
        **settings: SB3's, with its names and meanings.

    Raises:
        ConfigError: the environment is of another kind, the settings ask for something this trainer
            does not do, or a rollout is longer than an episode.
    """

    def __init__(self, policy: Any, env: Any, *, desired_kl: float | None = 0.016,
                 reward_scale: float = 0.1, _init_setup_model: bool = True, **settings: Any) -> None:
        self.desired_kl = desired_kl
        self.reward_scale = reward_scale
        super().__init__(policy, env, _init_setup_model=False, **settings)
        if _init_setup_model:
            self._setup_model()

    def _setup_model(self) -> None:
        # SB3 would allocate its own rollouts on the host; only `Rollout` is used.
        self.rollout_buffer_class = _NoBuffer  # type: ignore[assignment]
        super()._setup_model()
        self.rollout_buffer_class = None  # type: ignore[assignment]
        if self.env is None:
            return
        if not isinstance(self.env, SB3VecEnv):
            raise ConfigError(
                f"rans.fast.PPO trains on a rans.fast.SB3VecEnv, got {type(self.env).__name__}; use "
                "stable_baselines3.PPO for other environments.")
        self._check_settings(self.env.engine)
        self._prepare(self.env.engine)

    def _check_settings(self, engine: Engine) -> None:
        if self.n_steps > engine.timing.episode_steps:
            raise ConfigError(
                f"n_steps must not exceed the episode's {engine.timing.episode_steps} steps, got "
                f"{self.n_steps}: an episode may be cut off once a rollout at most.")
        samples = engine.num_envs * self.n_steps
        if self.batch_size % self.n_steps or samples % self.batch_size:
            raise ConfigError(
                f"batch_size must be a multiple of n_steps = {self.n_steps} that divides n_steps x "
                f"environments = {samples}, got {self.batch_size}.")
        for name, unsupported in (("clip_range_vf", self.clip_range_vf), ("use_sde", self.use_sde or None),
                                  ("target_kl", self.target_kl)):
            if unsupported is not None:
                raise ConfigError(f"{name} is not supported by rans.fast.PPO, got {unsupported}; "
                                  "leave it at its default or use stable_baselines3.PPO.")

    def _prepare(self, engine: Engine) -> None:
        """Fixed memory and fixed functions of one training iteration."""
        if self.device.type == "cuda":
            torch.set_float32_matmul_precision("high")
        self.policy.to(engine.dtype)
        group = self.policy.optimizer.param_groups[0]
        group["lr"] = torch.tensor(float(group["lr"]), dtype=torch.float32, device=self.device)
        group["capturable"] = self.device.type == "cuda"
        self._rollout = Rollout(engine, self.n_steps)
        self._loss = fused(ppo_loss, self.device)
        self.collect = graphed(self._collect_on_device, self.device)
        self.update = graphed(self._update_on_device, self.device)

    def _maybe_recommend_cpu(self, mlp_class_name: str = "") -> None:
        """SB3 warns that PPO is slow on a GPU; this one is not."""

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "_rollout", "_loss", "collect", "update", "_last_obs",
                "_last_episode_starts", "rollout_buffer_class"]

    def _setup_learn(self, *args: Any, **kwargs: Any) -> Any:
        """As SB3; new episodes begin at random times, so that they do not all end in one rollout."""
        fresh = self._last_obs is None
        result = super()._setup_learn(*args, **kwargs)
        if fresh:
            self.start()
        return result

    def start(self) -> None:
        """Let the episodes that run begin at random times."""
        self.env.engine.stagger()  # type: ignore[union-attr]

    def restore(self, policy: dict[str, Any], optimizer: dict[str, Any], num_timesteps: int) -> None:
        """Go on from saved state dicts of the policy and its optimiser after so many steps."""
        self.policy.load_state_dict(policy)
        self.policy.optimizer.load_state_dict(optimizer)
        self.num_timesteps = num_timesteps
        # SB3 resets the environment unless it has seen an observation; this trainer needs none.
        self._last_obs = np.zeros(0)

    def collect_rollouts(self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer,
                         n_rollout_steps: int) -> bool:
        """Fill the device's rollout; see SB3. The callbacks' ``on_step`` follow the flight."""
        self.policy.set_training_mode(False)
        callback.on_rollout_start()
        self.collect()
        callback.update_locals(locals())
        for _ in range(n_rollout_steps):
            self.num_timesteps += env.num_envs
            if not callback.on_step():
                return False
        callback.on_rollout_end()
        return True

    def train(self) -> None:
        """One iteration of updates; see SB3."""
        self.policy.set_training_mode(True)
        if self.desired_kl is None:
            rate = self.lr_schedule(self._current_progress_remaining)
            self.policy.optimizer.param_groups[0]["lr"].fill_(rate)
        statistics = self.update()
        self._n_updates += self.n_epochs
        self._record(statistics.tolist())

    def _collect_on_device(self) -> Tensor:
        engine = self.env.engine  # type: ignore[union-attr]
        self._rollout.collect(engine, self.policy)
        return self._rollout.reward

    def _update_on_device(self) -> Tensor:
        """Advantages, every minibatch of every epoch, step size: (statistics,) of `_record`."""
        engine, rollout = self.env.engine, self._rollout  # type: ignore[union-attr]
        batch = rollout.batch(engine, self.policy, self.gamma, self.gae_lambda, self.reward_scale)
        count = engine.num_envs * self.n_steps // self.batch_size
        parts = minibatches(batch, count)
        losses = [self._descend(part) for _ in range(self.n_epochs) for part in parts]
        mean = torch.stack([torch.stack(x) for x in losses]).mean(dim=0)
        self._adapt(mean[Losses._fields.index("approx_kl")])
        extractor = self.policy.features_extractor
        if isinstance(extractor, NormalisedMlp):
            extractor.update_statistics(batch.observation.flatten(0, 1))
        ends = torch.stack((rollout.truncated.sum(), rollout.ended.sum(), rollout.reached.sum()))
        return torch.cat((mean, ends, rollout.terms.mean(dim=0)))

    def _descend(self, batch: Batch) -> list[Tensor]:
        optimizer = self.policy.optimizer
        losses = self._loss(self.policy, batch, self.clip_range(1.0), self.ent_coef, self.vf_coef,  # type: ignore[operator]
                          self.normalize_advantage)
        optimizer.zero_grad()
        losses.loss.backward()
        nn.utils.clip_grad_norm_(self.policy.parameters(), self.max_grad_norm)
        optimizer.step()
        return [x.detach() for x in losses]

    def _adapt(self, kl: Tensor) -> None:
        """Steps too far for the desired divergence get shorter, too short ones longer."""
        if self.desired_kl is None:
            return
        rate = self.policy.optimizer.param_groups[0]["lr"]
        factor = torch.where(kl > 2.0 * self.desired_kl, 1 / 1.5,
                             torch.where(kl < 0.5 * self.desired_kl, 1.5, 1.0))
        rate.mul_(factor).clamp_(*_LEARNING_RATES)

    def _record(self, statistics: list[float]) -> None:
        """Hand the iteration's statistics to SB3's logger.

        Raises:
            NonFiniteState: a loss is NaN or infinite.
        """
        engine = self.env.engine  # type: ignore[union-attr]
        losses = dict(zip(Losses._fields, statistics, strict=False))
        truncated, ended, reached, *terms = statistics[len(Losses._fields):]
        if not all(abs(x) < float("inf") for x in statistics):
            raise NonFiniteState(
                f"training produced a value that is not finite after {self.num_timesteps} steps "
                f"(losses {losses}); the usual cause is a learning rate or a reward that is too large.")
        for name, value in losses.items():
            self.logger.record(f"train/{name}", value)
        self.logger.record("train/learning_rate", float(self.policy.optimizer.param_groups[0]["lr"]))
        if ended:
            self.logger.record("rollout/success", reached / ended)
            self.logger.record("rollout/failed", 1 - truncated / ended)
        for name, mean in zip(engine.term_names, terms, strict=True):
            self.logger.record(f"return/{name}", mean * engine.timing.episode_steps)


class _NoBuffer(RolloutBuffer):
    """Stands where SB3 expects a rollout buffer; holds nothing."""

    def __init__(self, *_: Any, **__: Any) -> None:
        pass
