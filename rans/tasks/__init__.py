"""Tasks of a spacecraft. A line in `TASKS`, or an entry point, registers a task everywhere."""

from __future__ import annotations

import contextlib
import dataclasses
import re
from collections.abc import Set
from typing import Any

from rans.errors import ConfigError, brief
from rans.registry import Registry
from rans.tasks.avoid import Avoid
from rans.tasks.base import SingleTask, Task, observation
from rans.tasks.derived import example_state, observation_columns, observation_width
from rans.tasks.dock import Dock
from rans.tasks.dock_port import DockPort
from rans.tasks.go_to_attitude import GoToAttitude
from rans.tasks.go_to_pose import GoToPose
from rans.tasks.go_to_pose_priced import GoToPosePriced
from rans.tasks.go_to_position import GoToPosition
from rans.tasks.hold import Hold
from rans.tasks.inspect import Inspect
from rans.tasks.land import Land
from rans.tasks.multi_task import MultiTask
from rans.tasks.orbital import TargetOrbit
from rans.tasks.quantities import QUANTITIES
from rans.tasks.rendezvous import Rendezvous
from rans.tasks.results import check_results
from rans.tasks.rewards import RestReward, Transition
from rans.tasks.tracking import TrackTwist, TrackVelocity, TrackVelocityHeading


def _checked(found: Any) -> type[Any]:
    """The class, checked to be a task: a dataclass with defaults and all methods of tasks."""
    if not (
        isinstance(found, type) and issubclass(found, Task) and dataclasses.is_dataclass(found)
    ):
        raise ConfigError(
            f"a task must be a dataclass derived from rans.tasks.SingleTask, got {brief(found)}."
        )
    if missing := sorted(found.__abstractmethods__):
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


TASKS = Registry(
    "task",
    "rans.tasks",
    {
        "go-to-position": "rans.tasks:GoToPosition",
        "go-to-pose": "rans.tasks:GoToPose",
        "go-to-attitude": "rans.tasks:GoToAttitude",
        "track-velocity": "rans.tasks:TrackVelocity",
        "track-twist": "rans.tasks:TrackTwist",
        "track-velocity-heading": "rans.tasks:TrackVelocityHeading",
        "multi-task": "rans.tasks:MultiTask",
        "go-to-pose-priced": "rans.tasks:GoToPosePriced",
        "avoid": "rans.tasks:Avoid",
        "dock-port": "rans.tasks:DockPort",
        "dock": "rans.tasks:Dock",
        "hold": "rans.tasks:Hold",
        "rendezvous": "rans.tasks:Rendezvous",
        "land": "rans.tasks:Land",
        "inspect": "rans.tasks:Inspect",
    },
    _checked,
)
"""Class of every task by its name on the command line."""

_PUBLISHED = {
    "go-to-position": ("GoToXY", "GoToXYZ"),
    "track-velocity": ("TrackXYVelocity", "TrackXYZVelocity"),
    "track-twist": ("TrackXYOVelocity", "TrackXYZOVelocity"),
    "track-velocity-heading": ("TrackXYVelocityHeading", "TrackXYZVelocityAttitude"),
}
"""Names of papers for tasks in the plane and in space, where they differ from NAME2D and NAME3D."""


def load_task(name: str | Task) -> Task:
    """Load a task with default settings by name (`TASKS`) or as MODULE:NAME; a task object is returned as is.

    >>> rans.load_task("go-to-pose")
    GoToPose()

    Raises:
        ConfigError: there is no such task, or the argument is neither a name nor a task.
    """
    if isinstance(name, Task):
        return name
    if isinstance(name, type) and issubclass(name, Task):
        raise ConfigError(f"a task is an object of its class: write {name.__name__}().")
    if not isinstance(name, str):
        raise ConfigError(
            "a task is a name or an object such as rans.GoToPose(thrust_weight=0.05), got "
            f"{brief(name)}."
        )
    return TASKS[name]()


def registered_name(task: Task) -> str | None:
    """Name of the class of a task in `TASKS`; None if it is not registered.

    >>> from rans.tasks import registered_name
    >>> registered_name(rans.GoToPose())
    'go-to-pose'
    """
    return next((name for name in TASKS if TASKS[name] is type(task)), None)


def gymnasium_ids(name: str) -> tuple[str, str]:
    """Gymnasium ids of a task in the plane and in space, by its name and without loading it.

    Those of "my-task" are "rans/MyTask2D-v0" and "rans/MyTask3D-v0".
    """
    base = "".join(word[:1].upper() + word[1:] for word in re.split(r"\W+", name))
    plane, space = _PUBLISHED.get(name, (f"{base}2D", f"{base}3D"))
    return f"rans/{plane}-v0", f"rans/{space}-v0"


__all__ = [
    "TASKS",
    "Avoid",
    "DockPort",
    "Dock",
    "GoToAttitude",
    "GoToPose",
    "GoToPosePriced",
    "GoToPosition",
    "Land",
    "Hold",
    "Inspect",
    "MultiTask",
    "Rendezvous",
    "RestReward",
    "TargetOrbit",
    "SingleTask",
    "Task",
    "TrackTwist",
    "TrackVelocity",
    "TrackVelocityHeading",
    "Transition",
    "gymnasium_ids",
    "load_task",
    "observation",
    "observation_columns",
    "observation_width",
    "registered_name",
]
