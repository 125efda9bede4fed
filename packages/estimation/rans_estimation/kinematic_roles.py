"""Dependence of an observation's columns on the motion, measured on a task's example state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rans.extend import (
    AngularVelocity,
    Columns,
    ConfigError,
    Dimension,
    Layout,
    ObservationTerm,
    RelativeRotation,
    State,
    Task,
    VectorInW,
    example_state,
)

POSITION = 0
VELOCITY = 1
SPIN = 2
"""Components of a `Sensitivity`."""

Sensitivity = tuple[float, float, float]
"""Change of a block of columns by one unit of position, velocity and angular velocity, in that order.

At most one of the three is not zero: a block is a position, a velocity, an angular velocity, or none of them.
"""
_CONSTANT: Sensitivity = (0.0, 0.0, 0.0)


def sensitivities(task: Task, body: Layout, dimension: Dimension) -> list[Sensitivity]:
    """Sensitivity of each block of an observation in the body frame; zeros for the relative rotation.

    Args:
        task: whose data follow the velocities and the task flag.
        body: layout of the whole observation (`Layout.body`).
        dimension: of the motion.

    Raises:
        ConfigError: a block mixes position, velocity and angular velocity, or is none of them but changes.
    """
    state, goal = example_state(task, dimension)
    states = state, *(_nudged(state, name) for name in ("p", "v", "w"))
    data = zip(*(task.observation_terms(each, goal) for each in states), strict=True)
    result = [
        (0.0, 1.0, 0.0),
        (0.0, 0.0, 1.0),
        _CONSTANT,
        *(_sensitivity(term, nudged) for term, *nudged in data if term.block() in body.blocks),
    ]
    return result + [_CONSTANT] * (len(body.blocks) - len(result))


def _nudged(state: State, name: str) -> State:
    """The state (of numbers) with one quantity larger by 1 along its first axis, to see which columns follow it."""
    value = getattr(state, name)
    return replace(
        state,
        **{
            name: value + type(value)(1.0, *(0.0,) * (len(value.columns()) - 1))
            if hasattr(value, "columns")
            else value + 1.0
        },
    )


def _sensitivity(term: ObservationTerm, nudged: Sequence[ObservationTerm]) -> Sensitivity:
    """Growth of a term's first column when position, velocity and angular velocity are nudged.

    Raises:
        ConfigError: other columns move too, or the term is not linear in just one of the three.
    """
    if isinstance(term, RelativeRotation):
        return _CONSTANT
    # Growth of the first column, and whether the others stay.
    first, *others = (np.asarray(x, float) for x in term.columns())
    growth = [
        float(np.round(np.asarray(moved_term.columns()[0], float) - first, 9).reshape(-1)[0])
        for moved_term in nudged
    ]
    others_stay = all(
        np.allclose(np.asarray(after, float), before)
        for moved_term in nudged
        for before, after in zip(others, moved_term.columns()[1:], strict=True)
    )
    # A vector may grow with position or velocity, an angular velocity with spin, and nothing else with any.
    allowed_growth = (
        growth[:2]
        if isinstance(term, VectorInW)
        else growth[2:]
        if isinstance(term, AngularVelocity)
        else []
    )
    has_role = others_stay and len(nonzero(growth)) <= 1 and any(growth) == any(allowed_growth)
    if term.block().choices or not has_role:
        raise ConfigError(
            f"filters cannot follow the observed {term.name!r}: it is neither a place, a "
            "velocity nor an angular velocity, but changes with them. Train without "
            "filters, or let the task show it otherwise."
        )
    return growth[0], growth[1], growth[2]


def nonzero(sensitivity: Sequence[float]) -> list[int]:
    """Those of `POSITION`, `VELOCITY` and `SPIN` that change a block: none of them, or a single index."""
    return [k for k, factor in enumerate(sensitivity) if factor]


def in_units_of(
    quantity: int, values: Sequence[Columns], sensitivities: Sequence[Sensitivity]
) -> Columns:
    """Columns of the first block that changes with a quantity, divided by its sensitivity.

    Args:
        quantity: `POSITION`, `VELOCITY` or `SPIN`.
        values: columns of every block.
        sensitivities: that of every block.

    Returns:
        The quantity in m, m/s or rad/s in B; zeros if no block changes with it.
    """
    for columns, sensitivity in zip(values, sensitivities, strict=True):
        if sensitivity[quantity]:
            return [x * (1.0 / sensitivity[quantity]) for x in columns]
    return [0.0] * len(values[0])
