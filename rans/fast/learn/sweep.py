"""Sweeps: trainings with several seeds and hyper-parameters, batched on one device where possible.

A member learns what it would alone (`tests/fast/learn/test_sweep.py`); files let a sweep be resumed.
"""

from __future__ import annotations

import gc
import json
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any, TypeVar

import torch

from rans.errors import ConfigError, WorkerLost, brief
from rans.fast.agent_files.agent import save_agent
from rans.fast.distributed import ALONE, Processes
from rans.fast.engine import Engine
from rans.fast.learn.config import Coefficients, TrainConfig, from_table, to_table
from rans.fast.learn.member import Member, architecture_of, check_sizes
from rans.fast.learn.recipes import craft_of
from rans.fast.learn.run_folder import RunFolder
from rans.fast.learn.trainer import Trainer, check_device
from rans.files import LOCK, Lock, inside, read_json, write_json
from rans.policy.architecture import Architecture
from rans.structure import entries

_BATCHED = {"seed", *(f"ppo.{Coefficients.entry(name)}" for name in Coefficients._fields)}
"""Config entries in which members of a batch may differ, besides numeric settings of the task."""

Item = TypeVar("Item")


class Sweep:
    """Trains many members in batches of compatible configs.

    Configs (one per member) that differ only in seed, in `Coefficients` and in numeric settings of the task
    form one batch. The folder has ``configs.json`` and a run folder per batch, from which the sweep can be
    resumed; nothing is written before `train`.

    Batches are divided into ``parts``, by default one per process. Any number of processes may resume a sweep.

    Raises:
        ConfigError: a config is invalid.
    """

    def __init__(
        self,
        configs: Sequence[TrainConfig],
        path: Path,
        command: str = "rans sweep",
        processes: Processes = ALONE,
        parts: int | None = None,
    ) -> None:
        self.path = path
        self.command = command
        self.processes = processes
        self.members = [Member(config) for config in configs]
        self._parts = parts or processes.size
        # Members of equal structure train together, in as many parts as processes.
        whole = grouped(range(len(configs)), lambda n: _key(configs[n], _is_structure))
        for batch in whole:
            checked_architecture(configs[batch[0]])
        self._batches = [
            part
            for batch in whole
            for first in range(self._parts)
            if (part := batch[first :: self._parts])
        ]
        self.seconds = 0.0
        self.timed_steps = 0
        """Environment steps of all members within ``seconds``, the training time without compilation."""
        # Settings in which members differ.
        tables = [dict(entries(to_table(member.config))) for member in self.members]
        self.varied = [
            name
            for name, value in tables[0].items()
            if name != "seed" and any(table.get(name) != value for table in tables)
        ]
        """Names of the hyper-parameters in which members differ."""

    def train(
        self, report: Callable[[Sequence[Member]], object], stop: Callable[[], bool] = lambda: False
    ) -> None:
        """Train until every member has solved its task or used all its steps, or ``stop``; see `Trainer.train`.

        Afterwards every process has the results of all members.

        Raises:
            WorkerLost: another process is gone.
            ConfigError: the folder belongs to another sweep, is in use, or has a part that is a symbolic link.
        """
        lock = Lock(inside(self.path, LOCK))
        inside(self.path, "best")  # checked before the training, not after it
        if self.processes.is_first:
            lock.take(
                f"{self.path} is being trained by another sweep; wait for its end, or stop it."
            )
        try:
            if self.processes.is_first:
                self._begin()
            self._train_all(report, stop)
        finally:
            lock.release()

    def _begin(self) -> None:
        """Write the configs; ConfigError if the folder has another sweep.

        A resumed sweep reads ``parts``: batches, and with them the folders of their runs, follow from it.
        """
        file = inside(self.path, "configs.json")
        members = [member.config for member in self.members]
        if file.exists() and read_configs(self.path)[0] != members:
            raise ConfigError(
                f"{self.path} holds another sweep already; choose another folder with --output."
            )
        write_json(
            file,
            {
                "command": self.command,
                "parts": self._parts,
                "configs": [to_table(config) for config in members],
            },
        )

    def _train_all(
        self, report: Callable[[Sequence[Member]], object], stop: Callable[[], bool]
    ) -> None:
        """Train batch after batch until all are done or a stop is asked for.

        Where a stop was asked for, batches with a checkpoint are still opened for their results, and no other one
        begins.
        """
        for number, batch in self.processes.mine(list(enumerate(self._batches))):
            run = RunFolder(inside(self.path, "batches", str(number)))
            if not stop() or run.has_checkpoint:
                if number > 0:
                    gc.collect()  # the device's memory of the batch before hangs in reference cycles
                self._train(run, batch, report, stop)
        try:
            self._gather_results()
        except WorkerLost as error:
            advice = f"What was trained is kept; go on with `rans sweep --resume {self.path}`."
            raise WorkerLost(f"{error} {advice}") from error

    def _gather_results(self) -> None:
        """Bring the results of all processes into this one, replacing ``members`` and sums of time and steps.

        Other processes' members are made anew, without their trainers: only rows, weights and counts are sent.
        """
        local = [number for batch in self.processes.mine(self._batches) for number in batch]
        results = {
            number: ((member := self.members[number]).rows, member.weights, member.in_a_row)
            for number in local
        }
        gathered = self.processes.from_all((results, self.seconds, self.timed_steps))
        for trained, _, _ in gathered:
            for number, (rows, weights, in_a_row) in trained.items():
                self.members[number] = Member(self.members[number].config, rows, weights, in_a_row)
        self.seconds = max(seconds for _, seconds, _ in gathered)
        self.timed_steps = sum(steps for _, _, steps in gathered)

    def _train(
        self,
        run: RunFolder,
        batch: Sequence[int],
        report: Callable[[Sequence[Member]], object],
        stop: Callable[[], bool],
    ) -> None:
        """Train a batch of members together in a run folder; replaces these ``members`` and adds up seconds.

        `Trainer.resume` starts from the beginning where there is no checkpoint, so that both ways come here.
        """
        configs = [self.members[number].config for number in batch]
        if "torch._dynamo" in sys.modules:
            torch.compiler.reset()  # what earlier batches compiled counts towards the compiler's limit
        if not run.config_file.exists():
            run.begin(configs[0], self.command)
        trainer = Trainer(configs, run.spacecraft(), run, goes_on=True)
        trainer.resume()
        for number, member in zip(batch, trainer.members, strict=True):
            self.members[number] = member
        trainer.train(report, stop)
        self.seconds += trainer.seconds
        self.timed_steps += trainer.timed_steps

    def save(self, member: Member, path: Path) -> None:
        """Write config, metrics and agent of a member into a new run folder; ConfigError if it exists."""
        run = RunFolder(path)
        run.begin(member.config, self.command)
        for row in member.rows:
            run.append_metrics(row)
        save_agent(
            run.trained_file,
            checked_architecture(member.config),
            member.weights,
            member.config.ppo,
            member.rows[-1]["steps"],
        )

    def best(self) -> Member:
        """Best seed of the config with the best results over all its seeds."""
        return min(min(self.configs(), key=_rank), key=lambda member: _rank([member]))

    def configs(self) -> list[list[Member]]:
        """Members that have started, grouped by config without the seed."""
        begun = [member for member in self.members if member.rows]
        return grouped(begun, lambda member: _key(member.config, lambda name, _: name != "seed"))

    def choice(self, member: Member) -> dict[str, Any]:
        """Values of the varied hyper-parameters of a member."""
        table = dict(entries(to_table(member.config)))
        return {name: table[name] for name in self.varied}

    def results(self) -> list[dict[str, Any]]:
        """One row per started member: number, seed, varied values and last metrics; JSON values."""
        return [
            {
                "member": number,
                "seed": member.config.seed,
                **self.choice(member),
                "solved": member.solved,
                "diverged": member.diverged,
                **member.rows[-1],
            }
            for number, member in enumerate(self.members)
            if member.rows
        ]


