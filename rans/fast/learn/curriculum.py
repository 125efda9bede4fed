"""Curricula: settings of a task that change during training from an easy value to their own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from rans.errors import ConfigError
from rans.structure import Range
from rans.tasks import Task
from rans.tasks.settings import map_settings


@dataclass(frozen=True)
class Ramp:
    """Ramp of one setting from a start value to that of the task.

    Raises:
        ConfigError: a value is out of its range.
    """

    setting: str
    """Name of a number or range of the task, or of a task within a multi-task: go_to_pose.spawn_distance."""
    start: Range
    """Value before the ramp."""
    duration: int
    """Environment steps of the ramp."""
    begin: int = 0
    """Environment steps before the ramp."""
    shape: Literal["linear", "geometric"] = "linear"
    """Shape of the ramp; geometric has a constant growth rate."""

    def __post_init__(self) -> None:
        if self.duration < 1 or self.begin < 0:
            raise ConfigError(
                f"the ramp of {self.setting} must have a duration >= 1 and a begin >= 0, got "
                f"{self.duration} and {self.begin} steps."
            )
        if self.shape not in ("linear", "geometric"):
            raise ConfigError(
                f"the shape of {self.setting}'s ramp must be linear or geometric, got {self.shape!r}."
            )
        if self.shape == "geometric" and not min(_numbers(self.start)) > 0:
            raise ConfigError(
                f"the geometric ramp of {self.setting} must start above 0, got {self.start!r}."
            )

    def completed(self, steps: int) -> float:
        """Completed share of the ramp after ``steps`` environment steps, 0 to 1."""
        return min(max((steps - self.begin) / self.duration, 0.0), 1.0)

    def values(self, end: Range, steps: int) -> Iterator[float]:
        """Yield the one or two numbers of the setting after ``steps`` environment steps.

        `Curriculum.move_to` writes them in place, and recipes of shipped agents have such ramps: a number that
        changes makes other agents of the same seed.
        """
        fraction = self.completed(steps)
        for low, high in zip(_numbers(self.start), _numbers(end), strict=True):
            yield (
                low * (high / low) ** fraction
                if self.shape == "geometric"
                else low + (high - low) * fraction
            )


def check_ramps(task: Task, ramps: Sequence[Ramp]) -> None:
    """Reject ramps that the task does not allow.

    Raises:
        ConfigError: a setting is unknown or has two ramps, a start is not of the setting's kind (number or range),
            a geometric ramp ends at 0, or the task rejects the values at the start or end of a ramp.
    """
    ranges = _numbers_of(task)
    for ramp in ramps:
        name = ramp.setting
        if name not in ranges:
            raise ConfigError(
                f"the task has no setting {name!r} to ramp; known are {', '.join(ranges)}."
            )
        if sum(each.setting == name for each in ramps) > 1:
            raise ConfigError(f"{name} has more than one ramp; give it one.")
        if ramp.shape == "geometric" and not min(_numbers(ranges[name])) > 0:
            raise ConfigError(
                f"the geometric ramp of {name} must end above 0, got {ranges[name]!r}; take a "
                "linear one."
            )
        if len(_numbers(ramp.start)) != len(_numbers(ranges[name])):
            raise ConfigError(
                f"the ramp of {name} must start at something like {ranges[name]!r}, got "
                f"{ramp.start!r}."
            )
    for steps in sorted(
        {time for ramp in ramps for time in (ramp.begin, ramp.begin + ramp.duration)}
    ):
        task_at(task, ramps, steps)


def task_at(task: Task, ramps: Sequence[Ramp], steps: int) -> Task:
    """The task with its settings after ``steps`` environment steps.

    By it `check_ramps` refuses settings that a ramp would make wrong; the training itself moves arrays
    (`Curriculum`).
    """
    ends = _numbers_of(task)
    changes = dict[str, float]()
    for ramp in ramps:
        changes |= zip(
            _places(ramp.setting, ends), ramp.values(ends[ramp.setting], steps), strict=True
        )
    return map_settings(lambda name, number: changes.get(name, number), task, checked=True)


class Curriculum:
    """Task whose ramped settings are arrays without axes that are changed in place.

    Steps therefore need no new compilation and no new CUDA graph.

    Args:
        task: the task with its final values.
        ramps: ramps of settings.
        dtype: dtype of the engine's fields, of NumPy or torch.
        device: torch device.
    """

    def __init__(
        self,
        task: Task,
        ramps: Sequence[Ramp],
        dtype: Any,
        device: Any = None,
    ) -> None:
        # Arrays of the settings that move, with their values before the first step.
        ends = _numbers_of(task) if ramps else {}
        memory = dict[str, Any]()
        self._moving: list[tuple[Ramp, Range, list[Any]]] = []
        for ramp in ramps:
            end = ends[ramp.setting]
            numbers = [_array(value, dtype, device) for value in ramp.values(end, 0)]
            self._moving.append((ramp, end, numbers))
            memory |= zip(_places(ramp.setting, ends), numbers, strict=True)
        self.task = map_settings(lambda name, number: memory.get(name, number), task)
        """Task for the engine, whose ramped settings are arrays."""

    def move_to(self, steps: int) -> None:
        """Set every ramped setting to its value after ``steps`` environment steps."""
        for ramp, end, numbers in self._moving:
            for number, value in zip(numbers, ramp.values(end, steps), strict=True):
                number[...] = value


def _array(value: float, dtype: Any, device: Any) -> Any:
    """Array without axes, of NumPy or torch as its dtype is."""
    if isinstance(dtype, type):
        return np.asarray(value, dtype)
    import torch

    return torch.tensor(value, dtype=dtype, device=device)


def _numbers(value: Range) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else (value,)


def _numbers_of(task: Task) -> dict[str, Range]:
    """Numbers and ranges of a task's settings by name; those of inner tasks have dotted names.

    A range is one entry here and two numbers, ``name.0`` and ``name.1``, in `map_settings`.
    """
    result: dict[str, Any] = {}

    def note(name: str, number: float) -> float:
        setting, _, component = name.rpartition(".")
        if component.isdigit():
            result[setting] = (*result.get(setting, ()), number)
        else:
            result[name] = number
        return number

    map_settings(note, task)
    return result


def _places(setting: str, ranges: dict[str, Range]) -> list[str]:
    """Names of the one or two numbers of a setting in `map_settings`."""
    return [f"{setting}.{i}" for i in (0, 1)] if isinstance(ranges[setting], tuple) else [setting]
