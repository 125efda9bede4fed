"""PPO whose rollouts, advantages and updates stay on the device, behind SB3's interface."""

from __future__ import annotations

from typing import Any

import numpy as np
import stable_baselines3
import torch
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv
from torch import Tensor

from rans.errors import ConfigError, NonFiniteState
from rans.fast.distributed import Processes
from rans.fast.engine import Engine
from rans.fast.envs.sb3 import SB3VecEnv
from rans.fast.learn.graph import fused, graphed
from rans.fast.learn.loss import Losses, ppo_loss
from rans.fast.learn.rollout import Batch, Rollout, minibatches
from rans.fast.policy import NormalisedMlp, network, set_precision

_STATISTICS = (*Losses._fields, "grad_norm")
"""Means over the minibatches of an update, by their names in the log."""
MIN_LEARNING_RATE = 1e-5
"""Lower bound of the adapted step size, unless training slows down below it."""


class PPO(stable_baselines3.PPO):
    """`stable_baselines3.PPO` with everything between the callbacks replaced.

    Constructor, callbacks, logger, ``predict``, ``save`` and ``load`` are SB3's, and what it saves
    opens with ``stable_baselines3.PPO.load``. The update equals SB3's on the same minibatch. Different
    are: minibatches are whole environments, unshuffled; callbacks see neither ``infos`` nor ``dones``,
    and their ``on_step`` come after each rollout, one a step; defaults suit short episodes of many
    environments. On a GPU, matrix products use TF32 unless told otherwise, for the whole process.

    Args:
        policy: as SB3.
        env: an `SB3VecEnv`.
        learning_rate: as SB3; the step size to start with when ``desired_kl`` adapts it.
        n_steps: as SB3; no longer than an episode.
        batch_size: as SB3, a multiple of ``n_steps``; by default a quarter of the rollout.
        n_epochs: as SB3.
        gamma: as SB3.
        max_grad_norm: as SB3.
        policy_kwargs: as SB3; by default `rans.fast.policy.network`.
        desired_kl: divergence a whole iteration should cause; the step size is adapted to it
            between 1e-5 and ``max_learning_rate``. None: ``learning_rate`` as given.
        max_learning_rate: upper bound of the adapted step size.
        anneal: see `slow_down`, which `rans.fast.learn.trainer.Trainer` calls and ``learn`` does not.
        reward_scale: factor on every reward, so that values are of order one.
        matmul: see `rans.fast.learn.config.Precision`; with ``policy_kwargs`` of your own, bf16 needs
            ``network(bf16=True)``.
        **settings: SB3's others, with its names and meanings.

    Raises:
        ConfigError: the environment is of another kind, or the settings ask for something this trainer
            does not do.
    """

    def __init__(self, policy: Any, env: Any, learning_rate: Any = 1e-3, n_steps: int = 64,
                 batch_size: int | None = None, n_epochs: int = 4, gamma: float = 0.98, *,
                 max_grad_norm: float = 1.0, policy_kwargs: dict[str, Any] | None = None,
                 desired_kl: float | None = 0.016, max_learning_rate: float = 1e-2,
                 anneal: float = 0.0, reward_scale: float = 0.1, matmul: str = "tf32",
                 _init_setup_model: bool = True, **settings: Any) -> None:
        self.desired_kl, self.max_learning_rate, self.anneal = desired_kl, max_learning_rate, anneal
        self.reward_scale, self.matmul = reward_scale, matmul
        if _init_setup_model:  # SB3's `load` sets everything after an empty construction
            rollout = _engine_of(env).num_envs * n_steps
            batch_size = batch_size or (rollout // 4 if env.num_envs % 4 == 0 else rollout)
            _check_sizes(_engine_of(env), n_steps, batch_size)
        super().__init__(policy, env, learning_rate,  # type: ignore[arg-type]
                         n_steps, batch_size or n_steps, n_epochs, gamma,
                         max_grad_norm=max_grad_norm,
                         policy_kwargs=policy_kwargs or network(bf16=matmul == "bf16"),
                         _init_setup_model=False, **settings)
        if _init_setup_model:
            self._setup_model()

    def _setup_model(self) -> None:
        # SB3 would allocate its own rollouts on the host; only `Rollout` is used.
        self.rollout_buffer_class = _NoBuffer  # type: ignore[assignment]
        super()._setup_model()
        self.rollout_buffer_class = None  # type: ignore[assignment]
        self._refuse_unsupported()
        if self.env is not None:
            self._prepare(_engine_of(self.env))

    def set_env(self, env: Any, force_reset: bool = True) -> None:
        """As SB3."""
        super().set_env(env, force_reset)
        self._prepare(_engine_of(env))

    def _refuse_unsupported(self) -> None:
        clip_range, rate = self.clip_range, self.lr_schedule
        unsupported = {
            "clip_range_vf": self.clip_range_vf is not None,
            "use_sde": self.use_sde,
            "target_kl": self.target_kl is not None,
            "a schedule of clip_range": clip_range(0.0) != clip_range(1.0),  # type: ignore[operator]
            "a schedule of learning_rate with desired_kl":
                self.desired_kl is not None and rate(0.0) != rate(1.0),
            "share_features_extractor=False": not self.policy.share_features_extractor,
        }
        for name, given in unsupported.items():
            if given:
                raise ConfigError(f"{name} is not supported by rans.fast.PPO; leave it at its default or use "
                                  "stable_baselines3.PPO.")

    def _prepare(self, engine: Engine) -> None:
        """Fixed memory and fixed functions of one training iteration."""
        _check_sizes(engine, self.n_steps, self.batch_size)
        set_precision(self.matmul, self.device)
        self.policy.to(engine.dtype)
        group = self.policy.optimizer.param_groups[0]
        group["lr"] = torch.tensor(float(group["lr"]), dtype=torch.float32, device=self.device)
        group["capturable"] = self.device.type == "cuda"
        # In memory that never moves: a CUDA graph reads it.
        self._ceiling = torch.tensor(self.max_learning_rate, device=self.device)
        self._rollout = Rollout(engine, self.n_steps)
        self._loss = fused(ppo_loss, self.device)
        self.collect = graphed(self._collect_on_device, self.device)
        self.update = graphed(self._update_on_device, self.device)

    def _maybe_recommend_cpu(self, mlp_class_name: str = "") -> None:
        """SB3 warns that PPO is slow on a GPU; this one is not."""

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "_rollout", "_ceiling", "_loss", "collect", "update",
                "_last_obs", "_last_episode_starts", "rollout_buffer_class"]

    def _setup_learn(self, total_timesteps: int, callback: Any = None, reset_num_timesteps: bool = True,
                     *args: Any, **kwargs: Any) -> Any:
        """As SB3; new episodes begin at random times, so that they do not all end in one rollout."""
        fresh = reset_num_timesteps or self._last_obs is None
        result = super()._setup_learn(total_timesteps, callback, reset_num_timesteps, *args, **kwargs)
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

    def slow_down(self, remaining: float) -> None:
        """Lower the bound of the step size, from ``anneal`` before the end on, towards zero at the end.

        Args:
            remaining: share of the training's steps that is still to come.
        """
        self._ceiling.fill_(self.max_learning_rate * min(1.0, remaining / max(self.anneal, 1e-9)))

    def collect_rollouts(self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer,
                         n_rollout_steps: int) -> bool:
        """Fill the device's rollout; see SB3. The callbacks' ``on_step`` follow the flight."""
        self.policy.set_training_mode(False)
        callback.on_rollout_start()
        self.collect()
        callback.update_locals(locals())
        for _ in range(n_rollout_steps):
            self.num_timesteps += env.num_envs * self._world.size
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
        if self._normalises_over_processes:
            parts = [part._replace(advantage=self._world.standardised(part.advantage)) for part in parts]
        losses = [self._descend(part) for _ in range(self.n_epochs) for part in parts]
        mean = torch.stack([torch.stack(x) for x in losses]).mean(dim=0)
        extractor = self.policy.features_extractor
        if isinstance(extractor, NormalisedMlp):
            extractor.update_statistics(batch.seen.flatten(0, 1), self._world)
        ends = torch.stack((rollout.truncated.sum(), rollout.ended.sum(), rollout.reached))
        statistics = self._world.average(torch.cat((mean, ends, rollout.terms / self.n_steps)))
        self._adapt(statistics[_STATISTICS.index("approx_kl")])
        return statistics

    @property
    def _world(self) -> Processes:
        return self.env.engine.processes  # type: ignore[union-attr]

    @property
    def _normalises_over_processes(self) -> bool:
        return self.normalize_advantage and self._world.size > 1

    def _descend(self, batch: Batch) -> list[Tensor]:
        losses = self._loss(self.policy, batch, self.clip_range(1.0), self.ent_coef, self.vf_coef,  # type: ignore[operator]
                            self.normalize_advantage and not self._normalises_over_processes)
        norm = self._step_down(losses.loss)
        return [x.detach() for x in (*losses, norm)]

    def _step_down(self, loss: Tensor) -> Tensor:
        """One step of the optimiser; the norm of the gradients, which processes exchange as one message."""
        weights = [p for p in self.policy.parameters() if p.requires_grad]
        found = torch.autograd.grad(loss, weights, allow_unused=True)
        used = [(weight, gradient) for weight, gradient in zip(weights, found, strict=True)
                if gradient is not None]
        gradient = self._world.average(torch.cat([g.flatten() for _, g in used]))
        norm = gradient.norm()
        # As torch.nn.utils.clip_grad_norm_.
        gradient = gradient * (self.max_grad_norm / (norm + 1e-6)).clamp(max=1.0)
        for (weight, _), part in zip(used, gradient.split([w.numel() for w, _ in used]), strict=True):
            weight.grad = part.view_as(weight)
        self.policy.optimizer.step()
        return norm

    def _adapt(self, kl: Tensor) -> None:
        """Steps too far for the desired divergence get shorter, too short ones longer."""
        if self.desired_kl is None:
            return
        rate = self.policy.optimizer.param_groups[0]["lr"]
        factor = torch.where(kl > 2.0 * self.desired_kl, 1 / 1.5,
                             torch.where(kl < 0.5 * self.desired_kl, 1.5, 1.0))
        torch.minimum(rate.mul_(factor).clamp_(min=MIN_LEARNING_RATE), self._ceiling, out=rate)

    def _record(self, statistics: list[float]) -> None:
        """Hand the iteration's statistics to SB3's logger.

        Raises:
            NonFiniteState: a loss or a gradient is NaN or infinite.
        """
        engine = self.env.engine  # type: ignore[union-attr]
        losses = dict(zip(_STATISTICS, statistics, strict=False))
        truncated, ended, reached, *terms = statistics[len(_STATISTICS):]
        if not all(abs(x) < float("inf") for x in statistics):
            raise NonFiniteState(
                f"training produced a value that is not finite after {self.num_timesteps} steps "
                f"(losses {losses}); the usual cause is a learning rate or a reward that is too large.")
        for name, value in losses.items():
            self.logger.record(f"train/{name}", value)
        self.logger.record("train/learning_rate", float(self.policy.optimizer.param_groups[0]["lr"]))
        if ended:
            self.logger.record("rollout/success_rate", reached / ended)
            self.logger.record("rollout/failure_rate", 1 - truncated / ended)
        for name, mean in zip(engine.term_names, terms, strict=True):
            self.logger.record(f"return/{name}", mean * engine.timing.episode_steps)


def _engine_of(env: Any) -> Engine:
    if not isinstance(env, SB3VecEnv):
        raise ConfigError(
            f"rans.fast.PPO trains on a rans.fast.SB3VecEnv, got {type(env).__name__}; use "
            "stable_baselines3.PPO for other environments.")
    return env.engine


def _check_sizes(engine: Engine, n_steps: int, batch_size: int) -> None:
    if n_steps > engine.timing.episode_steps:
        raise ConfigError(
            f"n_steps must not exceed the episode's {engine.timing.episode_steps} steps, got {n_steps}: an "
            "episode may be cut off once a rollout at most.")
    samples = engine.num_envs * n_steps
    if batch_size % n_steps or samples % batch_size:
        raise ConfigError(
            f"batch_size must be a multiple of n_steps = {n_steps} that divides n_steps x environments = "
            f"{samples}, got {batch_size}.")


class _NoBuffer(RolloutBuffer):
    """Stands where SB3 expects a rollout buffer; holds nothing."""

    def __init__(self, *_: Any, **__: Any) -> None:
        pass
