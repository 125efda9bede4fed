"""Curricula: settings of a task that move during training, from an easy start to their own value."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from rans.errors import ConfigError
from rans.renamed import present_name
from rans.structure import Range
from rans.tasks import Task
from rans.tasks.settings import map_settings

_STEEPNESS = 4.5
"""Of the sigmoid: it rises most within the middle half of its duration (original system, 2024)."""


@dataclass(frozen=True)
class Ramp:
    """One setting on its way to the value the task gives it; ConfigError where it cannot be."""

    setting: str
    """Of the task, a number or range; of a task within a multi-task: go_to_pose.spawn_distance."""
    start: Range
    """Its value until the ramp begins."""
    duration: int
    """Environment steps that the ramp takes."""
    begin: int = 0
    """Environment steps before it begins."""
    shape: Literal["linear", "sigmoid", "geometric"] = "linear"
    """How it rises; geometric: by the same factor in the same time."""

    def __post_init__(self) -> None:
        if self.duration < 1 or self.begin < 0:
            raise ConfigError(
                f"the ramp of {self.setting} must have a duration >= 1 and a begin >= 0, got "
                f"{self.duration} and {self.begin} steps."
            )
        if self.shape not in ("linear", "sigmoid", "geometric"):
            raise ConfigError(
                f"the shape of {self.setting}'s ramp must be linear, sigmoid or geometric, got "
                f"{self.shape!r}."
            )
        if self.shape == "geometric" and not min(_numbers(self.start)) > 0:
            raise ConfigError(
                f"the geometric ramp of {self.setting} must start above 0, got {self.start!r}."
            )

    def share(self, steps: int) -> float:
        """Part of the way done after so many environment steps, 0 to 1.

        The sigmoid is (tanh(s (x - 1/2)) + tanh(s / 2)) / (2 tanh(s / 2)) of the linear share x, which
        starts at 0 and ends at 1 (original system, 2024).
        """
        x = min(max((steps - self.begin) / self.duration, 0.0), 1.0)
        if self.shape != "sigmoid":
            return x
        return 0.5 + 0.5 * math.tanh(_STEEPNESS * (x - 0.5)) / math.tanh(0.5 * _STEEPNESS)

    def values(self, end: Range, steps: int) -> Iterator[float]:
        """The setting's one or two numbers after so many environment steps."""
        share = self.share(steps)
        for low, high in zip(_numbers(self.start), _numbers(end), strict=True):
            yield (
                low * (high / low) ** share
                if self.shape == "geometric"
                else low + (high - low) * share
            )


def with_present_settings(task: Task, ramps: Sequence[Ramp]) -> tuple[Ramp, ...]:
    """Ramps whose settings have their present names; a former one warns (`rans.renamed`)."""
    result = []
    for ramp in ramps:
        within, _, name = ramp.setting.rpartition(".")
        owner = getattr(task, within, task) if within else task
        present = present_name(type(owner), name)
        result.append(replace(ramp, setting=f"{within}.{present}" if within else present))
    return tuple(result)


def check_ramps(task: Task, ramps: Sequence[Ramp]) -> None:
    """Refuse, with a ConfigError, ramps that the task cannot follow.

    A setting is unknown or ramped twice, a start is no number or range as the setting is, a geometric ramp
    ends at 0, or the task refuses the values when a ramp begins or ends.
    """
    known = _numbers_of(task)
    for ramp in ramps:
        name = ramp.setting
        if name not in known:
            raise ConfigError(
                f"the task has no setting {name!r} to ramp; known are {', '.join(known)}."
            )
        if sum(other.setting == name for other in ramps) > 1:
            raise ConfigError(f"{name} has more than one ramp; give it one.")
        if ramp.shape == "geometric" and not min(_numbers(known[name])) > 0:
            raise ConfigError(
                f"the geometric ramp of {name} must end above 0, got {known[name]!r}; take a "
                "linear one."
            )
        if len(_numbers(ramp.start)) != len(_numbers(known[name])):
            raise ConfigError(
                f"the ramp of {name} must start at something like {known[name]!r}, got "
                f"{ramp.start!r}."
            )
    for steps in sorted(
        {time for ramp in ramps for time in (ramp.begin, ramp.begin + ramp.duration)}
    ):
        task_at(task, ramps, steps)


