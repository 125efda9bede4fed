"""Sweeps: trainings with several seeds and hyper-parameters, as jobs of an executor.

A member is a training like any other (`rans.fast.learn.trainer`), with a run folder of its own.
"""

from __future__ import annotations

import gc
import json
import shutil
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import fmean
from typing import Any, TypeVar

import torch

from rans.errors import ConfigError, NonFiniteState
from rans.executors import chosen_executor
from rans.fast.distributed import ALONE, Processes
from rans.fast.engine import Engine
from rans.fast.learn.beginning import architecture_of, check_sizes
from rans.fast.learn.config import TrainConfig, craft_of, from_table, to_table
from rans.fast.learn.run_folder import RunFolder
from rans.fast.learn.trainer import Trainer, check_device, is_solved
from rans.files import LOCK, inside, read_json, write_json
from rans.model.spacecraft import Spacecraft
from rans.processes import Workers, nothing
from rans.registry import typed
from rans.structure import entries

Item = TypeVar("Item")


@dataclass
class Member:
    """Results of one training of a sweep."""

    config: TrainConfig
    rows: list[dict[str, Any]] = field(default_factory=list)
    """Rows of ``metrics.jsonl``; none: it has not begun."""
    diverged: bool = False
    """Whether a number became NaN or infinite, which ended the training."""
    has_agent: bool = False
    """Whether its run folder has an agent."""

    @property
    def begun(self) -> bool:
        """Whether there is anything to tell of it."""
        return bool(self.rows) or self.diverged

    @property
    def last(self) -> dict[str, Any]:
        """Its last row; of one that diverged before its first, one without steps and success."""
        return self.rows[-1] if self.rows else {"steps": 0, "success": 0.0}

    @property
    def solved(self) -> bool:
        """Whether it has solved its task."""
        return not self.diverged and is_solved(self.config, self.rows)


class Sweep:
    """Trainings of several configs, in processes of this machine or on the executor of `rans.run_on`.

    Its folder has ``configs.json`` and the run folder of every member, from which the sweep resumes; nothing is
    written before `train`. Workers on other machines must see the folder under the same path. A CPU trains as many
    members at once as it has processors, a GPU one after the other.

    Args:
        configs: config of each member.
        path: folder of the sweep.
        command: recorded in its files.
        processes: processes of torchrun, of which each trains its part of the members.

    Raises:
        ConfigError: a config is invalid.
    """

    def __init__(
        self,
        configs: Sequence[TrainConfig],
        path: Path,
        command: str = "rans sweep",
        processes: Processes = ALONE,
    ) -> None:
        self.path = path
        self.command = command
        self.processes = processes
        self.members = [Member(config) for config in configs]
        for same in grouped(configs, _key):
            _check(same[0])
        self.seconds = 0.0
        """Time of `train`."""
        self.timed_steps = 0
        """Environment steps of all members in that time."""
        # Settings in which members differ.
        tables = [dict(entries(to_table(config))) for config in configs]
        self.varied = [
            name
            for name, value in tables[0].items()
            if name != "seed" and any(table.get(name) != value for table in tables)
        ]
        """Names of the hyper-parameters in which members differ."""

    def train(self, report: Callable[[Member], object] = lambda _: None) -> None:
        """Train until every member has solved its task, used all its steps, or diverged.

        Afterwards ``members`` has the results, also after an interrupt, of those that have any.

        Args:
            report: called with every member that has ended.

        Raises:
            ConfigError: the folder belongs to another sweep, a member is in training, or a file is a symbolic link.
            RansError: a worker died.
        """
        inside(self.path, "best")  # checked before the training, not after it
        if self.processes.is_first:
            self._begin()
        self.processes.from_all(None)  # nobody trains before the folder is there
        self._read()
        before = self.steps
        numbers = self.processes.mine([*range(len(self.members))])
        jobs = [self._job(number) for number in numbers]
        # A GPU, and each process of torchrun, trains one after the other.
        lone = self.processes.size > 1 or self.members[0].config.device == "cuda"
        workers = Workers(
            nothing,
            count=1 if lone and chosen_executor() is None else None,
            work="trained a member",
        )
        begun = time.monotonic()
        try:
            for ended, _ in workers.finished(_train, jobs):
                self._read()
                report(self.members[numbers[ended]])
            self.processes.from_all(None)  # everybody has ended
        finally:
            self._read()
            self.seconds = time.monotonic() - begun
            self.timed_steps = self.steps - before

    @property
    def steps(self) -> int:
        """Environment steps of all members."""
        return sum(member.last["steps"] for member in self.members)

    def run(self, number: int) -> RunFolder:
        """Run folder of the member of a number."""
        return RunFolder(inside(self.path, "members", str(number)))

    def _begin(self) -> None:
        """Write the configs; ConfigError if the folder has another sweep."""
        if inside(self.path, "batches").exists():
            raise ConfigError(
                f"{self.path} has a sweep of an earlier version, whose batches cannot go on here: choose another "
                "folder with --output. Its best/ is an agent as any other."
            )
        file = inside(self.path, "configs.json")
        configs = [member.config for member in self.members]
        if file.exists() and read_configs(self.path)[0] != configs:
            raise ConfigError(
                f"{self.path} holds another sweep already; choose another folder with --output."
            )
        write_json(file, {"command": self.command, "configs": [*map(to_table, configs)]})

    def _job(self, number: int) -> tuple[TrainConfig, Spacecraft, str, str]:
        """Arguments of `_train`; the spacecraft is read here, where the user has said whose code may run."""
        config = self.members[number].config
        run = self.run(number)
        craft = run.spacecraft() if run.config_file.exists() else craft_of(config)
        return config, craft, str(run.path.absolute()), self.command

    def _read(self) -> None:
        """Read the members' results from their run folders."""
        for number, member in enumerate(self.members):
            run = self.run(number)
            member.rows = run.metrics()
            member.diverged = run.nonfinite_file.exists()
            member.has_agent = run.trained_file.exists()

    def save_best(self) -> Path:
        """Copy the run folder of the best member to ``best``, in place of what is there; returns that folder."""
        path = inside(self.path, "best")
        shutil.rmtree(path, ignore_errors=True)
        run = self.run(self.members.index(self.best()))
        shutil.copytree(run.path, path, symlinks=True, ignore=shutil.ignore_patterns(LOCK))
        return path

    def best(self) -> Member:
        """Best seed that has an agent of the config with the best results over all its seeds."""
        rows = [
            [one for one in members if one.has_agent]
            for members in sorted(self.configs(), key=_rank)
        ]
        return min(next(filter(None, rows)), key=lambda member: _rank([member]))

    @property
    def has_agent(self) -> bool:
        """Whether any member has an agent, without which there is no best one."""
        return any(member.has_agent for member in self.members)

    def configs(self) -> list[list[Member]]:
        """Members that have begun, grouped by config without the seed."""
        begun = [member for member in self.members if member.begun]
        return grouped(begun, lambda member: _key(member.config))

    def choice(self, member: Member) -> dict[str, Any]:
        """Values of the varied hyper-parameters of a member."""
        table = dict(entries(to_table(member.config)))
        return {name: table[name] for name in self.varied}

    def results(self) -> list[dict[str, Any]]:
        """One row per member that has begun: number, seed, varied values and last metrics; JSON values."""
        return [
            {
                "member": number,
                "seed": member.config.seed,
                **self.choice(member),
                "solved": member.solved,
                "diverged": member.diverged,
                **member.last,
            }
            for number, member in enumerate(self.members)
            if member.begun
        ]


