"""What the columns of an observation mean, and between which numbers an agent knows them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass
from itertools import groupby
from operator import itemgetter
from typing import Any

import numpy as np

from rans.base.errors import ConfigError
from rans.model.dynamics import State
from rans.model.fields import Field, Vec3, leaves
from rans.tasks.base import Task
from rans.tasks.derived import example, observation_width
from rans.tasks.observation_terms import (
    Dimension,
    ObservationTerm,
    RelativeRotation,
    Scalar,
    TradeOff,
)
from rans.tasks.tracking import spin_difference

MARGIN = 0.1
"""Share of a column's range on flights by which its valid range is wider on either side."""

OUTLIERS = 1e-3
"""Share of the flights that a column's valid range leaves out on either side."""


_WRITTEN = {
    "own attitude, R_WB": "own.R{0}",
    "v_WB, own": "own.v{0}",
    "own angular velocity": "own.w{0}",
    "p_WG - p_WB": "goal.p{0} - own.p{0}",
    "p_WB - p_WG": "own.p{0} - goal.p{0}",
    "v_WG - v_WB": "goal.v{0} - own.v{0}",
    "w_WG - w_WB": "goal.w{0} - own.w{0}",
    "R_WB^T R_WG": "turn{0}",
    "v_WG, velocity": "goal.v{0}",
    "unused": "0.0",
}
"""Quantities of motion by how their meaning begins, as `written_columns` has them."""


def left_out(flights: int) -> int:
    """Number of flights that a column's valid range leaves out on either side.

    One flight among thousands may lose control and spin several times as fast as all others, without failing by
    the task's rules. A range that includes it says nothing about what the agent was tried on.
    """
    return round(OUTLIERS * flights)


def column_meanings(task: Task, state: State, goal: State) -> list[str]:
    """What each column of the observation is of a spacecraft's state and its goal; "" where that is not known.

    It is not read from names but tried: a column has a meaning if it equals it on all of the states. Columns
    that equal none of the known ones have the meaning that the task declares (`ObservationTerm.meaning`).

    Args:
        task: whose observation it is.
        state: of arrays (N,), with every quantity different in each.
        goal: of arrays (N,).
    """
    quantities_by_name = _quantities(state, goal)
    own = {
        "v_WB, own velocity": state.v.columns(),
        "own angular velocity, w_WB_B": state.spin(),
        "own attitude, R_WB: cos and sin of the heading, or the first two rows": (
            state.attitude.columns()
        ),
    }
    results = [
        *_named(state.attitude.columns(), own),
        *_named(state.v.columns(), own),
        *_named(state.spin(), own),
        "task flag",
    ]
    for entry in task.observation_terms(state, goal):
        columns = entry.columns()
        if isinstance(entry, TradeOff):
            results += ["trade-off input, 0 to 1"]
        else:
            texts = _named(columns, quantities_by_name)
            results += [meaning or entry.meaning for meaning in texts]
    dimension = 3 if isinstance(state.w, Vec3) else 2
    missing = observation_width(task, dimension) - len(results)
    return [*results, *["unused"] * missing]


def written_columns(about: Mapping[str, Any]) -> list[str]:
    """An expression for every column of a contract's observation, in Python and C alike.

    It is of ``own`` and ``goal``, each with p, v, w (three numbers, SI units; p and v in W, w in B of the
    spacecraft) and R, the rotation matrix R_WB or R_WG, and of ``turn``, which is R_WB^T R_WG.

    Raises:
        ConfigError: a column is of something else, or several tasks are observed in the same columns.
    """
    columns = about["observation"]
    if len(about["tasks"]) > 1:
        raise ConfigError("a module in other software flies one task, and this agent has several.")
    known = _WRITTEN | {"task flag": repr(float(about["tasks"][0]["flag"]))}
    # The plane has x, y, the spin about z and the first column of a rotation matrix, space its first two rows.
    planar = columns[2]["unit"] == "m/s"
    vector = [f"[{i}]" for i in range(3)]
    matrix = [f"[{j}][{i}]" if planar else f"[{i}][{j}]" for i in range(3) for j in range(3)]
    places = {"-": matrix, "rad/s": vector[2 * planar :]}
    result = []
    for (meaning, unit), same in groupby(columns, itemgetter("meaning", "unit")):
        written = next((known[begin] for begin in known if meaning.startswith(begin)), None)
        if written is None:
            raise ConfigError(
                "messages of other software do not hold what this agent observes: "
                f"{meaning or 'an unnamed quantity'}. Export it as numpy or c, and compute its observation."
            )
        result += [
            written.format(at) for at, _ in zip(places.get(unit, vector), same, strict=False)
        ]
    return result


