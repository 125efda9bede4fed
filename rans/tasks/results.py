"""Results of the functions of a user's task, checked before an engine meets them."""

from __future__ import annotations

import contextlib
import inspect
import os
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from rans.base.errors import ConfigError
from rans.model.dynamics import State
from rans.model.fields import Attitude, Vector
from rans.model.random import Random
from rans.tasks.base import Task
from rans.tasks.observation_terms import ObservationTerm
from rans.tasks.rewards import Transition

_STATES = (
    "start and goal: `return start, goal`, two states as `random.around(1.0, 2.0)` and "
    "`random.at_rest(random.origin(), random.no_rotation())` make them"
)
_TERMS = 'a tuple of entries, such as (VectorInW("d", "m", goal.p - state.p),)'
_ERRORS = 'a dict of errors by name, such as {"position": (goal.p - state.p).norm()}'
_REWARDS = 'a dict of terms by name, such as {"position": nearness(error, 0.5)}'
_MARGINS = 'a dict of margins by name, such as {"wall": 3.0 - state.p.y}'
_TRUTH = "a truth value for each episode, such as state.p.norm() > 8.0"


def check_results(task: Task) -> None:
    """Reject a task of which a function returns no value of the kind that engines expect.

    The functions compute one episode. One that raises is not rejected here: whoever calls it for a purpose reports
    its file and line.

    Raises:
        ConfigError: a function has another kind of result; the message has the function's file and line.
    """
    for dimension in task.dimensions:
        episode = Random(dimension, 0, 0, np.zeros(1, dtype=np.int32), np.float64)
        with contextlib.suppress(Exception):  # a user's function may raise anything
            drawn = task.sample(episode)
            break
    else:
        return
    _require(task, "sample", drawn, _STATES, _are_states)
    state, goal = drawn
    shut = (state.p.x * 0.0,)
    transition = Transition(state, goal, shut, shut, state, 0.2, (1.0,))
    checks: tuple[tuple[str, tuple[Any, ...], str, Callable[[Any], bool]], ...] = (
        ("observation_terms", (state, goal), _TERMS, _are_terms),
        ("errors", (state, goal), _ERRORS, _are_named_fields),
        ("reward", (transition,), _REWARDS, _are_named_fields),
        ("constraints", (state, goal), _MARGINS, _are_named_fields),
        ("failed", (state, goal), _TRUTH, _is_field),
        ("done", (state, goal), _TRUTH, lambda done: done is None or _is_field(done)),
    )
    for name, arguments, must, holds in checks:
        try:
            result = getattr(task, name)(*arguments)
        except Exception:
            # The engine that calls the function reports what it raises, with its traceback.
            continue
        _require(task, name, result, must, holds)


def _require(task: Task, name: str, result: Any, must: str, holds: Callable[[Any], bool]) -> None:
    """Raise ConfigError with the file and line of a function whose result is of another kind."""
    if holds(result):
        return
    code = inspect.unwrap(getattr(type(task), name)).__code__
    got = "nothing, as it has no `return`" if result is None else type(result).__name__
    if type(result) is tuple:
        got = f"a tuple of {' and '.join(type(part).__name__ for part in result) or 'nothing'}"
    if isinstance(result, Mapping):
        wrong = [(key, value) for key, value in result.items() if not _is_field(value)]
        if wrong:
            got = f"{wrong[0][0]!r} with a {type(wrong[0][1]).__name__} in it"
    raise ConfigError(
        f"{os.path.basename(code.co_filename)}, line {code.co_firstlineno}: {type(task).__name__}.{name} must "
        f"return {must}, got {got}."
    )


def _are_states(result: Any) -> bool:
    return (
        isinstance(result, tuple)
        and len(result) == 2
        and all(isinstance(part, State) for part in result)
    )


def _are_terms(result: Any) -> bool:
    return isinstance(result, tuple | list) and all(
        isinstance(term, ObservationTerm) for term in result
    )


def _are_named_fields(result: Any) -> bool:
    return isinstance(result, Mapping) and all(map(_is_field, result.values()))


def _is_field(value: Any) -> bool:
    """Whether a value is a number for each episode: none of the kinds that are taken for one by mistake."""
    kinds = (Vector, Attitude, State, Mapping, str, list, tuple, type(None))
    return not isinstance(value, kinds)
