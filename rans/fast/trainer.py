"""Training from a config: until solved or out of steps, never further than a checkpoint from safety."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat

from rans.errors import ConfigError, NonFiniteState
from rans.fast.config import PPOSettings, TrainConfig
from rans.fast.engine import Engine
from rans.fast.policy import NormalisedMlp
from rans.fast.ppo import PPO
from rans.fast.run_folder import RunFolder
from rans.fast.sb3 import SB3VecEnv
from rans.fast.selection import Selection
from rans.files import replace_file

Report = Callable[[dict[str, Any]], object]
"""Called with one row of metrics after each report; a true result ends the training."""

_WARM_UP_ITERATIONS = 3
"""On a GPU: two that compile, one that records the graphs. They train, but are timed apart."""
_SOLVED_IN_A_ROW = 2
"""Reports that must find the task solved: one alone may be the luckiest of many."""
_CHECKPOINT_SECONDS = 5.0


class Trainer:
    """One training in one run folder.

    Args:
        config: what to train.
        run: where to keep it; `RunFolder.begin` was called.

    Raises:
        ConfigError: the config cannot work.
    """

    def __init__(self, config: TrainConfig, run: RunFolder) -> None:
        _check_device(config.device)
        self.config, self.run, self.seconds, self.warm_up, self.solved = config, run, 0.0, 0.0, False
        craft, ppo = run.spacecraft(), config.ppo
        self.engine = Engine(craft, config.settings, ppo.n_envs, config.timing, seed=config.seed,
                             device=config.device)
        self.model = make_ppo(self.engine, ppo, config.seed)
        self.selection = Selection(self.model.policy, craft, config.settings, config.timing, config.device)
        # Opened with the first row, so that a start that fails leaves no empty event file.
        self._logger: Logger | None = None

    def train(self, report: Report) -> None:
        """Train until solved, out of steps, or told to stop by ``report``.

        Raises:
            NonFiniteState: a value became NaN; the state was dumped into the run folder.
        """
        self._open_log()
        self._warm_up()
        in_a_row, stop, saved = 0, False, time.monotonic()
        while not stop and not self.solved and self.model.num_timesteps < self.config.total_timesteps:
            begun = time.monotonic()
            steps = self._learn(self.config.report_interval)
            spent = time.monotonic() - begun
            self.seconds += spent
            row = self._report(steps / spent)
            in_a_row = in_a_row + 1 if self._is_solved(row) else 0
            self.solved = in_a_row == _SOLVED_IN_A_ROW
            stop = bool(report(row))
            if time.monotonic() - saved > _CHECKPOINT_SECONDS:
                self.save()
                saved = time.monotonic()
        self.save()

    def _warm_up(self) -> None:
        """On a GPU, compile and record everything; training is timed from then on."""
        if self.engine.device.type == "cuda":
            begun = time.monotonic()
            self._learn(_WARM_UP_ITERATIONS)
            for _ in range(_WARM_UP_ITERATIONS):
                self.selection.judge()
            self.warm_up = time.monotonic() - begun

    def _is_solved(self, row: dict[str, Any]) -> bool:
        needed = self.config.solved_share
        return needed is not None and row["success"] >= needed

    def _learn(self, iterations: int) -> int:
        """Some iterations of PPO; the number of environment steps they took."""
        before = self.model.num_timesteps
        left = self.config.total_timesteps - before
        rollout = self.config.ppo.n_envs * self.config.ppo.n_steps
        try:
            self.model.learn(min(iterations * rollout, left), log_interval=None,  # type: ignore[arg-type]
                             reset_num_timesteps=before == 0)
        except NonFiniteState as error:
            file = self.run.path / "nonfinite.pt"
            replace_file(file, lambda draft: torch.save(self._checkpoint(), draft))
            raise NonFiniteState(f"{error} State and weights are in {file}.") from error
        return self.model.num_timesteps - before

    def _report(self, rate: float) -> dict[str, Any]:
        """Judge the agent, write one row of metrics everywhere, and return it."""
        solved, errors = self.selection.judge()
        row = {"steps": self.model.num_timesteps, "seconds": round(self.seconds, 3),
               "steps_per_s": round(rate), "success": solved,
               **{f"error/{name}": value for name, value in errors.items()},
               **{k: v for k, v in self.model.logger.name_to_value.items() if k.startswith(("return/", "train/", "rollout/"))}}
        for key in ("success", *(f"error/{name}" for name in errors)):
            self.model.logger.record(f"evaluation/{key.removeprefix('error/')}", row[key])
        self.model.logger.record("perf/steps_per_s", rate)
        self.model.logger.dump(self.model.num_timesteps)
        self.run.append_metrics(row)
        return row

    def _open_log(self) -> None:
        if self._logger is None:
            self._logger = Logger(str(self.run.path), [TensorBoardOutputFormat(str(self.run.path / "tensorboard"))])
            self.model.set_logger(self._logger)

    def save(self) -> None:
        """Write checkpoint and agent."""
        self.run.save_checkpoint(self._checkpoint())
        replace_file(self.run.policy_file, self.model.save)

    def _checkpoint(self) -> dict[str, Any]:
        cuda = torch.cuda.get_rng_state() if self.config.device.startswith("cuda") else None
        return {
            "policy": self.model.policy.state_dict(),
            "optimizer": self.model.policy.optimizer.state_dict(),
            "engine": self.engine.save_state(),
            "generator": torch.get_rng_state(),
            "cuda_generator": cuda,
            "steps": self.model.num_timesteps,
            "seconds": self.seconds,
        }

    def resume(self) -> None:
        """Continue from the run's checkpoint, bit-identically on a CPU.

        Raises:
            ConfigError: there is no checkpoint, it is damaged, or it is of another network.
        """
        saved = self.run.load_checkpoint(self.config.device)
        try:
            self.model.restore(saved["policy"], saved["optimizer"], saved["steps"])
            self.engine.load_state(saved["engine"])
        except (RuntimeError, KeyError, ValueError) as error:
            raise ConfigError(
                f"{self.run.checkpoint_file} does not fit the run's config: {error}; the usual cause is "
                "a config.json edited after training began.") from error
        torch.set_rng_state(saved["generator"].cpu())
        if saved["cuda_generator"] is not None:
            torch.cuda.set_rng_state(saved["cuda_generator"].cpu())
        self.seconds = saved["seconds"]
        self.run.forget_after(saved["steps"])


def make_ppo(engine: Engine, settings: PPOSettings, seed: int) -> PPO:
    """The trainer with these settings on this engine."""
    given = {f.name: getattr(settings, f.name) for f in dataclasses.fields(settings)}
    layers, activation = given.pop("layers"), given.pop("activation")
    del given["n_envs"]
    return PPO(
        "MlpPolicy", SB3VecEnv(engine), seed=seed, device=engine.device, **given,
        policy_kwargs={
            "features_extractor_class": NormalisedMlp,
            "features_extractor_kwargs": {"layers": layers, "activation": activation},
            "net_arch": [],
            "optimizer_kwargs": {"fused": True, "eps": 1e-5},
        },
    )


def _check_device(device: str) -> None:
    try:
        kind = torch.device(device).type
    except RuntimeError as error:
        raise ConfigError(f"device must be cpu or cuda, got {device!r}.") from error
    if kind == "cuda" and not torch.cuda.is_available():
        raise ConfigError("device is cuda, but torch sees no CUDA device here; use --device cpu.")
    if kind not in ("cpu", "cuda"):
        raise ConfigError(f"device must be cpu or cuda, got {device!r}.")


def run_path(config: TrainConfig, folder: Path = Path("runs")) -> Path:
    """The first unused folder for a training of this config."""
    craft = Path(config.spacecraft).stem
    stem = f"{config.task}-{craft}-seed{config.seed}"
    candidates = (folder / (stem if n == 1 else f"{stem}-{n}") for n in range(1, 1_000_000))
    return next(path for path in candidates if not path.exists())
