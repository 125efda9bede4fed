"""Training from a config: until solved or out of steps, never further than a checkpoint from safety."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat

from rans.errors import ConfigError, NonFiniteState, WorkerLost
from rans.fast.distributed import ALONE, Processes
from rans.fast.engine import Engine, field_dtype
from rans.fast.envs.sb3 import SB3VecEnv
from rans.fast.learn.config import PPOSettings, TrainConfig
from rans.fast.learn.curriculum import Curriculum
from rans.fast.learn.ppo import PPO
from rans.fast.learn.run_folder import RunFolder
from rans.fast.learn.selection import Selection
from rans.fast.policy import OnOffPolicy, expect_duty, network
from rans.fast.symmetry import symmetries
from rans.files import replace_file
from rans.model.spacecraft import Spacecraft
from rans.tasks.sight import Layout

WARM_UP_ITERATIONS = 3
"""On a GPU: two that compile, one that records the graphs. They train, but are timed apart."""
SOLVED_IN_A_ROW = 2
"""Reports that must find the task solved: one alone may be the luckiest of many."""
_CHECKPOINT_SECONDS = 5.0
_ARCHITECTURE = ("layers", "activation", "zoom", "symmetric")
"""Settings of the network rather than of the trainer."""


class Trainer:
    """One training in one run folder. Sets torch's number of threads, for the whole process.

    Args:
        config: what to train.
        craft: the spacecraft the config names.
        run: where to keep it; nothing is written there before `train`, and only by the first process.
        processes: those that share the training's environments.

    Raises:
        ConfigError: the config cannot work.
    """

    def __init__(self, config: TrainConfig, craft: Spacecraft, run: RunFolder,
                 processes: Processes = ALONE) -> None:
        check_device(config.device)
        torch.set_num_threads(config.threads)
        self.config, self.run, self.processes, self.seconds, self.warm_up = config, run, processes, 0.0, 0.0
        device = torch.device(config.device)
        self.curriculum = Curriculum(config.settings, config.curriculum, field_dtype(device), device)
        self.engine = Engine(craft, self.curriculum.task, processes.share("n_envs", config.ppo.n_envs),
                             config.timing, seed=config.seed, device=device, processes=processes)
        self.model = make_ppo(self.engine, config.ppo, config.seed)
        self.selection = Selection(self.model.policy, craft, config.settings, config.timing, config.device)
        self._solved_in_a_row = 0
        self._begun = self._reported = (0, 0.0)
        # Opened by `train`, so that a start that fails leaves no empty event file.
        self._logger: Logger | None = None

    @property
    def solved(self) -> bool:
        """Whether enough reports in a row found the task solved."""
        return self._solved_in_a_row >= SOLVED_IN_A_ROW

    @property
    def rate(self) -> float:
        """Environment steps per second since the warm-up."""
        return self._rate_since(self._begun)

    def _rate_since(self, then: tuple[int, float]) -> float:
        steps, seconds = then
        return (self.model.num_timesteps - steps) / max(self.seconds - seconds, 1e-9)

    @property
    def _ended(self) -> bool:
        return self.solved or self.model.num_timesteps >= self.config.total_timesteps

    def train(self, report: Callable[[dict[str, Any]], object],
              stop: Callable[[], bool] = lambda: False) -> None:
        """Train until solved, out of steps, or told to stop.

        Args:
            report: called with every row of metrics.
            stop: asked after every iteration.

        Raises:
            NonFiniteState: a value became NaN; the state was dumped into the run folder.
            ConfigError: the disk refused.
            WorkerLost: another process is gone.
        """
        try:
            self._train(report, stop)
        except WorkerLost as error:
            raise WorkerLost(f"{error} Continue from the last checkpoint with --resume {self.run.path}."
                             ) from error

    def _train(self, report: Callable[[dict[str, Any]], object], stop: Callable[[], bool]) -> None:
        self._open_log()
        finished = self._ended
        self._warm_up()
        if self._ended and not finished:  # the warm-up took all steps
            report(self._report())
        stopped, saved = False, time.monotonic()
        while not (stopped or self._ended):
            begun = time.monotonic()
            self._iterate()
            self.seconds += time.monotonic() - begun
            late = time.monotonic() - saved > _CHECKPOINT_SECONDS
            stopped, late = self.processes.any(stop(), late)
            if stopped or self._ended or self._is_report_due():
                report(self._report())
            if late:
                self.save()
                saved = time.monotonic()
        self.save()

    def _warm_up(self) -> None:
        """On a GPU, compile and record everything; training is timed from then on."""
        if self.engine.device.type == "cuda" and not self._ended:
            begun = time.monotonic()
            for _ in range(WARM_UP_ITERATIONS):
                self._iterate()
                self.selection.judge()
            self.warm_up = time.monotonic() - begun
        self._begun = self._reported = (self.model.num_timesteps, self.seconds)

    def _is_report_due(self) -> bool:
        """Counted from the first step, so that a resumed training judges the agents it would have."""
        iteration = self.model.num_timesteps // (self.config.ppo.n_envs * self.config.ppo.n_steps)
        return iteration % self.config.report_interval == 0

    def _iterate(self) -> None:
        """One iteration of PPO."""
        self.curriculum.move_to(self.model.num_timesteps)
        self.model.slow_down(max(0.0, 1 - self.model.num_timesteps / self.config.total_timesteps))
        try:
            self.model.learn(1, log_interval=None,  # type: ignore[arg-type]
                             reset_num_timesteps=self.model.num_timesteps == 0)
        except NonFiniteState as error:
            file, state = self.run.path / "nonfinite.pt", self._checkpoint()
            if self.processes.is_first:
                replace_file(file, lambda draft: torch.save(state, draft))
            raise NonFiniteState(f"{error} State and weights are in {file}.") from error

    def _report(self) -> dict[str, Any]:
        """Judge the agent, write one row of metrics everywhere, and return it."""
        solved, errors = self.selection.judge()
        needed = self.config.solved_share
        if self._is_report_due():
            found, = self.processes.any(needed is not None and solved >= needed)
            self._solved_in_a_row = self._solved_in_a_row + 1 if found else 0
        rate = self._rate_since(self._reported)
        self._reported = (self.model.num_timesteps, self.seconds)
        row = {"steps": self.model.num_timesteps, "seconds": round(self.seconds, 3),
               "steps_per_s": round(rate), "success": solved,
               **{f"error/{name}": value for name, value in errors.items()},
               **{key: value for key, value in self.model.logger.name_to_value.items()
                  if key.startswith(("return/", "train/", "rollout/"))}}
        for key in ("success", *(f"error/{name}" for name in errors)):
            self.model.logger.record(f"evaluation/{key.removeprefix('error/')}", row[key])
        self.model.logger.record("perf/steps_per_s", rate)
        self.model.logger.dump(self.model.num_timesteps)
        if self.processes.is_first:
            self.run.append_metrics(row)
        return row

    def _open_log(self) -> None:
        if self._logger is None:
            events = str(self.run.path / "tensorboard")
            outputs = [TensorBoardOutputFormat(events)] if self.processes.is_first else []
            self._logger = Logger(str(self.run.path), outputs)  # type: ignore[arg-type]
            self.model.set_logger(self._logger)

    def save(self) -> None:
        """Write checkpoint and agent; all processes must come."""
        state = self._checkpoint()
        if self.processes.is_first:
            self.run.save_checkpoint(state)
            replace_file(self.run.policy_file, self.model.save)

    def _checkpoint(self) -> dict[str, Any]:
        cuda = torch.cuda.get_rng_state() if self.config.device.startswith("cuda") else None
        return {
            "policy": self.model.policy.state_dict(),
            "network": self._network(),
            "optimizer": self.model.policy.optimizer.state_dict(),
            "engine": self.engine.save_state(),
            "generator": torch.get_rng_state(),
            "cuda_generator": cuda,
            "steps": self.model.num_timesteps,
            "seconds": self.seconds,
            "solved_in_a_row": self._solved_in_a_row,
        }

    def _network(self) -> str:
        """What decides what the weights mean, and nothing that may change while training goes on."""
        return ", ".join(f"{name} {getattr(self.config.ppo, name)}" for name in _ARCHITECTURE)

    def resume(self) -> None:
        """Continue from the run's checkpoint, bit-identically on a CPU; without one, from the start.

        Raises:
            ConfigError: the checkpoint is damaged, or it is of another network; or there is an agent
                without one, which must not be lost.
        """
        if self.run.checkpoint_file.exists():
            self._restore(self.run.load_checkpoint(self.config.device))
        elif self.run.policy_file.exists():
            raise ConfigError(f"{self.run.path} holds an agent without a checkpoint to go on from, as a "
                              f"sweep leaves it; train it anew with --config {self.run.config_file}.")
        if self.processes.is_first:
            self.run.forget_after(self.model.num_timesteps)

    def _restore(self, saved: dict[str, Any]) -> None:
        try:
            # Weights of the same shapes may mean something else.
            if (network := saved.get("network", "not noted by older versions")) != self._network():
                raise ValueError(f"its network is another one ({network})")
            self.model.restore(saved["policy"], saved["optimizer"], saved["steps"])
            self.engine.load_state(saved["engine"])
            torch.set_rng_state(saved["generator"].cpu())
            if saved["cuda_generator"] is not None:
                torch.cuda.set_rng_state(saved["cuda_generator"].cpu())
            self.seconds, self._solved_in_a_row = saved["seconds"], saved["solved_in_a_row"]
        except (RuntimeError, KeyError, ValueError, TypeError, AttributeError) as error:
            reason = " ".join(str(error).split())
            raise ConfigError(
                f"{self.run.checkpoint_file} does not fit the run's config: {reason}; the usual cause is "
                "a config.json edited after training began.") from error


def make_ppo(engine: Engine, settings: PPOSettings, seed: int) -> PPO:
    """The trainer with these settings on this engine."""
    given = {f.name: getattr(settings, f.name) for f in dataclasses.fields(settings)
             if f.name not in ("n_envs", "batch_size", "initial_duty", *_ARCHITECTURE)}
    model = PPO(
        OnOffPolicy, SB3VecEnv(engine), seed=seed, device=engine.device, **given,
        batch_size=engine.processes.share("batch_size", settings.batch_size),
        policy_kwargs=architecture(engine.craft, settings, engine.layout),
    )
    expect_duty(model.policy, settings.initial_duty)
    return model


def architecture(craft: Spacecraft, settings: PPOSettings, layout: Layout) -> dict[str, Any]:
    """The ``policy_kwargs`` of an `OnOffPolicy` with these settings."""
    return network(settings.layers, settings.activation, settings.zoom,
                   symmetries(craft) if settings.symmetric else None, layout, bf16=settings.matmul == "bf16")


def check_device(device: str) -> None:
    """Whether training is possible on this torch device, here and now.

    Raises:
        ConfigError: it is not.
    """
    if device not in ("cpu", "cuda"):
        raise ConfigError(f"device must be cpu or cuda, got {device!r}; which GPU that is, "
                          "CUDA_VISIBLE_DEVICES decides.")
    if device == "cuda" and not torch.cuda.is_available():
        raise ConfigError("device is cuda, but torch sees no CUDA device here; use --device cpu.")


def run_path(config: TrainConfig, folder: Path = Path("runs")) -> Path:
    """The first unused folder for a training of this config."""
    return unused_path(f"{config.task}-{Path(config.spacecraft).stem}-seed{config.seed}", folder)


def unused_path(stem: str, folder: Path = Path("runs")) -> Path:
    """The folder of this name, or the first with a number behind it that does not exist."""
    stem = stem.replace(":", "-")
    candidates = (folder / (stem if n == 1 else f"{stem}-{n}") for n in range(1, 1_000_000))
    return next(path for path in candidates if not path.exists())
