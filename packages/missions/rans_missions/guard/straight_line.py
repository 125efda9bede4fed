"""Functions of a few spacecraft as straight-line Python: traced once, and then run without the fields' overhead.

NumPy takes about a microsecond for an operation on one number, and a tree of fields as much again; Python takes 30
ns. A filtered step of one spacecraft has tens of thousands of operations. A function must be branch-free
arithmetic; results are those of the fields bit by bit (`tests/guard/test_straight_line.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import repeat
from typing import Any

import numpy as np

from rans.extend import leaves
from rans.model.fields import unflatten
from rans.model.operations import NUMBERS, NUMPY, PYTHON, Dialect
from rans.model.trace import UNTRACEABLE, Symbol, Untraceable, ordered
from rans_missions.guard.rows import is_array

ROWS = 32
"""Largest number of spacecraft for which numbers are used; the 17 manoeuvres of a craft in space are some."""
_ARRAYS = {"np": np}
_SCALARS = {**NUMBERS, "over": NUMBERS["/"]}
"""Names in the texts of the two dialects."""


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
            texts = ["\n    ".join(_lines(inputs, outputs, each)) for each in (PYTHON, NUMPY)]
        except (*UNTRACEABLE, ArithmeticError, ValueError) as error:
            raise Untraceable(str(error)) from error
        # The text consists of names that are numbered here and of numbers.
        self._of_numbers, self._of_arrays = (
            _defined(f"def run({', '.join(_names(inputs))}):\n    {text}\n", functions)
            for text, functions in zip(texts, (_SCALARS, _ARRAYS), strict=True)
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


def _lines(inputs: Sequence[Symbol], outputs: Sequence[Symbol], dialect: Dialect) -> Iterator[str]:
    """Statements of the function's body, one an operation in order, in NumPy or in Python's own numbers."""
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
            text = dialect.text(symbol.operation, symbol.operand_kind, *args)
            if dialect is NUMPY and symbol.operation == "/":
                # Two operands may be numbers of Python's, which refuse to be divided by zero.
                text = f"np.divide({', '.join(args)})"
            yield f"{names[symbol]} = {text}"
    yield f"return ({''.join(f'{names[x]}, ' for x in outputs)})"


def _odd(value: Any) -> bool:
    return isinstance(value, float) and not math.isfinite(value)


def _defined(text: str, functions: Mapping[str, Any]) -> Callable[..., Any]:
    scope = dict(functions)
    exec(compile(text, "<traced>", "exec"), scope)
    return scope["run"]
