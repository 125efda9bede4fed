"""What a registered task must be: a dataclass with defaults, and errors that its tolerances bound."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Set
from typing import Any

import numpy as np

from rans.base.errors import ConfigError, brief
from rans.tasks.base import SingleTask, Task
from rans.tasks.derived import example_state
from rans.tasks.quantities import QUANTITIES
from rans.tasks.results import check_results


def checked(found: Any) -> type[Any]:
    """The class, checked to be a task: a dataclass with defaults."""
    if not (
        isinstance(found, type) and issubclass(found, Task) and dataclasses.is_dataclass(found)
    ):
        raise ConfigError(
            f"a task must be a dataclass derived from rans.tasks.SingleTask, got {brief(found)}."
        )
    without_default = [
        field.name
        for field in dataclasses.fields(found)
        if field.default is field.default_factory is dataclasses.MISSING
    ]
    if without_default:
        raise ConfigError(
            f"the settings {', '.join(without_default)} of {found.__name__} have no defaults."
        )
    # Quantities of which a single task measures errors; a multi-task has those of its parts.
    if issubclass(found, SingleTask):
        task = found()
        if not found.__module__.startswith("rans."):
            check_results(task)
        quantities = task.tolerances().keys()
        if not quantities:
            raise ConfigError(f"{found.__name__} has no tolerances, which every task must have.")
        if unknown := sorted(quantities - QUANTITIES.keys()):
            raise ConfigError(
                f"{found.__name__} has a tolerance of {', '.join(unknown)}; errors can be of "
                f"{', '.join(QUANTITIES)}."
            )
        _check_errors(task, quantities)
    return found


_OF_A_STATE = {"position", "attitude", "velocity", "spin"}
"""Quantities whose errors vanish at the goal; others, such as the points left to inspect, end with a flight."""


def _check_errors(task: SingleTask, quantities: Set[str]) -> None:
    """Reject errors of undeclared quantities or at the goal, and tolerances without an error.

    Tasks whose code fails are skipped.
    """
    for dimension in (2, 3):
        with contextlib.suppress(Exception):  # a task may be for space alone
            start, goal = example_state(task, dimension)
            errors = task.errors(start, goal).keys()
            left = {name: float(np.max(error)) for name, error in task.errors(goal, goal).items()}
            break
    else:
        return
    if unknown := sorted(errors - QUANTITIES.keys()):
        raise ConfigError(
            f"{type(task).__name__} has an error of {', '.join(unknown)}; errors can be of "
            f"{', '.join(QUANTITIES)}."
        )
    if missing := sorted(quantities - errors):
        raise ConfigError(
            f"{type(task).__name__} has a tolerance of {', '.join(missing)}, but its errors "
            f"are of {', '.join(errors)}."
        )
    tolerances = task.tolerances()
    if apart := [
        name for name in quantities & _OF_A_STATE if not abs(left[name]) <= tolerances[name]
    ]:
        name = min(apart)
        raise ConfigError(
            f"{type(task).__name__} has an error of {name} of {left[name]:.3g} where the state is the goal, and a "
            f"tolerance of {tolerances[name]:.3g}: controllers and optimal control fly to the goal. Let `sample` "
            "return a goal at which the errors are zero."
        )