def task_at(task: Task, ramps: Sequence[Ramp], steps: int) -> Task:
    """The task after so many environment steps."""
    ends = _numbers_of(task)
    moved = dict[str, float]()
    for ramp in ramps:
        moved |= zip(
            _places(ramp.setting, ends), ramp.values(ends[ramp.setting], steps), strict=True
        )
    return map_settings(lambda name, number: moved.get(name, number), task, checked=True)


class Curriculum:
    """The task of K members whose ramped settings are numbers in memory, changed in place.

    So no step is compiled again to read them, and no CUDA graph recorded again. A number in which members
    differ is a field, with a value for each of their environments.

    Tasks, one a member, have the settings that the ramps end at, and differ in numbers only; each member has
    ``each`` environments. The dtype is that of the engine's fields, NumPy's or torch's.
    """

    def __init__(
        self,
        tasks: Sequence[Task],
        ramps: Sequence[Ramp],
        dtype: Any,
        device: Any = None,
        each: int = 1,
    ) -> None:
        self._moving: list[tuple[Ramp, list[Range], list[Any]]] = []
        memory = dict[str, Any]()
        ends = [_numbers_of(task) for task in tasks]
        for ramp in ramps:
            own = [end[ramp.setting] for end in ends]
            numbers = [
                _memory(column[:1] if len({*own}) == 1 else column, each, dtype, device)
                for column in _columns(ramp, own, 0)
            ]
            self._moving.append((ramp, own, numbers))
            memory |= zip(_places(ramp.setting, ends[0]), numbers, strict=True)

        def number(name: str, *values: Any) -> Any:
            if name in memory:
                return memory[name]
            return values[0] if len({*values}) == 1 else _memory(values, each, dtype, device)

        self.task = map_settings(number, *tasks)
        """To fly and learn."""

    def move_to(self, steps: int) -> None:
        """Give every ramped setting its value after so many environment steps."""
        for ramp, ends, numbers in self._moving:
            for number, values in zip(numbers, _columns(ramp, ends, steps), strict=True):
                parts = number.reshape(len(values), -1) if number.shape else [number]
                for part, value in zip(parts, values, strict=False):
                    part[...] = value


def _columns(ramp: Ramp, ends: Sequence[Range], steps: int) -> list[tuple[float, ...]]:
    """The setting's one or two numbers, each for every member."""
    return list(zip(*(ramp.values(end, steps) for end in ends), strict=True))


def _memory(values: Sequence[float], each: int, dtype: Any, device: Any) -> Any:
    """An array with the members' values for their environments, or without axes for one value."""
    column = np.repeat(values, each) if len(values) > 1 else np.asarray(values[0])
    if isinstance(dtype, type):
        return column.astype(dtype)
    import torch

    return torch.tensor(column, dtype=dtype, device=device)


def _numbers(value: Range) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else (value,)


def _numbers_of(task: Task) -> dict[str, Range]:
    """Every number and range among the settings, by name; those of tasks within after a dot."""
    result: dict[str, Any] = {}

    def note(name: str, number: float) -> float:
        setting, _, place = name.rpartition(".")
        if place.isdigit():
            result[setting] = (*result.get(setting, ()), number)
        else:
            result[name] = number
        return number

    map_settings(note, task)
    return result


def _places(setting: str, known: dict[str, Range]) -> list[str]:
    """Names of the setting's one or two numbers, as `map_settings` gives them."""
    return [f"{setting}.{i}" for i in (0, 1)] if isinstance(known[setting], tuple) else [setting]
