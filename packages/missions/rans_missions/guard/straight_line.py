"""Functions of a few spacecraft as straight-line Python: traced once, and then run without the fields' overhead.

NumPy takes about a microsecond for an operation on one number, and a tree of fields as much again; Python takes
30 ns. A filtered step of one spacecraft has tens of thousands of operations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import repeat
from typing import Any

import numpy as np

from rans.model.fields import leaves, unflatten
from rans.model.trace import UNTRACEABLE, Symbol, Untraceable, ordered
from rans_missions.guard.rows import is_array

ROWS = 32
"""Largest number of spacecraft for which numbers are used; the 17 manoeuvres of a craft in space are some."""
_INFIX = ("+", "-", "*", "<", "<=", ">", ">=", "==", "!=", "&", "|", "^")


def _over(a: float, b: float) -> float:
    """Quotient as NumPy's: infinite or not a number over zero, which has a sign."""
    return a / b if b else a * math.copysign(math.inf, b)


def _root(x: float) -> float:
    """Square root as NumPy's: not a number below zero."""
    return math.sqrt(x) if x >= 0.0 else math.nan


def _floor(x: float) -> float:
    return float(math.floor(x))


_NUMBERS: dict[str, Callable[..., Any]] = {
    "abs": abs,
    "floor": _floor,
    "sqrt": _root,
    "real": float,
    "/": _over,
    **{
        name: getattr(math, name) for name in ("sin", "cos", "exp", "log", "log1p", "tanh", "atan2")
    },
}
_CHOICES = {
    "where": "{1} if {0} else {2}",
    "minimum": "{0} if {0} < {1} or {0} != {0} else {1}",
    "maximum": "{0} if {0} > {1} or {0} != {0} else {1}",
}
"""Expressions of operations on Python numbers, without a call. A NaN stays one, as in NumPy: a filter must not take
it for a margin."""
_ARRAYS: dict[str, Callable[..., Any]] = {
    "real": partial(np.asarray, dtype=np.float64),
    "/": np.divide,
    **{
        name: getattr(np, name)
        for name in (
            *("abs", "minimum", "maximum", "floor", "sqrt", "where"),
            *("sin", "cos", "exp", "log", "log1p", "tanh"),
        )
    },
    "atan2": np.arctan2,
}


class StraightLine:
    """A function of trees of fields as straight-line Python.

    Args:
        function: what it computes: a tree from trees of real numbers, by arithmetic alone.
        trees: examples of its arguments.

    Raises:
        Untraceable: it does more than arithmetic on real numbers.
    """

    def __init__(self, function: Callable[..., Any], *trees: Any) -> None:
        inputs = [Symbol.input(f"field_{k}") for k in range(len(leaves(trees)))]
        try:
            self._result = function(*unflatten(trees, inputs))
            outputs = [Symbol.constant(x) for x in leaves(self._result)]
            texts = ["\n    ".join(_lines(inputs, outputs, choices)) for choices in (_CHOICES, {})]
        except (*UNTRACEABLE, ArithmeticError, ValueError) as error:
            raise Untraceable(str(error)) from error
        # The text consists of names that are numbered here and of numbers.
        self._of_numbers, self._of_arrays = (
            _defined(f"def run({', '.join(_names(inputs))}):\n    {text}\n", functions)
            for text, functions in zip(texts, (_NUMBERS, _ARRAYS), strict=True)
        )

    def of_rows(self, *trees: Any) -> Any | None:
        """Result for rows (N,) of float64 in NumPy, or numbers for all; None: some are outside its domain."""
        columns = leaves(trees)
        size = max(len(x) for x in columns if is_array(x))
        rows = zip(
            *(
                x.tolist()
                if is_array(x) and len(x) == size
                else repeat(x.item() if is_array(x) else x, size)
                for x in columns
            ),
            strict=True,
        )
        try:
            results = [self._of_numbers(*row) for row in rows]
        except (ArithmeticError, ValueError):
            return None
        matrix = np.ascontiguousarray(np.array(results, np.float64).T)
        return unflatten(self._result, list(matrix))

    def of_arrays(self, *trees: Any) -> Any:
        """Result for arrays that broadcast against each other."""
        return unflatten(self._result, list(self._of_arrays(*leaves(trees))))


def few(state: Any) -> bool:
    """Whether a state is of few spacecraft in double precision, (N,)."""
    x = state.p.columns()[0]
    return type(x) is np.ndarray and x.dtype == np.float64 and x.ndim == 1 and len(x) <= ROWS


def _names(symbols: Sequence[Symbol]) -> list[str]:
    return [f"_{k}" for k in range(len(symbols))]


def _lines(
    inputs: Sequence[Symbol], outputs: Sequence[Symbol], choices: dict[str, str]
) -> Iterator[str]:
    """Statements of the function's body."""
    names = dict(zip(inputs, _names(inputs), strict=True))
    for symbol in ordered(outputs):
        if symbol.kind == "int":
            raise Untraceable("whole numbers have 32 bits in a program, and in Python any number.")
        if symbol.operation == "constant":
            # In brackets, since a negative number begins with a sign; infinity has no literal.
            names[symbol] = (
                f"float('{symbol.value!r}')" if _odd(symbol.value) else f"({symbol.value!r})"
            )
        elif symbol.args:
            args = [names[arg] for arg in symbol.args]
            names[symbol] = f"_{len(names)}"
            yield f"{names[symbol]} = {_expression(symbol.operation, args, choices)}"
    yield f"return ({''.join(f'{names[x]}, ' for x in outputs)})"


def _odd(value: Any) -> bool:
    return isinstance(value, float) and not math.isfinite(value)


def _expression(operation: str, args: Sequence[str], choices: dict[str, str]) -> str:
    if operation in choices:
        return choices[operation].format(*args)
    if operation in _INFIX:
        return f" {operation} ".join(args)
    if operation == "neg":
        return f"-{args[0]}"
    if operation not in _NUMBERS and operation not in _CHOICES:
        raise Untraceable(f"numbers have no operation {operation!r}.")
    if operation == "/":
        return f"over({', '.join(args)})"
    return f"{operation}({', '.join(args)})"


def _defined(text: str, functions: dict[str, Callable[..., Any]]) -> Callable[..., Any]:
    scope: dict[str, Any] = {name: function for name, function in functions.items() if name != "/"}
    scope["over"] = functions["/"]
    exec(compile(text, "<traced>", "exec"), scope)
    return scope["run"]
