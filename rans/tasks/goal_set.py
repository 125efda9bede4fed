"""Goal set of a task: states within its tolerances, and at rest relative to a goal position or attitude."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from rans.errors import ConfigError
from rans.tasks.base import Task
from rans.tasks.derived import dimensions, example_state

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

    The set is that of `rans.evaluation.compare.bounds.goal_set`. Where `aims` adds velocity or spin, their
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


_TRIED = 256
"""States tried for each tolerance: a direction that a task leaves free in space is near some of them."""


def check_errors(task: Task) -> None:
    """Refuse a task that counts as reached what is beyond a tolerance, such as all places along a line.

    Bounds are for errors that are the whole distance to the goal, or the whole relative velocity. Angles are not
    tried.

    Raises:
        ConfigError: a state is reached, although one of these is larger than its tolerance.
    """
    for dimension in dimensions(task):
        start, goal = example_state(task, dimension)
        at_goal = replace(start, p=goal.p, attitude=goal.attitude, v=goal.v, w=goal.w)
        random = np.random.default_rng(0)
        tolerances = {k: x for k, x in task.tolerances().items() if k in ("position", "velocity")}
        for name, tolerance in tolerances.items():
            # Away from the goal by a little or by much, any way; along each axis too, and nothing else changes.
            ways = random.normal(size=(dimension, _TRIED))
            ways[:, : 2 * dimension] = np.hstack([np.eye(dimension), -np.eye(dimension)])
            ways /= np.linalg.norm(ways, axis=0)
            off = ways * tolerance * (1.01 + 10.0 ** random.uniform(-2.0, 2.0, _TRIED))
            vector: Any = goal.v if name == "velocity" else goal.p
            moved = type(vector)(*(x + y for x, y in zip(vector.columns(), off, strict=True)))
            state = replace(at_goal, v=moved) if name == "velocity" else replace(at_goal, p=moved)
            if np.any(np.broadcast_to(task.reached(state, goal), _TRIED)):
                raise ConfigError(
                    f"bounds are for errors that are the whole distance to the goal; {type(task).__name__} counts "
                    f"as reached what is farther from its goal than its tolerance of {name}, {tolerance:g}."
                )
