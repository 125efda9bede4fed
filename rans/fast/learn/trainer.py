"""Training from a config until the task is solved or the steps are used up, with regular checkpoints.

A checkpoint continues bit by bit (`tests/fast/learn/test_trainer.py`), so that whatever a step changes is in
`_checkpoint`.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import torch

from rans.base.errors import (
    ConfigError,
    NonFiniteState,
    RansWarning,
    WorkerLost,
    installing,
)
from rans.base.files import inside_for_others, replace_file
from rans.episode.step import Guard
from rans.fast.agent_files.agent import agent_bytes
from rans.fast.agent_files.tensors import pack_tensors
from rans.fast.distributed import ALONE, Processes
from rans.fast.engine import Engine
from rans.fast.learn.beginning import begin, statistics
from rans.fast.learn.config import TrainConfig
from rans.fast.learn.curriculum import Curriculum
from rans.fast.learn.events import Events
from rans.fast.learn.graph import as_written, calls_until_recorded
from rans.fast.learn.learners import LEARNERS, own_settings
from rans.fast.learn.policy_file import begin_from, teacher
from rans.fast.learn.run_folder import EVENTS, RunFolder
from rans.fast.learn.selection import Selection
from rans.fast.machine_code import machine_code
from rans.fast.stepping.step import field_dtype
from rans.model.spacecraft import Spacecraft
from rans.policy.backbones import any_craft
from rans.policy.network import Network
from rans.randomization.plausible import warn_of_implausible
from rans.tasks.feasible import check_feasible

SOLVED_IN_A_ROW = 2
"""Number of successive reports with a solved task at which training ends; a single one may be chance."""
_COMPILING = 30.0
"""Training time above which compiling saves time, s."""
_CHECKPOINT_SECONDS = 5.0
_ARCHITECTURE = (
    "layers",
    "zoom",
    "symmetric",
    "memory",
    "filters",
    "privileged_critic",
)
"""Settings that define the network, as opposed to its training."""


class Trainer:
    """Trains an agent in a run folder.

    The number of threads of torch is set for the whole process. Nothing is written before `train`, and only by
    the first of the processes that share the environments.

    Args:
        config: config of the training.
        craft: spacecraft.
        run: run folder.
        processes: processes among which the environments are divided.
        guard: safety filter, if the config requests one.

    Raises:
        ConfigError: the config is invalid.
    """

    def __init__(
        self,
        config: TrainConfig,
        craft: Spacecraft,
        run: RunFolder,
        processes: Processes = ALONE,
        guard: Guard | None = None,
    ) -> None:
        check_device(config.device)
        _check_guard(config, guard)
        torch.set_num_threads(config.threads)
        if config.device == "cpu" and machine_code("cpu") is None:
            warnings.warn(
                "training on a processor takes about twice the time without the package llvmlite: "
                f"{installing('fast')}",
                RansWarning,
                stacklevel=2,
            )
        self.config = config
        self.run = run
        self.processes = processes
        self.rows: list[dict[str, Any]] = []
        """Rows of ``metrics.jsonl``."""
        self.seconds = 0.0
        self.warm_up = 0.0
        self.steps = 0
        # This process's share of the environments.
        device = torch.device(config.device)
        count = processes.portion("n_envs", config.ppo.n_envs)
        algorithm = LEARNERS[config.algorithm]
        self.curriculum = Curriculum(
            config.settings, config.curriculum, field_dtype(device, plain=config.plain), device
        )
        # Engine.
        timing = replace(
            config.timing, episode_steps=config.episode_steps or config.timing.episode_steps
        )
        check_feasible(craft, config.settings, timing)
        warn_of_implausible(config.conditions, craft)
        self.engine = Engine(
            craft,
            self.curriculum.task,
            count,
            timing,
            seed=config.seed,
            device=device,
            processes=processes,
            conditions=config.conditions.or_none,
            remember=config.ppo.privileged_critic,
            guard=guard,
            plain=config.plain,
        )
        # Learner, from initial weights or those of another agent, which may also teach it.
        by_torch = config.plain or algorithm.plain_network
        own = own_settings(config.algorithm, config.learner)
        making = algorithm.making(config, craft, own)
        self.learner = begin(self.engine, config.ppo, config.seed, by_torch, making)
        self._teacher = None
        if config.begin_from is not None and not run.has_checkpoint:
            self._teacher = teacher(
                config.begin_from, self.engine, self.learner.network.architecture
            )
            if self._teacher is None:
                begin_from(self.learner.network, config.begin_from)
        self.selection = Selection(
            self.learner.network,
            craft,
            config.settings,
            config.timing,
            device,
            config.conditions.or_none,
            config.plain,
            guard,
        )
        self._statistics: dict[str, float] = {}
        self._rollout = config.ppo.n_envs * config.ppo.n_steps
        self._begun = self._reported = (0, 0.0)
        # Opened by `train`, so that a start that fails leaves no empty event file.
        self._events: Events | None = None

    @property
    def imitates(self) -> str:
        """Agent for any craft with whose imitation the training begins; empty: it begins otherwise."""
        begun = self.config.begin_from or ""
        return begun.removeprefix("pretrained:") if self._teacher is not None else ""

    @property
    def solved(self) -> bool:
        """Whether the training ends because its task is solved, see `is_solved`."""
        return is_solved(self.config, self.rows)

    @property
    def rate(self) -> float:
        """Environment steps per second since the warm-up."""
        return self._rate_since(self._begun)

    def _rate_since(self, then: tuple[int, float]) -> float:
        return (self.steps - then[0]) / max(self.seconds - then[1], 1e-9)

    @property
    def ended(self) -> bool:
        """Whether nothing is left to train: the task is solved, or the steps are used up."""
        return self.solved or self.steps >= self.config.total_timesteps

    def train(
        self,
        report: Callable[[dict[str, Any]], object] = lambda _: None,
        stop: Callable[[], bool] = lambda: False,
    ) -> None:
        """Train until the task is solved, the steps are used up, or ``stop`` returns true.

        Args:
            report: called with every row of metrics.
            stop: called after every iteration, and often in an imitation of an agent for any craft, of which
                nothing is saved if it is stopped: ``steps`` are 0 then.

        Raises:
            NonFiniteState: a value became NaN; the state was written to the run folder.
            ConfigError: a file could not be written.
            WorkerLost: another process is gone.
        """
        try:
            if self.processes.is_first:
                self.run.lock()
            self._train(report, stop)
        except WorkerLost as error:
            advice = f"Continue from the last checkpoint with --resume {self.run.path}."
            raise WorkerLost(f"{error} {advice}") from error
        finally:
            self.run.release()

    def _train(self, report: Callable[[dict[str, Any]], object], stop: Callable[[], bool]) -> None:
        """Imitate a teacher if there is one, train until the end or a stop, and save."""
        if self.processes.is_first and self._events is None:
            self._events = Events(inside_for_others(self.run.path, EVENTS))
        stopped = False
        with as_written():
            if self._teacher is not None and self.steps == 0:
                if not self._imitate(self._teacher, report, stop):
                    return
            else:
                self._begun = (self.steps, self.seconds)
            if not self.config.compiled:
                stopped = self._go_on(report, stop, self._compiling_pays)
        if not (stopped or self.ended):
            self._go_on(report, stop)
        self.save()

    def _imitate(
        self,
        expert: Network,
        report: Callable[[dict[str, Any]], object],
        stop: Callable[[], bool],
    ) -> bool:
        """Learn from an agent for any craft until it solves the task, changing network, Adam and counts.

        Returns whether it came to its end, and was not stopped.
        """
        begun = time.monotonic()
        judged: dict[str, float] = {}

        def is_enough() -> bool:
            judged.update(self.selection.judge())
            return judged["success"] >= (self.config.solved_share or 1.0)

        def log(periods: int, loss: float) -> None:
            steps = periods * self.config.ppo.n_envs
            if self._events is not None:
                self._events.write({"imitation/loss": loss}, steps)

        flown = any_craft().imitate(
            self.engine,
            self.learner.network,
            self.learner.adam,
            expert,
            self.config.ppo,
            is_enough,
            stop,
            log,
        )
        self.seconds += time.monotonic() - begun
        if not flown:
            return False
        self.steps = flown * self.config.ppo.n_envs
        self._report(report, judged)
        return True

    def _go_on(
        self,
        report: Callable[[dict[str, Any]], object],
        stop: Callable[[], bool],
        over: Callable[[], bool] = lambda: False,
    ) -> bool:
        """Train until the end, ``stop`` or ``over``; whether it was ``stop``. Saves now and then."""
        finished = self.ended
        self._warm_up()
        if self.ended and not finished:  # the warm-up took all steps
            self._report(report)
        stopped = False
        ended = self.ended
        saved = time.monotonic()
        while not (stopped or ended):
            begun = time.monotonic()
            self._iterate()
            self.seconds += time.monotonic() - begun
            stopped, late, left = self.processes.any(
                stop(), time.monotonic() - saved > _CHECKPOINT_SECONDS, over()
            )
            if stopped or self.ended or self._is_report_due():
                self._report(report)
            ended = left or self.ended
            if late:
                self.save()
                saved = time.monotonic()
        return stopped

    def _compiling_pays(self) -> bool:
        """Whether compiling saves time on a GPU.

        The time left is estimated from the remaining steps, or, if training ends once solved, as the time taken
        so far.
        """
        fixed = self.engine.plain or self.config.compiled is not None or self.learner.description
        if self.engine.device.type != "cuda" or fixed:
            return False
        took = self.seconds - self._begun[1]
        left = (self.config.total_timesteps - self.steps) / self.rate
        return (left if self.config.solved_share is None else took) > _COMPILING

    def _warm_up(self) -> None:
        """On a GPU, compile (or load) and record all graphs in training iterations that are timed separately.

        Its time counts as ``warm_up``.
        """
        begun = time.monotonic()
        steps = self.steps
        if self.engine.device.type == "cuda" and not self.ended:
            for _ in range(calls_until_recorded() + 1):
                self._iterate()
                self.selection.judge()
            self.warm_up += time.monotonic() - begun
        self._begun = self._begun[0] + self.steps - steps, self._begun[1]
        self._reported = (self.steps, self.seconds)

    def _is_report_due(self) -> bool:
        """Whether this iteration is reported; counted from the first step, so that resuming changes nothing."""
        return self.steps // self._rollout % self.config.report_interval == 0

    def _iterate(self) -> None:
        """Run one iteration of the learner, advancing curriculum, ``steps`` and statistics; a NaN is raised.

        Settings and step size are set before the rollout that they hold for; both depend on `steps` alone, so that
        a resumed training has the same.
        """
        self.curriculum.move_to(self.steps)
        self.learner.slow_down(max(0.0, 1 - self.steps / self.config.total_timesteps))
        numbers = self.learner.learn().tolist()
        self.steps += self._rollout
        try:
            self._statistics = statistics(numbers, self.learner, self.steps)
        except NonFiniteState as error:
            file = self.run.nonfinite_file
            state = pack_tensors(self._checkpoint())
            if self.processes.is_first:
                replace_file(file, lambda draft: draft.write_bytes(state))
            raise NonFiniteState(f"{error} State and weights are in {file}.") from error

    def _report(
        self,
        report: Callable[[dict[str, Any]], object],
        judged: Mapping[str, float] | None = None,
    ) -> None:
        """Evaluate the agent, if it is not ``judged``, and write a row of metrics, whose keys pages read."""
        # All processes must take the same decisions, which follow from the rows.
        found: dict[str, float] = self.processes.from_first(judged or self.selection.judge())
        rate = self._rate_since(self._reported)
        self._reported = (self.steps, self.seconds)
        row = {
            "steps": self.steps,
            "seconds": round(self.seconds, 3),
            "steps_per_s": round(rate),
            **found,
            **self._statistics,
        }
        self.rows.append(row)
        if self.processes.is_first:
            self.run.append_metrics(row)
            if self._events is not None:
                # With the names of SB3.
                named = {f"evaluation/{key.removeprefix('error/')}": found[key] for key in found}
                named |= self._statistics | {"perf/steps_per_s": row["steps_per_s"]}
                self._events.write(named, self.steps)
        report(row)

    def save(self) -> None:
        """Write the checkpoint and the agent; every process must call this."""
        state = self._checkpoint()
        if self.processes.is_first:
            self.run.save_checkpoint(state)
            network = self.learner.network
            content = agent_bytes(network.architecture, network.weights(), self.steps)
            replace_file(self.run.agent_file, lambda draft: draft.write_bytes(content))

    def _checkpoint(self) -> dict[str, Any]:
        """What a training needs to go on as if it had not stopped; `_restore` reads the same keys."""
        cuda = torch.cuda.get_rng_state() if self.config.device.startswith("cuda") else None
        return {
            "network": self._network(),
            "learner": self.learner.state(),
            "cuda_generator": cuda,
            "engine": self.engine.save_state(),
            "steps": self.steps,
            "seconds": self.seconds,
        }

    def _network(self) -> str:
        """Settings that define the meaning of the weights, as text for the checkpoint."""
        return ", ".join(f"{name} {getattr(self.config.ppo, name)}" for name in _ARCHITECTURE)

    def resume(self) -> None:
        """Resume from the checkpoint of the run, bit-identically on a CPU; without one, start anew.

        Raises:
            ConfigError: the checkpoint is damaged or belongs to another network, the folder has an agent
                without checkpoint, which would be overwritten, or another process trains in it.
        """
        if self.processes.is_first:
            self.run.lock()
        if self.run.has_checkpoint:
            self._restore(self.run.load_checkpoint(self.config.device))
        elif self.run.agent_file.exists():
            raise ConfigError(
                f"{self.run.path} holds an agent without a checkpoint to go on from, as an export or an "
                "early version of RANS leaves it; train it anew from "
                f"{self.run.config_file}."
            )
        if self.processes.is_first:
            self.run.forget_after(self.steps)
        self.rows += [row for row in self.run.metrics() if row["steps"] <= self.steps]

    def _restore(self, saved: dict[str, Any]) -> None:
        """Put weights, optimiser, engine and counts back as a checkpoint has them.

        Tensors are copied in place, since recorded CUDA graphs hold their addresses.
        """
        try:
            # Weights of equal shapes may belong to a different network.
            if (network := saved["network"]) != self._network():
                raise ValueError(f"its network is another one ({network})")
            self.engine.load_state(saved["engine"])
            self.learner.load(saved["learner"])
            if saved["cuda_generator"] is not None:
                torch.cuda.set_rng_state(saved["cuda_generator"].cpu())
            self.steps = saved["steps"]
            self.seconds = saved["seconds"]
        except (RuntimeError, KeyError, ValueError, TypeError, AttributeError) as error:
            reason = " ".join(str(error).split())
            raise ConfigError(
                f"{self.run.checkpoint_file} does not fit the run's config: {reason}; the "
                "usual cause is a config.json edited after training began."
            ) from error


def is_solved(config: TrainConfig, rows: Sequence[Mapping[str, Any]]) -> bool:
    """Whether a training has solved its task by its rows of metrics, which ends it.

    The last `SOLVED_IN_A_ROW` reports at the interval of the config must say so. An imitation, whose row has no
    learning rate, is judged once.
    """
    share = config.solved_share
    if share is None or not rows:
        return False
    if "train/learning_rate" not in rows[-1]:
        return rows[-1]["success"] >= share
    rollout = config.ppo.n_envs * config.ppo.n_steps
    due = [row for row in rows if row["steps"] // rollout % config.report_interval == 0]
    last = due[-SOLVED_IN_A_ROW:]
    return len(last) == SOLVED_IN_A_ROW and all(row["success"] >= share for row in last)


def _check_guard(config: TrainConfig, guard: Guard | None) -> None:
    """Raise ConfigError if the safety filter is missing or not supported on the device."""
    if not config.guard:
        return
    if guard is None:
        raise ConfigError("guard needs a safety filter: use `rans train` or rans.train.")
    if config.device == "cuda" and not config.plain:
        raise ConfigError(
            "guard is true and the device is cuda: CUDA kernels have no safety filter. Train on cpu, or set plain."
        )


def check_device(device: str) -> None:
    """Raise ConfigError if training is not possible on this torch device."""
    if device not in ("cpu", "cuda"):
        raise ConfigError(
            f"device must be cpu or cuda, got {device!r}; CUDA_VISIBLE_DEVICES selects the GPU."
        )
    if device == "cuda" and not torch.cuda.is_available():
        raise ConfigError("device is cuda, but torch sees no CUDA device here; use --device cpu.")
