"""Formulas of problems: numbers, names, arithmetic and a few functions, of numbers, arrays or nodes of a tape."""

from __future__ import annotations

import ast
import functools
import math
import operator
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from rans.extend import ConfigError, brief

FUNCTIONS = ("sin", "cos", "tan", "exp", "sqrt")
"""Functions of one argument that formulas may have."""
_SIGNS: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_DEEPEST = 50
"""Operations within operations at most, which is fewer than the checker reads; a + b + c has two."""
_MOST_NODES = 20_000
"""Operations of a tape at most."""


def formula_value(text: str, values: Mapping[str, Any]) -> Any:
    """Value of a formula; no other syntax than a formula's is executed.

    Among nodes of a tape an operation on literals is a node, too: what a float would round is not lost unseen.

    Args:
        text: numbers, names, +, -, *, /, brackets and `FUNCTIONS`.
        values: value of each name: numbers, arrays, or objects with these operators and a method
            ``function(name)``.

    Raises:
        ConfigError: the text is something else.
    """
    return _value(_tree(text), values, text, 0)


def _literal(value: Any, values: Mapping[str, Any]) -> Any:
    """A float of a formula as a node of the tape of its names; all else, and a float without a tape, as it is."""
    node = next((x.tape.node for x in values.values() if isinstance(x, Node)), float)
    return node(value) if isinstance(value, float) else value


@functools.lru_cache(maxsize=256)
def _tree(text: str) -> ast.expr:
    """Syntax tree of a formula.

    Comments and other letters than ASCII's, which Python reads as these, are refused: texts are what is printed.
    """
    if "#" in text or not text.isascii():
        raise ConfigError(f"{brief(text)} has a comment or a letter that no formula has.")
    try:
        return ast.parse(text, mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ConfigError(f"{brief(text)} is no formula.") from None


def _value(node: ast.expr, values: Mapping[str, Any], text: str, depth: int) -> Any:
    """Value of a part of a formula's syntax tree, at a depth of it.

    The prover computes numbers, arrays and forms by it. The checker has a reader of its own
    (`rans_proof.check_motion`).
    """
    if depth > _DEEPEST:
        raise ConfigError(
            f"{brief(text)} has more than {_DEEPEST} operations within operations: a sum or product of many parts "
            "is read as such, unless it has brackets, as (a + b) + (c + d)."
        )

    def inner(operand: ast.expr) -> Any:
        return _value(operand, values, text, depth + 1)

    match node:
        case ast.Constant(value=int() | float() as number) if (
            type(number) is not bool and abs(number) < 1e300
        ):
            if float(number) != number:
                raise ConfigError(
                    f"{brief(text)} has the whole number {number}, which no double is: write it with a point, as "
                    f"{float(number)!r}."
                )
            return float(number)
        case ast.Name(id=name) if name in values:
            value = values[name]
            return float(value) if isinstance(value, int) else value
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -inner(operand)
        case ast.BinOp(op=op) if type(op) in _SIGNS:
            first, second = inner(node.left), inner(node.right)
            if type(op) is ast.Div and isinstance(second, float) and second == 0.0:
                raise ConfigError(f"{brief(text)} divides by 0.")
            if isinstance(second, float):
                first = _literal(first, values)
            return _SIGNS[type(op)](first, second)
        case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in FUNCTIONS:
            return _function(name, _literal(inner(argument), values), text)
    raise ConfigError(
        f"{brief(text)} is no formula of a problem: those have numbers, {', '.join(values)}, +, -, *, /, brackets, "
        f"and {', '.join(FUNCTIONS)} of one argument."
    )


def _function(name: str, argument: Any, text: str) -> Any:
    """A function of a number, an array, or an object that has functions of its own."""
    if isinstance(argument, float):
        try:
            return float(getattr(math, name)(argument))
        except (ValueError, OverflowError):
            raise ConfigError(
                f"{brief(text)} has {name} of {argument:g}, which is no number."
            ) from None
    if isinstance(argument, np.ndarray):
        return getattr(np, name)(argument)
    return argument.function(name)


class Tape:
    """Operations of formulas in the order in which they are computed; equal ones are computed once."""

    def __init__(self, width: int) -> None:
        self.operations: list[tuple[Any, ...]] = []
        self._numbers: dict[tuple[Any, ...], int] = {}
        self.variables = [self.add("variable", k) for k in range(width)]

    def add(self, *operation: Any) -> Node:
        """The node of an operation: its name, and numbers of nodes or a constant."""
        if operation not in self._numbers:
            if len(self.operations) >= _MOST_NODES:
                raise ConfigError(f"the plant has more than {_MOST_NODES:,} operations.")
            self._numbers[operation] = len(self.operations)
            self.operations.append(operation)
        return Node(self, self._numbers[operation])

    def node(self, value: Any) -> Node:
        """The node of a number, or of a node."""
        return value if isinstance(value, Node) else self.add("constant", float(value))


class Node:
    """Result of an operation on a tape."""

    def __init__(self, tape: Tape, number: int) -> None:
        self.tape = tape
        self.number = number

    def __add__(self, other: Any) -> Node:
        return self.tape.add("sum", self.number, self.tape.node(other).number)

    __radd__ = __add__

    def __neg__(self) -> Node:
        return self.tape.add("multiple", self.number, -1.0)

    def __sub__(self, other: Any) -> Node:
        return self + -self.tape.node(other)

    def __rsub__(self, other: Any) -> Node:
        return -self + other

    def __mul__(self, other: Any) -> Node:
        if isinstance(other, Node):
            return self.tape.add("product", self.number, other.number)
        return self.tape.add("multiple", self.number, float(other))

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Node:
        return self * self.tape.node(other).function("inverse")

    def __rtruediv__(self, other: Any) -> Node:
        return other * self.function("inverse")

    def function(self, name: str) -> Node:
        """The value of a function at this node: one of `FUNCTIONS`, or the inverse, 1 over it."""
        if name == "tan":
            return self.function("sin") / self.function("cos")
        if name in ("sin", "cos"):  # the coefficients of each follow from those of the other
            both = self.tape.add("turn", self.number)
            return self.tape.add(name, both.number)
        return self.tape.add(name, self.number)