def _quantities(state: State, goal: State) -> dict[str, Sequence[Field]]:
    """What a task may let a policy observe of state and goal, in words, with the columns of each.

    Only these are looked for in a task's columns, in this order.
    """
    offset = (goal.p - state.p).columns()
    return {
        "p_WG - p_WB: position of the goal minus own": offset,
        "p_WB - p_WG: own position minus the goal's": [-x for x in offset],
        "v_WG - v_WB: velocity of the goal minus own": (goal.v - state.v).columns(),
        "w_WG - w_WB in B: angular velocity of the goal minus own": spin_difference(state, goal),
        "R_WB^T R_WG: cos and sin of the goal's heading minus own; in space the first two rows, whose "
        "columns are the goal's axes as the spacecraft sees them": (
            state.attitude.to(goal.attitude).columns()
        ),
        "R_WG^T R_WB: the inverse of the rotation to the goal": (
            goal.attitude.to(state.attitude).columns()
        ),
        "v_WG, velocity of the goal": goal.v.columns(),
    }


def _named(columns: Sequence[Field], meanings: Mapping[str, Sequence[Field]]) -> list[str]:
    """One meaning for all of an entry's columns."""
    for meaning, values in meanings.items():
        if len(values) == len(columns) and all(
            np.allclose(a, b, rtol=0.0, atol=1e-9) for a, b in zip(columns, values, strict=True)
        ):
            return [meaning] * len(columns)
    return [""] * len(columns)


def valid_ranges(task: Task, dimension: Dimension, seen: np.ndarray) -> list[tuple[float, float]]:
    """Least and largest number of each column that an agent knows, from observations (T, N, width) of flights.

    Directions are known all around, [-1, 1], and a trade-off input from 0 to 1; a flag has the values that
    it had. Every other column has the range that it had, without the `left_out` flights that reached lowest and
    those that reached highest, and `MARGIN` of that more on either side.
    """
    ignored = left_out(seen.shape[1])
    lows = np.sort(seen.min(axis=0), axis=0)[ignored].astype(float)
    highs = np.sort(seen.max(axis=0), axis=0)[-1 - ignored].astype(float)
    ranges: list[tuple[float, float]] = []
    for entry in example(task, dimension).terms:
        for _ in entry.columns():
            low = lows[len(ranges)]
            high = highs[len(ranges)]
            more = MARGIN * (high - low)
            ranges.append(_known_range(entry, low, high, more))
    return ranges


def _known_range(
    entry: ObservationTerm, low: float, high: float, more: float
) -> tuple[float, float]:
    """Range of a column in training, widened by ``more`` unless its kind of term bounds it.

    Exported agents refuse or shut by it: too narrow stops flights that are fine.
    """
    if isinstance(entry, TradeOff):
        return 0.0, 1.0
    if isinstance(entry, RelativeRotation):
        return -1.0, 1.0
    if type(entry) is Scalar and entry.name in ("task flag", "unused"):
        return low, high
    return low - more, high + more


def refused_ranges(valid: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Beyond which a number is no reading but an error: three times as wide as the valid range."""
    result = []
    for low, high in valid:
        width = max(high - low, 1.0)
        result.append((low - width, high + width))
    return result


def state_quantities(state: State) -> dict[str, Any]:
    """One state of numbers as JSON: SI units, vectors in W but for the angular velocity in space, which is in B.

    The attitude is a heading in the plane, and in space a unit quaternion (w, x, y, z). Notes have their names: a
    number, or a list of the numbers of shapes, such as zones, each in the order of its definition.

    Contracts and golden pairs have these keys; other languages read them.
    """
    attitude: Any = state.attitude
    planar = not isinstance(state.w, Vec3)
    turn = [attitude.w, attitude.x, attitude.y, attitude.z] if not planar else [attitude.angle]
    spin = [float(x) for x in state.spin()]
    result: dict[str, Any] = {
        "position": [float(x) for x in state.p.columns()],
        "attitude": float(turn[0]) if planar else [float(x) for x in turn],
        "velocity": [float(x) for x in state.v.columns()],
        "spin": spin[0] if planar else spin,
    }
    if state.notes is not None:
        result["notes"] = {
            name: [float(x) for x in leaves(note)]
            if isinstance(note, tuple) or is_dataclass(note)
            else float(note)
            for name, note in vars(state.notes).items()
            if note is not None
        }
    if state.stores:
        result["stores"] = [float(x) for x in state.stores]
    return result