def _train(_: None, config: TrainConfig, craft: Spacecraft, path: str, command: str) -> None:
    """Train a member in its run folder, from its checkpoint if it has one; one that diverges has ended."""
    for name in (config.task, config.spacecraft, config.algorithm):
        typed(name)  # the process that sent this job has asked whose code may run
    run = RunFolder(Path(path))
    if run.nonfinite_file.exists():
        return
    if "torch._dynamo" in sys.modules:
        torch.compiler.reset()  # what earlier members compiled counts towards the compiler's limit
    gc.collect()  # an earlier member's memory on a GPU hangs in cycles of references
    if not run.config_file.exists():
        run.begin(config, command)
    trainer = Trainer(config, craft, run)
    trainer.resume()
    with suppress(NonFiniteState):
        trainer.train()


def read_configs(path: Path) -> tuple[list[TrainConfig], str]:
    """Configs and command of the sweep in this folder; ConfigError if there is none."""
    file = inside(path, "configs.json")
    if not file.exists():
        raise ConfigError(f"{path} is not a sweep's folder: it has no configs.json.")
    table = read_json(file)
    if not isinstance(table, dict) or not isinstance(table.get("configs"), list):
        raise ConfigError(f"{file} is damaged: it lists no configs.")
    try:
        configs = [from_table(config) for config in table["configs"]]
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from error
    return configs, str(table.get("command"))


def _check(config: TrainConfig) -> None:
    """Raise ConfigError if a config is invalid."""
    if config.guard:
        raise ConfigError("the members of a sweep have no safety filter: leave guard out.")
    if chosen_executor() is None:  # else each worker checks its own
        check_device(config.device)
    engine = Engine(craft_of(config), config.settings, config.ppo.n_envs, config.timing)
    check_sizes(engine, config.ppo)
    architecture_of(engine, config.ppo)


def grouped(items: Iterable[Item], key: Callable[[Item], str]) -> list[list[Item]]:
    """Items with the same key, in the order in which keys first appear."""
    groups: dict[str, list[Item]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return list(groups.values())


def short(name: str) -> str:
    """Name of an entry for a table: its last part."""
    return name.rsplit(".", 1)[-1]


def _key(config: TrainConfig) -> str:
    """Key of a config without its seed; equal for equal ones."""
    return json.dumps(to_table(replace(config, seed=0)))


def _rank(members: Sequence[Member]) -> tuple[float, float, float]:
    """Sort key, smaller is better: unsolved share (diverged counts double), mean steps, negative mean success."""
    last = [member.last for member in members]
    unsolved = fmean((not member.solved) + member.diverged for member in members)
    steps = fmean(row["steps"] for row in last) if unsolved == 0 else 0.0
    return unsolved, steps, -fmean(row["success"] for row in last)
