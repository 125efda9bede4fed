"""What every environment interface shares: its spaces, and how it reads what a user asks for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces

from rans.errors import ConfigError
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import TASKS, Task
from rans.tasks.base import example
from rans.tasks.sight import Dimension

_DEFAULT_CRAFT = {2: "floating-platform", 3: "free-flyer"}


def observation_space(task: Task, dimension: Dimension,
                      dtype: type[np.floating[Any]] = np.float32) -> spaces.Box:
    """The columns of a task's observation, within their bounds; without one, any finite float32 number.

    Gymnasium's and SB3's checkers ask for finite bounds.
    """
    bounds = np.minimum(example(task, dimension).bounds(), np.finfo(np.float32).max).astype(dtype)
    return spaces.Box(-bounds, bounds, dtype=dtype)


def action_space(craft: Spacecraft) -> spaces.Space[np.ndarray]:
    """What the craft's actuators take."""
    return craft.actuators.action_space(len(craft.thrusters))


def checked_render_mode(render_mode: str | None) -> str | None:
    """The render mode; `ConfigError`, unless environments have it."""
    if render_mode not in (None, "human", "rgb_array"):
        raise ConfigError(f'render_mode must be None, "human" or "rgb_array", got {render_mode!r}.')
    return render_mode


def choose(task_name: str, dimension: Dimension, spacecraft: str | Path | Spacecraft | None,
           task: Task | None) -> tuple[Spacecraft, Task]:
    """Spacecraft and task of an environment, from what `rans.environment.Environment` takes.

    Raises:
        ConfigError: there is no such spacecraft or task, or it does not fit the environment.
    """
    craft = _DEFAULT_CRAFT[dimension] if spacecraft is None else spacecraft
    craft = craft if isinstance(craft, Spacecraft) else load_spacecraft(craft)
    if craft.dimension != dimension:
        raise ConfigError(f"this environment is for spacecraft of dimension {dimension}, got {craft.name!r} "
                          f"of dimension {craft.dimension}; environments named 2D fly in the plane, those "
                          "named 3D in space.")
    wanted = TASKS[task_name]
    if task is None:
        return craft, wanted()
    if isinstance(task, dict):
        given = ", ".join(f"{key}={value!r}" for key, value in task.items())
        raise ConfigError(f"task takes an object, no dict: {wanted.__name__}({given}) of "
                          f"{wanted.__module__}.")
    if not isinstance(task, wanted):
        raise ConfigError(f"this environment is for {wanted.__name__} settings, got {task!r}; choose the "
                          "environment named after the task.")
    return craft, task