def read_configs(path: Path) -> tuple[list[TrainConfig], str, int]:
    """Configs, command and number of parts of the sweep in this folder; ConfigError if there is none."""
    file = inside(path, "configs.json")
    if not file.exists():
        raise ConfigError(f"{path} is not a sweep's folder: it has no configs.json.")
    table = read_json(file)
    if not isinstance(table, dict) or not isinstance(table.get("configs"), list):
        raise ConfigError(f"{file} is damaged: it lists no configs.")
    parts = table.get("parts", 1)
    if not isinstance(parts, int) or parts < 1:
        raise ConfigError(
            f"{file} is damaged: parts must be a whole number >= 1, got {brief(parts)}."
        )
    try:
        configs = [from_table(config) for config in table["configs"]]
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from error
    return configs, str(table.get("command")), parts


def checked_architecture(config: TrainConfig) -> Architecture:
    """Network architecture of a config; ConfigError if the config is invalid."""
    check_device(config.device)
    engine = Engine(craft_of(config), config.settings, config.ppo.n_envs, config.timing)
    check_sizes(engine, config.ppo, 1)
    return architecture_of(engine, config.ppo)


def grouped(items: Iterable[Item], key: Callable[[Item], str]) -> list[list[Item]]:
    """Items with the same key, in the order in which keys first appear."""
    groups: dict[str, list[Item]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return list(groups.values())


def short(name: str) -> str:
    """Name of an entry for a table: its last part."""
    return name.rsplit(".", 1)[-1]


def _key(config: TrainConfig, counts: Callable[[str, Any], bool]) -> str:
    """Key of the selected entries of a config; equal for equal entries."""
    return json.dumps(
        [(name, value) for name, value in entries(to_table(config)) if counts(name, value)]
    )


def _is_structure(name: str, value: Any) -> bool:
    numbers = value if isinstance(value, tuple) else (value,)
    is_number = all(isinstance(x, int | float) and not isinstance(x, bool) for x in numbers)
    return name not in _BATCHED and not (name.startswith("settings.") and is_number)


def _rank(members: Sequence[Member]) -> tuple[float, float, float]:
    """Sort key, smaller is better: unsolved share (diverged counts double), mean steps, negative mean success."""
    last = [member.rows[-1] for member in members]
    unsolved = fmean((not member.solved) + member.diverged for member in members)
    steps = fmean(row["steps"] for row in last) if unsolved == 0 else 0.0
    return unsolved, steps, -fmean(row["success"] for row in last)
