"""Which columns of an observation change with the motion, and how: found by moving a task's example."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rans.errors import ConfigError
from rans.model.dynamics import State
from rans.tasks.base import Task, typed_observation
from rans.tasks.derived import example_state
from rans.tasks.observation_terms import (
    AngularVelocity,
    Columns,
    Dimension,
    ObservationTerm,
    OwnRotation,
    RelativeRotation,
    TaskDependent,
    VectorInW,
)

Share = tuple[float, float, float]
"""Of a block of columns: how much it has of position, velocity and angular velocity."""


def shares(task: Task, dimension: Dimension) -> list[Share]:
    """How columns of the body's blocks change with position, velocity and angular velocity."""
    state, goal = example_state(task, dimension)
    entries = typed_observation(task, state, goal).terms
    moved = [_nudged(state, name) for name in ("p", "v", "w")]
    changed = [typed_observation(task, one, goal).terms for one in moved]
    return [
        (0.0, 0.0, 0.0) if issubclass(type(entry), RelativeRotation) else _share(entry, others)
        for entry, *others in zip(entries, *changed, strict=True)
        if not isinstance(entry, OwnRotation)
    ]


def _nudged(state: State, name: str) -> State:
    value = getattr(state, name)
    return replace(
        state,
        **{
            name: value + type(value)(1.0, *(0.0,) * (len(value.columns()) - 1))
            if hasattr(value, "columns")
            else value + 1.0
        },
    )


def _share(entry: ObservationTerm, others: Sequence[ObservationTerm]) -> Share:
    """Of one block: what its first column gains by one unit of each, if it is linear in only one of them."""
    first, *rest = (np.asarray(x, float) for x in entry.columns())
    results = [
        float(np.round(np.asarray(one.columns()[0], float) - first, 9).reshape(-1)[0])
        for one in others
    ]
    still = all(
        np.allclose(np.asarray(b, float), a)
        for one in others
        for a, b in zip(rest, one.columns()[1:], strict=True)
    )
    fits = (
        results[:2]
        if isinstance(entry, VectorInW)
        else results[2:]
        if isinstance(entry, AngularVelocity)
        else []
    )
    known = still and len(changing(results)) <= 1 and any(results) == any(fits)
    if isinstance(entry, TaskDependent) or not known:
        raise ConfigError(
            f"filters cannot follow the observed {entry.name!r}: it is neither a place, a "
            "velocity nor an angular velocity, but changes with them. Train without "
            "filters, or let the task show it otherwise."
        )
    return results[0], results[1], results[2]


def changing(share: Sequence[float]) -> list[int]:
    """Of position, velocity and angular velocity, which change a block: none, or one."""
    return [k for k, factor in enumerate(share) if factor]


def first_of(values: Sequence[Columns], shares: Sequence[Share], which: int) -> Columns:
    """Of the first block that has a share of it, in its units; zeros if there is none."""
    for mine, share in zip(values, shares, strict=True):
        if share[which]:
            return [x * (1.0 / share[which]) for x in mine]
    return [0.0] * len(values[0])
