"""Curricula: settings of a task that change during training from an easy value to their own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from rans.base.errors import ConfigError, one_of
from rans.base.structure import Range
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
        one_of(f"the shape of {self.setting}'s ramp", self.shape, ("linear", "geometric"))
        if self.shape == "geometric" and not min(self.starts.values()) > 0:
            raise ConfigError(
                f"the geometric ramp of {self.setting} must start above 0, got {self.start!r}."
            )

    @property
    def starts(self) -> dict[str, float]:
        """Values before the ramp of the one or two numbers of the setting, by their names in `map_settings`."""
        if not isinstance(self.start, tuple):
            return {self.setting: self.start}
        return {f"{self.setting}.{i}": number for i, number in enumerate(self.start)}

    def values(self, ends: Mapping[str, float], steps: int) -> dict[str, float]:
        """Numbers of the setting after ``steps`` environment steps, of those of the task by their names.

        Recipes of shipped agents have such ramps: a number that changes makes other agents of the same seed.
        """
        fraction = min(max((steps - self.begin) / self.duration, 0.0), 1.0)
        return {
            name: low * (ends[name] / low) ** fraction
            if self.shape == "geometric"
            else low + (ends[name] - low) * fraction
            for name, low in self.starts.items()
        }


def check_ramps(task: Task, ramps: Sequence[Ramp]) -> None:
    """Reject ramps that the task does not allow.

    Raises:
        ConfigError: a setting is unknown or has two ramps, a start is not of the setting's kind (number or range),
            a geometric ramp ends at 0, or the task rejects the values at the start or end of a ramp.
    """
    ends = _numbers(task)
    known = dict.fromkeys(name.removesuffix(".0").removesuffix(".1") for name in ends)
    for ramp in ramps:
        name = ramp.setting
        if not ramp.starts.keys() <= ends.keys():
            kind = "range" if isinstance(ramp.start, tuple) else "number"
            raise ConfigError(
                f"the task has no {kind} {name!r} to ramp; known settings are {', '.join(known)}."
            )
        if sum(each.setting == name for each in ramps) > 1:
            raise ConfigError(f"{name} has more than one ramp; give it one.")
        if ramp.shape == "geometric" and not min(ends[each] for each in ramp.starts) > 0:
            raise ConfigError(f"the geometric ramp of {name} must end above 0; take a linear one.")
    # Settings that a ramp would make wrong together with others.
    for steps in sorted({each.begin + after for each in ramps for after in (0, each.duration)}):
        moved = _moved(ramps, ends, steps)
        map_settings(lambda name, number, moved=moved: moved.get(name, number), task, checked=True)


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
        self._ramps = ramps
        self._ends = _numbers(task)
        self._arrays = {
            name: _array(value, dtype, device)
            for name, value in _moved(ramps, self._ends, 0).items()
        }
        self.task = map_settings(lambda name, number: self._arrays.get(name, number), task)
        """Task for the engine, whose ramped settings are arrays."""

    def move_to(self, steps: int) -> None:
        """Set every ramped setting to its value after ``steps`` environment steps."""
        for name, value in _moved(self._ramps, self._ends, steps).items():
            self._arrays[name][...] = value


def _moved(ramps: Sequence[Ramp], ends: Mapping[str, float], steps: int) -> dict[str, float]:
    """Numbers of all ramped settings after ``steps`` environment steps, by name."""
    return {name: x for ramp in ramps for name, x in ramp.values(ends, steps).items()}


def _array(value: float, dtype: Any, device: Any) -> Any:
    """Array without axes, of NumPy or torch as its dtype is."""
    if isinstance(dtype, type):
        return np.asarray(value, dtype)
    import torch

    return torch.tensor(value, dtype=dtype, device=device)


def _numbers(task: Task) -> dict[str, float]:
    """Numbers of a task's settings by their names in `map_settings`."""
    result: dict[str, float] = {}

    def note(name: str, number: float) -> float:
        result[name] = number
        return number

    map_settings(note, task)
    return result
