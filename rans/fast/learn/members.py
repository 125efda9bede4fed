"""Many trainings' environments in one batch: every member keeps its own seed and episodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from rans.fast.engine import Engine
from rans.model.random import seed_words
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.tasks import Task


def members_engine(craft: Spacecraft, task: Task, num_envs: int, timing: Timing, seeds: Sequence[int],
                   **settings: Any) -> Engine:
    """Environments of K members in equal, contiguous parts, each with its own seed; see `Engine`."""
    if len(seeds) == 1:
        return Engine(craft, task, num_envs, timing, seed=seeds[0], **settings)
    return _MembersEngine(craft, task, num_envs, timing, seeds, **settings)


class _MembersEngine(Engine):
    def __init__(self, craft: Spacecraft, task: Task, num_envs: int, timing: Timing, seeds: Sequence[int],
                 **settings: Any) -> None:
        self._each, self._seeds = num_envs // len(seeds), seeds
        # The generated kernel reads one seed for all.
        super().__init__(craft, task, num_envs, timing, **settings, generated=False)

    def _set_seed(self, words: Sequence[int]) -> None:
        self._numbers = self._numbers[0], self._each * self.processes.size
        columns = np.repeat([seed_words(seed) for seed in self._seeds], self._each, axis=0).astype(np.int32).T
        if self._on_numpy:
            self._seed = (columns[0], columns[1])
        elif self._seed[0].shape:
            for memory, column in zip(self._seed, columns, strict=True):
                memory.copy_(torch.from_numpy(column.copy()))
        else:
            self._seed = tuple(torch.tensor(column.copy(), device=self.device) for column in columns)  # type: ignore[assignment]

    def _first_numbers(self) -> Any:
        """Every member's episodes count from zero."""
        return super()._first_numbers() % (self._each * self.processes.size)
