"""A task's settings, walked by one function: curricula, sweeps and kernels replace numbers in them."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable
from typing import Any, TypeVar

Settings = TypeVar("Settings")


def map_settings(function: Callable[..., Any], *tasks: Settings, checked: bool = False) -> Settings:
    """The first task with other numbers in its settings.

    Args:
        function: given the setting's name and the number that each task has there, returns what to put in
            its place. The two numbers of a range are "spawn_distance.0" and "spawn_distance.1", those of a
            task within a multi-task "go_to_pose.thrust_weight". A number may be an array.
        tasks: of one class.
        checked: whether the result must pass the checks of its classes, which want plain numbers.

    Raises:
        ConfigError: it does not.
    """
    return _mapped(function, "", tasks, checked)


def _mapped(function: Callable[..., Any], name: str, values: tuple[Any, ...], checked: bool) -> Any:
    first = values[0]
    if isinstance(first, tuple):
        return tuple(_mapped(function, f"{name}.{i}", column, checked)
                     for i, column in enumerate(zip(*values, strict=True)))
    if not dataclasses.is_dataclass(first) or isinstance(first, type):
        return function(name, *values) if _is_number(first) else first
    inner = {field.name: _mapped(function, f"{name}.{field.name}".lstrip("."),
                                 tuple(getattr(value, field.name) for value in values), checked)
             for field in dataclasses.fields(first)}
    if checked:
        return dataclasses.replace(first, **inner)
    result = copy.copy(first)
    for setting, value in inner.items():
        object.__setattr__(result, setting, value)
    return result


def _is_number(value: Any) -> bool:
    return hasattr(value, "shape") or (isinstance(value, int | float) and not isinstance(value, bool))
