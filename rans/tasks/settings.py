"""Settings of tasks: checks of their values, and a function that replaces numbers in them."""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from rans.base.errors import ConfigError
from rans.model.trace import Symbol

Tree = TypeVar("Tree")
"""A task, or any nested dataclasses and tuples of numbers."""


_MOST = 3e38
"""Largest setting: single precision, in which engines fly, has none above 3.4e38."""


def check_settings(task: Any) -> None:
    """Reject impossible settings, with bounds that follow from their names; booleans are not checked.

    Raises:
        ConfigError: a scale, distance, tolerance or limit is not a finite number > 0, a weight is negative, the
            bounds of a range are not in ascending order, or episodes would fail at their start.
    """
    for field in dataclasses.fields(task):
        name = field.name
        value = getattr(task, field.name)
        is_unset = value is None and field.default is None
        if (
            is_unset or isinstance(value, bool) or dataclasses.is_dataclass(value)
        ):  # which check themselves
            continue
        is_range = isinstance(field.default, tuple)
        if is_range and not (isinstance(value, tuple) and len(value) == 2):
            raise ConfigError(f"{name} must be a range (low, high), got {value!r}.")
        # Curricula check the tensors that they change; a number of NumPy is checked as any other.
        numbers = [
            x.item() if isinstance(x, np.generic) else x
            for x in (value if isinstance(value, tuple) else (value,))
            if isinstance(x, int | float | np.generic) or getattr(x, "shape", None) != ()
        ]
        if not all(isinstance(x, int | float) and 0 <= x <= _MOST for x in numbers):
            raise ConfigError(f"{name} must be from 0 to {_MOST:g}, got {value!r}.")
        if name == "sharpness" and not (isinstance(value, int) and 1 <= value <= 8):
            raise ConfigError(f"{name} must be a whole number from 1 to 8, got {value!r}.")
        if isinstance(value, tuple) and value[0] > value[1]:
            raise ConfigError(f"{name} must be a range (low, high), got {value!r}.")
        may_be_zero = (
            isinstance(value, tuple) or name.endswith("weight") or name.startswith("rest_")
        )
        if numbers == [0] and not may_be_zero:
            raise ConfigError(
                f"{name} must be > 0, got {value!r}; only weights and rests may be zero."
            )
    spawn = getattr(task, "spawn_distance", None)
    fails = getattr(task, "fail_distance", math.inf)
    if isinstance(spawn, tuple) and fails <= spawn[1]:
        raise ConfigError(
            f"fail_distance must exceed the farthest start, {spawn[1]} m, got {fails}: "
            "episodes would fail at their start."
        )


def map_settings(function: Callable[..., Any], *tasks: Tree, checked: bool = False) -> Tree:
    """The first of several tasks of one class with other numbers in its settings.

    Args:
        function: called with the name of a setting and the number of each task there, which may be an array;
            returns the new number. The two numbers of a range are "spawn_distance.0" and "spawn_distance.1",
            and that of a task within a multi-task is "go_to_pose.thrust_weight".
        tasks: tasks of one class.
        checked: whether the result must pass the checks of its classes, which need plain numbers.

    Raises:
        ConfigError: the result is checked and does not pass.
    """
    return _mapped(function, "", tasks, checked)


def _mapped(function: Callable[..., Any], name: str, values: tuple[Any, ...], checked: bool) -> Any:
    """A function applied to the numbers of several settings side by side, in tuples and dataclasses too.

    Names of inner settings have dots (``thrust.weight``), those of entries numbers (``range.0``): curricula read
    them.
    """
    first = values[0]
    if isinstance(first, tuple):
        return tuple(
            _mapped(function, f"{name}.{i}", column, checked)
            for i, column in enumerate(zip(*values, strict=True))
        )
    if not dataclasses.is_dataclass(first) or isinstance(first, type):
        return function(name, *values) if _is_number(first) else first
    inner = {
        field.name: _mapped(
            function,
            f"{name}.{field.name}".lstrip("."),
            tuple(getattr(value, field.name) for value in values),
            checked,
        )
        for field in dataclasses.fields(first)
    }
    if checked:
        return dataclasses.replace(first, **inner)
    result = copy.copy(first)
    for setting, value in inner.items():
        object.__setattr__(result, setting, value)
    return result


def _is_number(value: Any) -> bool:
    return hasattr(value, "shape") or (
        isinstance(value, int | float | Symbol) and not isinstance(value, bool)
    )
