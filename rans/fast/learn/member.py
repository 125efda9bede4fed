"""One training among those that learn together, and how it went."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

from torch import Tensor

from rans.errors import NonFiniteState
from rans.fast.engine import Engine
from rans.fast.learn.config import TrainConfig
from rans.fast.learn.ppo import STATISTICS

SOLVED_IN_A_ROW = 2
"""Reports that must find the task solved: one alone may be the luckiest of many."""


@dataclass
class Member:
    """One training, and how it went."""

    config: TrainConfig
    rows: list[dict[str, Any]] = field(default_factory=list)
    """As in ``metrics.jsonl``, up to the report that found it solved."""
    weights: dict[str, Tensor] = field(default_factory=dict)
    """Of the agent when it was solved, or when training ended (`Network.member`)."""
    in_a_row: int = 0
    """Reports until now that found the task solved, without one between that did not."""

    @property
    def solved(self) -> bool:
        """Whether enough reports in a row found the task solved."""
        return self.in_a_row >= SOLVED_IN_A_ROW

    @property
    def diverged(self) -> bool:
        """Whether a weight became NaN or infinite."""
        return not all(tensor.isfinite().all() for tensor in self.weights.values())

    def finds_solved(self, success: float) -> bool:
        """Whether such a share of episodes is all that was asked for."""
        return self.config.solved_share is not None and success >= self.config.solved_share

    def note(self, row: dict[str, Any], found: bool | None) -> None:
        """Keep a report, and whether it found the task solved; None: it does not count."""
        self.rows.append(row)
        if found is not None:
            self.in_a_row = self.in_a_row + 1 if found else 0


def statistics(numbers: Sequence[float], engine: Engine, steps: int,
               goes_on: bool = False) -> dict[str, float]:
    """What an update said about a member, by the names that SB3 gives its log.

    Args:
        numbers: a row of what `Learner.update` returned.
        engine: names the reward's terms.
        steps: environment steps that the member has learned from.
        goes_on: whether numbers that are not finite are no matter.

    Raises:
        NonFiniteState: a loss or a gradient is NaN or infinite.
    """
    losses = dict(zip(STATISTICS, numbers, strict=False))
    rate, truncated, ended, reached, *terms = numbers[len(STATISTICS):]
    if not goes_on and not all(map(isfinite, numbers)):
        raise NonFiniteState(
            f"training produced a value that is not finite after {steps} steps "
            f"(losses {losses}); the usual cause is a learning rate or a reward that is too large.")
    table = {f"train/{name}": value for name, value in losses.items()} | {"train/learning_rate": rate}
    if ended:
        table |= {"rollout/success_rate": reached / ended, "rollout/failure_rate": 1 - truncated / ended}
    means = zip(engine.term_names, terms, strict=True)
    return table | {f"return/{name}": mean * engine.timing.episode_steps for name, mean in means}
