"""Many trainings' environments in one batch: every member keeps its own seed, episodes and task settings."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import torch

from rans.fast.engine import Engine, field_dtype
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.tasks import Task


class MembersEngine(Engine):
    """K members of n environments: environment i belongs to member i // n.

    Args:
        craft: the spacecraft, the same for all.
        tasks: one a member; they differ in numbers only.
        each: n.
        timing: the same for all.
        seed: of every member, until they `adopt` others.
        device: torch device of the state.
        dtype: as `Engine`.
        compiled: as `Engine`.
    """

    def __init__(self, craft: Spacecraft, tasks: Sequence[Task], each: int, timing: Timing, *,
                 seed: int = 0, device: str | torch.device = "cpu",
                 dtype: torch.dtype = torch.float32, compiled: bool | None = None) -> None:
        self.members, self._each = len(tasks), each

        def field(values: Sequence[float]) -> Any:
            column = torch.tensor(values, dtype=dtype, device=device).repeat_interleave(each)
            on_torch = isinstance(field_dtype(torch.device(device), dtype, compiled), torch.dtype)
            return column if on_torch else column.numpy()

        # The generated kernel reads one seed for all.
        super().__init__(craft, merged(tasks, field), self.members * each, timing, seed=seed, device=device,
                         dtype=dtype, compiled=compiled, generated=False)
        self._numbers = self._numbers[0], each

    def _int32(self, value: int) -> Any:
        """One seed an environment."""
        shared = super()._int32(value)
        return shared if self._on_numpy else shared.repeat(self.num_envs)

    def _first_numbers(self) -> Any:
        """Every member's episodes count from zero."""
        return super()._first_numbers() % self._each

    def adopt(self, engines: Sequence[Engine]) -> None:
        """Go on with the episodes of K engines of n environments, under their seeds."""
        saved = [engine.save_state() for engine in engines]
        # The last command, which comes last, is shut valves in engines whose task does not watch it.
        values = zip(*(state["buffers"] for state in saved), strict=False)
        for buffer, parts in zip(self._buffers(), values, strict=False):
            self._write(buffer, self._field(torch.cat(parts)))
        words = [self._field(torch.tensor(word, dtype=torch.int32).repeat_interleave(self._each))
                 for word in zip(*(state["seed"] for state in saved), strict=True)]
        if self._on_numpy:
            self._seed = (words[0], words[1])
        else:
            for memory, word in zip(self._seed, words, strict=True):
                memory.copy_(word)

    def _field(self, values: torch.Tensor) -> Any:
        return values.numpy() if self._on_numpy else values.to(self.device)


def merged(values: Sequence[Any], field: Callable[[Sequence[float]], Any]) -> Any:
    """One task for all members: the numbers in which their tasks differ become fields.

    Args:
        values: the tasks, or the values that they have for one of their settings.
        field: the field that holds such a number for every environment.
    """
    first = values[0]
    if all(value == first for value in values):
        return first
    if isinstance(first, tuple):
        return tuple(merged(column, field) for column in zip(*values, strict=True))
    if not dataclasses.is_dataclass(first):
        return field(values)
    result = copy.copy(first)
    for setting in dataclasses.fields(first):
        # Not `replace`: every member's settings have been checked, and the checks want numbers.
        numbers = merged([getattr(value, setting.name) for value in values], field)
        object.__setattr__(result, setting.name, numbers)
    return result
