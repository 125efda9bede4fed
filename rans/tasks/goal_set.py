"""The goal set of a task: what it asks for, and at rest where that is to last."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rans.tasks.base import Task

_RATES = {"position": "velocity", "attitude": "spin"}
"""Who is to stay somewhere must not move, who is to keep an attitude must not turn."""
REST_SPEED = 0.05
"""A position counts as arrived at only below this speed relative to the goal's, m/s: 1 cm in a period."""
REST_SPIN = math.radians(5.0)
"""An attitude counts as arrived at only below this rate relative to the goal's, rad/s. For the floating
platform at 5 Hz it means no spin at all, as one pulse is worth 17 degrees/s."""


def aims(task: Task) -> frozenset[str]:
    """What a task asks for: "position", "attitude", "velocity", "spin".

    The quantities it has tolerances for, and the rates that must be the goal's for these to stay.

    Raises:
        ConfigError: a multi-task has no goal of its own.
    """
    wanted = task.tolerances().keys()
    return frozenset(wanted) | {_RATES[name] for name in wanted if name in _RATES}


def asks_rest(task: Task) -> bool:
    """Whether the goal set asks for rest: the task names a place or an attitude, but no rate of its own.

    Raises:
        ConfigError: a multi-task has no goal of its own.
    """
    return bool(aims(task) - task.tolerances().keys())


def arrived(task: Task, states: Any, goals: Any) -> np.ndarray:
    """Whether states are in the goal set: within the task's tolerances, and at rest where it has a place.

    The set is that of `rans.evaluation.compare.bounds.goal_set`: where `aims` adds velocity or spin, their
    tolerances are `REST_SPEED` and `REST_SPIN`. States have fields (T + 1, N), goals (N,).
    """
    inside = task.reached(states, goals)
    added = aims(task) - task.tolerances().keys()
    if "velocity" in added:
        inside = inside & ((goals.v - states.v).norm() <= REST_SPEED)
    if "spin" in added:
        spin = [a - b for a, b in zip(goals.spin(), states.spin(), strict=True)]
        inside = inside & (np.linalg.norm(np.broadcast_arrays(*spin), axis=0) <= REST_SPIN)
    return np.asarray(inside)
