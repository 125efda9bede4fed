"""Spacecraft and task of a controller that a user makes by their names."""

from __future__ import annotations

from pathlib import Path

from rans.base.registry import typed
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import Task, load_task


def craft_and_task(craft: str | Path | Spacecraft, task: str | Task) -> tuple[Spacecraft, Task]:
    """Spacecraft and task, by name, TOML file or as such.

    Raises:
        ConfigError: there is no such spacecraft or task.
    """
    return load_spacecraft(typed(craft)), load_task(typed(task))
