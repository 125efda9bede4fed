"""What a registered task must be: a dataclass with defaults, all methods, and errors that its tolerances bound."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Set
from typing import Any

from rans.errors import ConfigError, brief
from rans.tasks.base import SingleTask, Task
from rans.tasks.derived import example_state
from rans.tasks.quantities import QUANTITIES
from rans.tasks.results import check_results


def checked(found: Any) -> type[Any]:
    """The class, checked to be a task: a dataclass with defaults and all methods of tasks."""
    if not (
        isinstance(found, type) and issubclass(found, Task) and dataclasses.is_dataclass(found)
    ):
        raise ConfigError(
            f"a task must be a dataclass derived from rans.tasks.SingleTask, got {brief(found)}."
        )
    if missing := sorted(found.__abstractmethods__):  # pyrefly: ignore[missing-attribute]
        raise ConfigError(
            f"{found.__name__} has no {', '.join(missing)}, which every task must have."
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


def _check_errors(task: SingleTask, quantities: Set[str]) -> None:
    """Reject errors of undeclared quantities, and tolerances without an error; skip tasks whose code fails."""
    for dimension in (2, 3):
        with contextlib.suppress(Exception):  # a task may be for space alone
            errors = task.errors(*example_state(task, dimension)).keys()
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
