"""Goal set of a task: states within its tolerances, and at rest relative to a goal position or attitude."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from rans.errors import ConfigError
from rans.model.fields import Heading, Quat, Vec3
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


_TRIED = 256
"""States tried for each tolerance: a direction that a task leaves free in space is near some of them."""


def check_errors(task: Task) -> None:
    """Refuse a task that counts as reached what is beyond a tolerance, such as all places along a line.

    Bounds are for errors that are the whole distance to the goal, the whole angle of the rotation to it, or the
    whole relative velocity or spin.

    Raises:
        ConfigError: a state is reached, although one of these is larger than its tolerance.
    """
    for dimension in dimensions(task):
        start, goal = example_state(task, dimension)
        at_goal = replace(start, p=goal.p, attitude=goal.attitude, v=goal.v, w=goal.w)
        random = np.random.default_rng(0)
        for name, tolerance in task.tolerances().items():
            if name not in (*_RATES, *_RATES.values()):
                continue
            # Away from the goal by a little or by much, any way; along each axis too, and nothing else changes.
            turns = 1 if dimension == 2 else 3
            axes = turns if name in ("attitude", "spin") else dimension
            ways = random.normal(size=(axes, _TRIED))
            ways[:, : 2 * axes] = np.hstack([np.eye(axes), -np.eye(axes)])
            ways /= np.linalg.norm(ways, axis=0)
            sizes = tolerance * (1.01 + 10.0 ** random.uniform(-2.0, 2.0, _TRIED))
            if name == "attitude":
                # Half a turn is the largest angle.
                sizes = np.minimum(sizes, math.pi)
                if sizes.min() <= tolerance:
                    continue
            state = _displaced(at_goal, name, ways * sizes)
            if np.any(np.broadcast_to(task.reached(state, goal), _TRIED)):
                raise ConfigError(
                    f"bounds are for errors that are the whole distance to the goal; {type(task).__name__} counts "
                    f"as reached what is farther from its goal than its tolerance of {name}, {tolerance:g}."
                )


def _displaced(state: Any, name: str, off: np.ndarray) -> Any:
    """A state with one quantity changed by vectors (axes, N): places, velocities, rotation vectors or spins."""
    if name in ("position", "velocity"):
        key = name[0]
        vector = getattr(state, key)
        moved = (x + y for x, y in zip(vector.columns(), off, strict=True))
        return replace(state, **{key: type(vector)(*moved)})
    if len(off) == 1:
        if name == "spin":
            return replace(state, w=state.w + off[0])
        return replace(state, attitude=Heading(state.attitude.angle + off[0]))
    if name == "spin":
        return replace(state, w=state.w + Vec3(*off))
    half = 0.5 * np.linalg.norm(off, axis=0)
    turn = Quat(np.cos(half), *(0.5 * off * np.sinc(half / np.pi)))
    return replace(state, attitude=state.attitude.times(turn))
