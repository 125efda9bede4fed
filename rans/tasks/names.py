"""Tasks by name, and the name of a task."""

from __future__ import annotations

from rans.base.errors import ConfigError, brief
from rans.tasks import TASKS
from rans.tasks.base import Task


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
