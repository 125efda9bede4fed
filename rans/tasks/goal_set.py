"""Goal set of a task: states within its tolerances, and at rest relative to a goal position or attitude."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rans.tasks.base import Task

_RATES = {"position": "velocity", "attitude": "spin"}
"""Rate of each quantity, which must be that of the goal for the quantity to last."""
REST_SPEED = 0.05
"""Speed relative to the goal below which a position counts as reached for good, m/s: 1 cm in a period."""
REST_SPIN = math.radians(5.0)
"""Angular rate relative to the goal below which an attitude counts as reached for good, rad/s. For the floating
platform at 5 Hz this means no spin at all, because one pulse changes it by 17 degrees/s."""


def aims(task: Task) -> frozenset[str]:
    """Quantities of a task's goal set, such as "position", "attitude", "velocity" and "spin".

    They are those with tolerances, and the rates that must be those of the goal for these to last.

    Raises:
        ConfigError: the task is a multi-task, which has no tolerances.
    """
    toleranced = task.tolerances().keys()
    return frozenset(toleranced) | {_RATES[name] for name in toleranced if name in _RATES}


def asks_rest(task: Task) -> bool:
    """Whether the goal set requires rest: the task has a tolerance of position or attitude, but none of its rate.

    Raises:
        ConfigError: the task is a multi-task, which has no tolerances.
    """
    return bool(aims(task) - task.tolerances().keys())


def arrived(task: Task, states: Any, goals: Any) -> np.ndarray:
    """Whether states are in the goal set: within the task's tolerances, and at rest if `asks_rest`.

    The set is that of certified bounds. Where `aims` adds velocity or spin, their
    tolerances are `REST_SPEED` and `REST_SPIN`.

    Args:
        task: task.
        states: states with fields (T + 1, N).
        goals: goals with fields (N,).
    """
    inside = task.reached(states, goals)
    added = aims(task) - task.tolerances().keys()
    if "velocity" in added:
        inside = inside & ((goals.v - states.v).norm() <= REST_SPEED)
    if "spin" in added:
        spin = [a - b for a, b in zip(goals.spin(), states.spin(), strict=True)]
        inside = inside & (np.linalg.norm(np.broadcast_arrays(*spin), axis=0) <= REST_SPIN)
    return np.asarray(inside)
