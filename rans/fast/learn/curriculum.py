"""Curricula: settings of a task that move during training, from an easy start to their own value."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from rans.errors import ConfigError
from rans.tasks import Task

Numbers = float | tuple[float, float]
"""What a setting is made of: one number, or two for a range."""

_STEEPNESS = 4.5
"""Of the sigmoid: it rises most within the middle half of its duration (original system, 2024)."""


@dataclass(frozen=True)
class Ramp:
    """One setting on its way to the value the task gives it.

    Raises:
        ConfigError: a value is out of its range.
    """

    setting: str
    """Name of a number or range among the task's settings; of a task within a multi-task:
    go_to_pose.spawn_distance."""
    start: Numbers
    """Its value until the ramp begins."""
    duration: int
    """Environment steps that the ramp takes."""
    begin: int = 0
    """Environment steps before it begins."""
    shape: Literal["linear", "sigmoid", "geometric"] = "linear"
    """How it rises; geometric: by the same factor in the same time."""

    def __post_init__(self) -> None:
        if self.duration < 1 or self.begin < 0:
            raise ConfigError(f"the ramp of {self.setting} must have a duration >= 1 and a begin >= 0, got "
                              f"{self.duration} and {self.begin} steps.")
        if self.shape not in ("linear", "sigmoid", "geometric"):
            raise ConfigError(f"the shape of {self.setting}'s ramp must be linear, sigmoid or geometric, got "
                              f"{self.shape!r}.")
        if self.shape == "geometric" and not min(_numbers(self.start)) > 0:
            raise ConfigError(f"the geometric ramp of {self.setting} must start above 0, got {self.start!r}.")

    def share(self, steps: int) -> float:
        """Part of the way done after so many environment steps, 0 to 1.

        The sigmoid is (tanh(s (x - 1/2)) + tanh(s / 2)) / (2 tanh(s / 2)) of the linear share x, which
        starts at 0 and ends at 1 (original system, 2024).
        """
        x = min(max((steps - self.begin) / self.duration, 0.0), 1.0)
        if self.shape != "sigmoid":
            return x
        return 0.5 + 0.5 * math.tanh(_STEEPNESS * (x - 0.5)) / math.tanh(0.5 * _STEEPNESS)

    def values(self, end: Numbers, steps: int) -> Iterator[float]:
        """The setting's one or two numbers after so many environment steps."""
        share = self.share(steps)
        for low, high in zip(_numbers(self.start), _numbers(end), strict=True):
            yield low * (high / low) ** share if self.shape == "geometric" else low + (high - low) * share


def check_ramps(task: Task, ramps: Sequence[Ramp]) -> None:
    """Refuse ramps that the task cannot follow.

    Raises:
        ConfigError: a setting is unknown or ramped twice, a start is no number or range as the setting
            is, a geometric ramp ends at 0, or the task refuses the values at a time when a ramp begins or
            ends.
    """
    known = dict(_settings(task))
    for ramp in ramps:
        if ramp.setting not in known:
            raise ConfigError(f"the task has no setting {ramp.setting!r} to ramp; known are "
                              f"{', '.join(known)}.")
        if sum(other.setting == ramp.setting for other in ramps) > 1:
            raise ConfigError(f"{ramp.setting} has more than one ramp; give it one.")
        if ramp.shape == "geometric" and not min(_numbers(known[ramp.setting])) > 0:
            raise ConfigError(f"the geometric ramp of {ramp.setting} must end above 0, got "
                              f"{known[ramp.setting]!r}; take a linear one.")
        if len(_numbers(ramp.start)) != len(_numbers(known[ramp.setting])):
            raise ConfigError(f"the ramp of {ramp.setting} must start at something like "
                              f"{known[ramp.setting]!r}, got {ramp.start!r}.")
    for steps in sorted({time for ramp in ramps for time in (ramp.begin, ramp.begin + ramp.duration)}):
        task_at(task, ramps, steps)


def task_at(task: Task, ramps: Sequence[Ramp], steps: int) -> Task:
    """The task after so many environment steps."""
    ends = dict(_settings(task))
    return _with(task, {ramp.setting: tuple(ramp.values(ends[ramp.setting], steps)) for ramp in ramps})


class Curriculum:
    """A task whose ramped settings are numbers in memory, changed in place.

    So a compiled step reads them without being compiled again, and a CUDA graph without being recorded
    again.

    Args:
        task: with the settings that the ramps end at.
        ramps: see `check_ramps`.
        dtype: of the engine's fields, NumPy's or torch's.
        device: of torch's.
    """

    def __init__(self, task: Task, ramps: Sequence[Ramp], dtype: Any, device: Any = None) -> None:
        ends = dict(_settings(task))
        self._moving = [
            (ramp, end, tuple(_number(value, dtype, device) for value in ramp.values(end, 0)))
            for ramp in ramps for end in [ends[ramp.setting]]]
        self.task = _with(task, {ramp.setting: numbers for ramp, _, numbers in self._moving})
        """To fly and learn."""

    def move_to(self, steps: int) -> None:
        """Give every ramped setting its value after so many environment steps."""
        for ramp, end, numbers in self._moving:
            for number, value in zip(numbers, ramp.values(end, steps), strict=True):
                number[...] = value


def _number(value: float, dtype: Any, device: Any) -> Any:
    """A number in memory, as an array without axes."""
    if isinstance(dtype, type):
        return np.array(value, dtype=dtype)
    import torch

    return torch.tensor(value, dtype=dtype, device=device)


def _numbers(value: Numbers) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else (value,)


def _settings(task: Any) -> Iterator[tuple[str, Numbers]]:
    """Every number and range among the settings, by name; those of tasks within after a dot."""
    for field in dataclasses.fields(task):
        value = getattr(task, field.name)
        if dataclasses.is_dataclass(value):
            yield from ((f"{field.name}.{name}", inner) for name, inner in _settings(value))
        elif all(isinstance(x, int | float) for x in _numbers(value)):
            yield field.name, value


def _with(task: Any, changes: dict[str, tuple[Any, ...]]) -> Any:
    """The task with these numbers in its settings, all at once: it may refuse some without the others."""
    values: dict[str, Any] = {}
    for name in {setting.partition(".")[0] for setting in changes}:
        value, prefix = getattr(task, name), f"{name}."
        if dataclasses.is_dataclass(value):
            inner = {k.removeprefix(prefix): v for k, v in changes.items() if k.startswith(prefix)}
            values[name] = _with(value, inner)
        else:
            values[name] = changes[name] if isinstance(value, tuple) else changes[name][0]
    return replace(task, **values)
