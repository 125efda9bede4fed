"""What an update said about the members, by name."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

from rans.errors import NonFiniteState
from rans.fast.engine import Engine
from rans.fast.learn.ppo import STATISTICS


def rows(said: Sequence[Sequence[float]], engine: Engine, steps: int,
         goes_on: bool = False) -> list[dict[str, float]]:
    """One table a member, by the names that SB3 gives its log.

    Args:
        said: what `Learner.update` returned, as numbers.
        engine: names the reward's terms.
        steps: environment steps that a member has learned from.
        goes_on: whether numbers that are not finite are no matter.

    Raises:
        NonFiniteState: a loss or a gradient is NaN or infinite.
    """
    return [_row(numbers, engine, steps, goes_on) for numbers in said]


def _row(numbers: Sequence[float], engine: Engine, steps: int, goes_on: bool) -> dict[str, float]:
    losses = dict(zip(STATISTICS, numbers, strict=False))
    rate, truncated, ended, reached, *terms = numbers[len(STATISTICS):]
    if not goes_on and not all(map(isfinite, numbers)):
        raise NonFiniteState(
            f"training produced a value that is not finite after {steps} steps "
            f"(losses {losses}); the usual cause is a learning rate or a reward that is too large.")
    row = {f"train/{name}": value for name, value in losses.items()} | {"train/learning_rate": rate}
    if ended:
        row |= {"rollout/success_rate": reached / ended, "rollout/failure_rate": 1 - truncated / ended}
    means = zip(engine.term_names, terms, strict=True)
    return row | {f"return/{name}": mean * engine.timing.episode_steps for name, mean in means}
