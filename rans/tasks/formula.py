"""Formulas of rewards as text, from evaluating a task's functions on symbols."""

from __future__ import annotations

import contextlib
import copy
import math
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rans.model.dynamics import State
from rans.model.fields import Field, map_leaves
from rans.model.trace import UNTRACEABLE, Symbol
from rans.tasks.base import Task, reward_terms
from rans.tasks.derived import example_state
from rans.tasks.observation_terms import Dimension
from rans.tasks.rewards import Transition

OPEN = "open"
BEFORE = "open_before"
"""Names of the number of open thrusters, now and in the step before; errors have the names of the task."""
OF_STATE = "of state and goal beside the errors, see the task"
"""Text in place of a formula with unnamed numbers or with more operations than `_MOST`."""
_MOST = 5000
_UNNAMED = re.compile(r"(goal_)?x\d+")
_SUM = 1
_PRODUCT = 2
_WHOLE = 3
"""Binding strength of the outermost operation of a text."""


def reward_formulas(task: Task, dimension: Dimension = 2) -> dict[str, str]:
    """Formula of every term of the reward of a task, in its errors and `OPEN`; empty if it is not traceable.

    A term that reads other numbers of state and goal is `OF_STATE`.

    >>> from rans.tasks.formula import reward_formulas
    >>> reward_formulas(rans.GoToPose())["approach"]
    '0.5 exp(-position / 1.5)'
    """
    try:
        state, goal = (
            _named(example, name)
            for example, name in zip(example_state(task, dimension), ("", "goal_"), strict=True)
        )
        observed = {
            entry.value: Symbol.input(entry.name)
            for entry in task.observation_terms(state, goal)
            if isinstance(entry.value, Symbol)
        }
        notes = map_leaves(lambda note: observed.get(note, note), goal.notes)
        goal = replace(goal, notes=notes)
        errors = {name: Symbol.input(name) for name in task.errors(state, goal)}
        named = copy.copy(task)
        object.__setattr__(named, "errors", lambda _state, _goal: dict(errors))
        terms = reward_terms(
            named,
            Transition(
                state, goal, (Symbol.input(OPEN),), (Symbol.input(BEFORE),), state, 1.0, (1.0,)
            ),
            None,
            None,
        )
    except UNTRACEABLE:
        _compute(task, dimension)
        return {}
    symbols = {name: Symbol.constant(term) for name, term in terms.items()}
    return {
        name: _text(symbol) if _length(symbol, {}) <= _MOST else OF_STATE
        for name, symbol in symbols.items()
    }


def _compute(task: Task, dimension: Dimension) -> None:
    """Compute a reward with numbers: what raises there too is a mistake in the task.

    A task that computes one episode but not two, because it converts a field to a number, is none.
    """

    def compute(form: Callable[[float], Field]) -> None:
        state, goal = (map_leaves(form, example) for example in example_state(task, dimension))
        command = (form(0.0),)
        task.observation_terms(state, goal)
        task.reward(Transition(state, goal, command, command, state, 1.0, (1.0,)))

    compute(lambda x: float(np.ravel(x)[0]))
    with contextlib.suppress(*UNTRACEABLE):
        compute(lambda x: np.zeros(2) + x)


def _length(symbol: Symbol, lengths: dict[int, float]) -> float:
    """Number of operations in the text of a formula, which repeats shared symbols; inf if an input has no name."""
    if symbol.serial not in lengths:
        unnamed = symbol.operation == "input" and _UNNAMED.fullmatch(str(symbol.value))
        parts = sum(_length(part, lengths) for part in symbol.args)
        lengths[symbol.serial] = math.inf if unnamed else 1.0 + parts
    return lengths[symbol.serial]


def _named(state: State, prefix: str) -> State:
    count = iter(range(1000))
    return map_leaves(lambda _: Symbol.input(f"{prefix}x{next(count)}"), state)


def _text(symbol: Symbol, within: int = 0, divided: bool = False) -> str:
    """Text of a symbol, in brackets if the enclosing operation binds tighter; if divided, x / 2 for 0.5 x."""
    text, strength = _text_and_strength(symbol, divided)
    return f"({text})" if strength < within else text


def _text_and_strength(symbol: Symbol, divided: bool) -> tuple[str, int]:
    """Text of a symbol, and how strongly it binds, which decides on parentheses."""
    if symbol.operation == "input":
        return str(symbol.value), _WHOLE
    if symbol.operation == "constant":
        return f"{symbol.value:.4g}", _WHOLE if symbol.value >= 0 else _SUM
    first = symbol.args[0]
    last = symbol.args[-1]
    match symbol.operation:
        case "neg":
            return f"-{_text(first, _PRODUCT, divided)}", _SUM
        case "+" | "-" as sign:
            return (
                f"{_text(first, _SUM)} {sign} {_text(last, _PRODUCT if sign == '-' else _SUM)}",
                _SUM,
            )
        case "*" if "constant" in (first.operation, last.operation):
            factor, rest = (first, last) if first.operation == "constant" else (last, first)
            return _times(float(factor.value), rest, divided)
        case "*" | "/" as sign:
            return f"{_text(first, _PRODUCT)} {sign} {_text(last, _WHOLE)}", _PRODUCT
        case "abs":
            return f"|{_text(first)}|", _WHOLE
        case "exp":
            return f"exp({_text(first, divided=True)})", _WHOLE
    return f"{symbol.operation}({', '.join(map(_text, symbol.args))})", _WHOLE


def _times(factor: float, rest: Symbol, divided: bool) -> tuple[str, int]:
    """Text of a product with a number, and how strongly it binds, which decides on parentheses."""
    sign = "-" if factor < 0 else ""
    size = abs(factor)
    if size == 0.5 and (beyond := _half_of(rest)) is not None:
        return f"{sign}max({_text(beyond)}, 0)", _SUM if sign else _WHOLE
    if divided:
        return f"{sign}{_text(rest, _PRODUCT)} / {1.0 / size:.4g}", _SUM if sign else _PRODUCT
    return f"{sign}{size:.4g} {_text(rest, _PRODUCT)}", _SUM if sign else _PRODUCT


def _half_of(total: Symbol) -> Symbol | None:
    """The symbol x of a sum x + |x|, which is twice the positive part of x; None for other symbols."""
    if total.operation != "+":
        return None
    a, b = total.args if total.args[1].operation == "abs" else total.args[::-1]
    return a if b.operation == "abs" and b.args[0] is a else None
