"""Many trainings: seeds and hyper-parameters side by side on one device, as far as they fit together."""

from __future__ import annotations

import gc
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from statistics import fmean
from typing import Any, TypeVar

from rans.fast.learn.batched import Coefficients
from rans.fast.learn.batched_trainer import BatchedTrainer, Member, begin
from rans.fast.learn.config import TrainConfig, to_table

_BATCHED = {"seed", *(f"ppo.{name}" for name in Coefficients._fields)}
"""Entries of a config in which members of a batch may differ, besides numbers among the task's settings."""

Item = TypeVar("Item")


class Sweep:
    """Trains members together as far as their configs allow, batch after batch.

    Args:
        configs: one a member. Those that differ only in seed, in `Coefficients` and in numbers among
            the task's settings form one batch.

    Raises:
        ConfigError: a config cannot work.
    """

    def __init__(self, configs: Sequence[TrainConfig]) -> None:
        self.members = [Member(config) for config in configs]
        self._batches = grouped(self.members, lambda member: _key(member.config, _is_structure))
        for batch in self._batches:
            begin(batch[0].config)
        self.seconds = 0.0
        """Of training, without compiling."""
        self.timed_steps = 0
        """Environment steps of all members in that time."""
        tables = [dict(entries(to_table(member.config))) for member in self.members]
        self.varied = [name for name, value in tables[0].items()
                       if name != "seed" and any(table.get(name) != value for table in tables)]
        """Names of the hyper-parameters in which members differ."""

    def train(self, report: Callable[[Sequence[Member]], object],
              stop: Callable[[], bool] = lambda: False) -> None:
        """Train until every member is solved or out of steps, or told to stop.

        Args:
            report: called with a batch's members after each of their reports.
            stop: asked after every iteration.
        """
        for number, batch in enumerate(self._batches):
            if not stop():
                if number > 0:
                    gc.collect()  # the device's memory of the batch before hangs in reference cycles
                self._train(batch, report, stop)

    def _train(self, batch: Sequence[Member], report: Callable[[Sequence[Member]], object],
               stop: Callable[[], bool]) -> None:
        trainer = BatchedTrainer(batch)
        trainer.train(report, stop)
        self.seconds += trainer.seconds
        self.timed_steps += trainer.timed_steps

    def best(self) -> Member:
        """The best seed of the config that does best over its seeds: one lucky seed is no good config."""
        return min(min(self.configs(), key=_rank), key=lambda member: _rank([member]))

    def configs(self) -> list[list[Member]]:
        """The members that have begun, those that differ only in their seed together."""
        begun = [member for member in self.members if member.rows]
        return grouped(begun, lambda member: _key(member.config, lambda name, _: name != "seed"))

    def choice(self, member: Member) -> dict[str, Any]:
        """The member's values of what varies."""
        table = dict(entries(to_table(member.config)))
        return {name: table[name] for name in self.varied}

    def results(self) -> list[dict[str, Any]]:
        """One row a member that has begun: what it is and how it ended; JSON values."""
        return [self._result(number, member) for number, member in enumerate(self.members) if member.rows]

    def _result(self, number: int, member: Member) -> dict[str, Any]:
        return {"member": number, "seed": member.config.seed, **self.choice(member),
                "solved": member.solved, "diverged": member.diverged, **member.rows[-1]}


def grouped(items: Iterable[Item], key: Callable[[Item], str]) -> list[list[Item]]:
    """Items with the same key, in the order in which keys first appear."""
    groups: dict[str, list[Item]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return list(groups.values())


def entries(table: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Every entry of a nested table, with its name from the top: ppo.gamma."""
    for name, value in table.items():
        if isinstance(value, dict):
            yield from entries(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def short(name: str) -> str:
    """An entry's name for a table: without where it is."""
    return name.rsplit(".", 1)[-1]


def _key(config: TrainConfig, counts: Callable[[str, Any], bool]) -> str:
    """Equal for configs whose entries that count are equal."""
    return json.dumps([(name, value) for name, value in entries(to_table(config)) if counts(name, value)])


def _is_structure(name: str, value: Any) -> bool:
    numbers = value if isinstance(value, tuple) else (value,)
    is_number = all(isinstance(x, int | float) and not isinstance(x, bool) for x in numbers)
    return name not in _BATCHED and not (name.startswith("settings.") and is_number)


def _rank(members: Sequence[Member]) -> tuple[float, float, float]:
    """Smaller is better: share not solved, diverged counts double; mean steps until solved; mean failure."""
    last = [member.rows[-1] for member in members]
    unsolved = fmean((not member.solved) + member.diverged for member in members)
    steps = fmean(row["steps"] for row in last) if unsolved == 0 else 0.0
    return unsolved, steps, -fmean(row["success"] for row in last)
