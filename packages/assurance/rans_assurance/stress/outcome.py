"""Outcomes of episodes, and the size of an effect up to which contestants solve their tasks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rans.evaluation.measure.statistics import share
from rans.extend import WANTED, Estimate, Flight, worst_errors


@dataclass(frozen=True)
class StressOutcome:
    """Outcomes of N episodes of one contestant under the same conditions, in the order of their numbers."""

    errors: dict[str, np.ndarray]
    """Largest of every error with a tolerance over the last fifth, (N,) SI; infinite if a state is not finite."""
    excess: np.ndarray
    """Largest of these errors in tolerances, (N,)."""
    solved: np.ndarray
    """Whether the task was solved, (N,) (`rans.episode.verdict`)."""

    @classmethod
    def of(cls, flight: Flight) -> StressOutcome:
        """Outcome of flights, by their true states."""
        excess, worst = worst_errors(flight)
        return cls(worst, excess, np.asarray(flight.verdict.solved))

    @classmethod
    def joined(cls, parts: Sequence[StressOutcome]) -> StressOutcome:
        """Join the outcomes of consecutive episodes, (N,) arrays in their order."""
        errors = {
            name: np.concatenate([part.errors[name] for part in parts]) for name in parts[0].errors
        }
        return cls(
            errors,
            np.concatenate([part.excess for part in parts]),
            np.concatenate([part.solved for part in parts]),
        )

    @property
    def share(self) -> Estimate:
        """Share of solved episodes, with Wilson's interval."""
        return share(self.solved)

    def worst(self, count: int) -> list[int]:
        """Numbers of at most ``count`` episodes that were not solved, those with the largest errors first."""
        ranking = np.argsort(-self.excess, kind="stable")
        return [int(k) for k in ranking[:count] if not self.solved[k]]


class Limit(NamedTuple):
    """Largest size of an effect up to which 99 % of the episodes are solved at every size."""

    size: float | None
    """The size; None: they are not solved at the first."""
    is_known: bool
    """Whether every size that decides it was flown; if not, the limit is this size or a larger one."""


def holds_to(sizes: Sequence[float], rates: Sequence[Estimate | None]) -> Limit:
    """Largest size up to which 99 % of the episodes are solved at every size; rates are None where nobody flew."""
    solved = None
    for size, rate in zip(sizes, rates, strict=True):
        if rate is None:
            return Limit(solved, False)
        if rate.value < WANTED:
            break
        solved = size
    return Limit(solved, True)
