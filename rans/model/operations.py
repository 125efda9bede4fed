"""Operations of traced programs: what each computes, and its text in every language that programs are printed in.

Two notations share them. Symbols (`rans.model.trace`) know an operation by its sign or name here; rows of a
policy's program (`rans.policy.program`) by its name in ONNX (https://onnx.ai/onnx/operators). A language is a
`Dialect`: a rule for signs, a rule for functions, and what differs from both.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np

Kind = Literal["real", "int", "bool"]
"""Type of a number in a program. real: the engine's floating dtype; int: 32 bits with wrap-around."""
_NUMBERS: tuple[Kind, ...] = ("real", "int")
_REAL: tuple[Kind, ...] = ("real",)
_BITS: tuple[Kind, ...] = ("int", "bool")
_ANY: tuple[Kind, ...] = ("real", "int", "bool")


class Untraceable(TypeError):
    """Equations used a symbol in a way that needs a number, or a language lacks one of their operations."""


class Operation(NamedTuple):
    """One operation on single numbers."""

    arity: int
    meaning: Callable[..., Any]
    """What it computes, as a function of NumPy's."""
    kinds: tuple[Kind, ...] = _REAL
    """Kinds of operands that it takes; of a choice, those of the two numbers that it chooses from."""
    result: Kind | None = None
    """Kind of its result; None: that of the operands."""
    onnx: str = ""
    """ONNX's name; "" where ONNX has no such operation."""
    is_exact: bool = False
    """Whether IEEE 754 or the integers say each bit of the result, so that languages do not differ."""


OPERATIONS: Mapping[str, Operation] = {
    # Arithmetic.
    "+": Operation(2, np.add, _NUMBERS, None, "Add", True),
    "-": Operation(2, np.subtract, _NUMBERS, None, "Sub", True),
    "*": Operation(2, np.multiply, _NUMBERS, None, "Mul", True),
    "/": Operation(2, np.divide, _REAL, "real", "Div", True),
    "neg": Operation(1, np.negative, _NUMBERS, None, "Neg", True),
    ">>": Operation(2, np.right_shift, ("int",), None, "", True),
    # Comparisons and logic.
    "<": Operation(2, np.less, _NUMBERS, "bool", "Less", True),
    "<=": Operation(2, np.less_equal, _NUMBERS, "bool", "LessOrEqual", True),
    ">": Operation(2, np.greater, _NUMBERS, "bool", "Greater", True),
    ">=": Operation(2, np.greater_equal, _NUMBERS, "bool", "GreaterOrEqual", True),
    "==": Operation(2, np.equal, _ANY, "bool", "Equal", True),
    "!=": Operation(2, np.not_equal, _ANY, "bool", "", True),
    "&": Operation(2, np.bitwise_and, _BITS, None, "And", True),
    "|": Operation(2, np.bitwise_or, _BITS, None, "Or", True),
    "^": Operation(2, np.bitwise_xor, _BITS, None, "", True),
    "where": Operation(3, np.where, _ANY, None, "Where", True),
    # Functions of reals. Which of a number and a NaN is the larger differs between languages.
    "maximum": Operation(2, np.maximum, _NUMBERS, None, "Max"),
    "minimum": Operation(2, np.minimum, _NUMBERS, None, "Min"),
    "abs": Operation(1, np.abs, _NUMBERS, None, "Abs", True),
    "floor": Operation(1, np.floor, _REAL, None, "Floor", True),
    "sqrt": Operation(1, np.sqrt, _REAL, "real", "Sqrt", True),
    "real": Operation(1, lambda x: np.asarray(x, np.float64), _ANY, "real", "", True),
    "sin": Operation(1, np.sin, _REAL, "real", "Sin"),
    "cos": Operation(1, np.cos, _REAL, "real", "Cos"),
    "tanh": Operation(1, np.tanh, _REAL, "real", "Tanh"),
    "exp": Operation(1, np.exp, _REAL, "real", "Exp"),
    "log": Operation(1, np.log, _REAL, "real", "Log"),
    "log1p": Operation(1, np.log1p, _REAL, "real"),
    "atan2": Operation(2, np.arctan2, _REAL, "real"),
    # Of rows only: single operations of ONNX that symbols make of several.
    "clip": Operation(3, np.clip, _REAL, None, "Clip"),
    "cast": Operation(1, lambda x: np.asarray(x, np.float64), ("bool",), "real", "Cast", True),
    "identity": Operation(1, np.positive, _REAL, None, "Identity", True),
    "round": Operation(1, np.round, _REAL, None, "Round", True),
    "relu": Operation(1, lambda x: np.maximum(x, 0.0), _REAL, None, "Relu"),
    "sigmoid": Operation(1, lambda x: 1.0 / (1.0 + np.exp(-x)), _REAL, None, "Sigmoid"),
    "elu": Operation(
        1, lambda x: np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0))), _REAL, None, "Elu"
    ),
}
"""Operations by their signs or names in programs of symbols."""
ROWS: Mapping[str, str] = {kind.onnx: name for name, kind in OPERATIONS.items() if kind.onnx}
"""Names in `OPERATIONS` by ONNX's names, of the operations that rows have."""


def of_row(onnx: str) -> tuple[str, Kind]:
    """Name in `OPERATIONS` and kind of the operands of an operation of rows, which have no whole numbers."""
    name = ROWS[onnx]
    return name, "real" if "real" in OPERATIONS[name].kinds else "bool"


def _over(a: float, b: float) -> float:
    """Quotient as NumPy's: infinite or not a number over zero, which has a sign."""
    return a / b if b else a * math.copysign(math.inf, b)


def _root(x: float) -> float:
    """Square root as NumPy's: not a number below zero."""
    return math.sqrt(x) if x >= 0.0 else math.nan


NUMBERS: Mapping[str, Callable[..., Any]] = {
    **{
        sign: getattr(operator, name) for sign, name in {"+": "add", "-": "sub", "*": "mul"}.items()
    },
    **{"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge},
    **{"==": operator.eq, "!=": operator.ne, "&": operator.and_, "|": operator.or_},
    **{"^": operator.xor, ">>": operator.rshift},
    **{"/": _over, "neg": operator.neg, "abs": abs, "real": float, "sqrt": _root},
    "floor": lambda x: float(math.floor(x)),
    "minimum": lambda a, b: a if a < b or a != a else b,
    "maximum": lambda a, b: a if a > b or a != a else b,
    "where": lambda condition, a, b: a if condition else b,
    **{
        name: getattr(math, name) for name in ("sin", "cos", "tanh", "exp", "log", "log1p", "atan2")
    },
}
"""Operations of symbols on Python's numbers.

Where there is no real result, as of the logarithm of zero, functions of `math` raise ValueError or
OverflowError; the others give what NumPy gives.
"""


class Dialect:
    """Texts of operations in one language.

    Args:
        language: its name, for messages.
        infix: pattern of an operation that has a sign, with ``{sign}``; "": the language has none by this rule.
        call: pattern of the name of a function, with ``{name}``; "": none by this rule.
        kinds: kinds of operands that the language is printed for.
        lacks: names of operations that it does not have.
        texts: patterns of what differs, by name; ``{0}``, ``{1}`` and ``{2}`` are the operands.
        ints: patterns of what differs for whole numbers.
        bools: patterns of what differs for truth values.
    """

    def __init__(
        self,
        language: str,
        infix: str = "",
        call: str = "",
        kinds: tuple[Kind, ...] = _ANY,
        lacks: tuple[str, ...] = (),
        texts: Mapping[str, str] = MappingProxyType({}),
        ints: Mapping[str, str] = MappingProxyType({}),
        bools: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        self._language = language
        own = {"real": {}, "int": ints, "bool": bools}
        patterns: dict[tuple[str, Kind], str] = {}
        for name, operation in OPERATIONS.items():
            operands = ", ".join(f"{{{k}}}" for k in range(operation.arity))
            if name.isalnum():
                rule = f"{call.format(name=name)}({operands})" if call else ""
            else:
                rule = infix.replace("{sign}", name)
            for kind in operation.kinds:
                pattern = own[kind].get(name, texts.get(name, rule))
                if pattern and kind in kinds and name not in lacks:
                    patterns[name, kind] = pattern
        self._patterns = patterns

    def __contains__(self, operation: tuple[str, Kind]) -> bool:
        """Whether the language has the operation of this name on operands of this kind."""
        return operation in self._patterns

    def pattern(self, name: str, kind: Kind) -> str:
        """The pattern of an operation on operands of a kind; `Untraceable` where there is none."""
        try:
            return self._patterns[name, kind]
        except KeyError:
            raise Untraceable(
                f"programs in {self._language} have no operation {name!r} of kind {kind!r}."
            ) from None

    def text(self, name: str, kind: Kind, *operands: str) -> str:
        """An expression of the operation on operands."""
        return self.pattern(name, kind).format(*operands)


_OF_ROWS = ("clip", "cast", "identity", "round", "relu", "sigmoid", "elu")
"""Operations that no symbol has."""

NUMPY = Dialect(
    "NumPy",
    "{0} {sign} {1}",
    "np.{name}",
    ("real", "bool"),
    (),
    {
        "neg": "-{0}",
        "real": "np.float64({0})",
        "atan2": "np.arctan2({0}, {1})",
        "cast": "({0}).astype(np.float32)",
        "identity": "{0}",
        "relu": "np.maximum({0}, 0)",
        "sigmoid": "0.5 + 0.5 * np.tanh(0.5 * {0})",
        "elu": "np.where({0} > 0, {0}, np.expm1(np.minimum({0}, 0)))",
    },
    bools={"&": "np.logical_and({0}, {1})", "|": "np.logical_or({0}, {1})"},
)
"""Python over NumPy's arrays, as agent.py has it."""

PYTHON = Dialect(
    "Python",
    "{0} {sign} {1}",
    "{name}",
    ("real", "bool"),
    _OF_ROWS,
    {
        "neg": "-{0}",
        "/": "over({0}, {1})",
        # Without a call. A NaN stays one, as in NumPy: a filter must not take it for a margin.
        "where": "{1} if {0} else {2}",
        "minimum": "{0} if {0} < {1} or {0} != {0} else {1}",
        "maximum": "{0} if {0} > {1} or {0} != {0} else {1}",
    },
)
"""Python over its own numbers; names of functions are those of `NUMBERS`, and ``over`` is its division."""

JAVASCRIPT = Dialect(
    "JavaScript",
    "{0}{sign}{1}",
    "Math.{name}",
    _ANY,
    _OF_ROWS,
    {
        "neg": "-{0}",
        "where": "{0}?{1}:{2}",
        "minimum": "Math.min({0}, {1})",
        "maximum": "Math.max({0}, {1})",
        "real": "Number({0})",
        "==": "{0}==={1}",
        "!=": "{0}!=={1}",
    },
    # 32 bits with wrap-around.
    ints={"+": "({0}+{1})|0", "-": "({0}-{1})|0", "*": "Math.imul({0}, {1})", "neg": "(-{0})|0"},
    bools={"&": "{0}&&{1}", "|": "{0}||{1}", "^": "{0}!=={1}"},
)
"""JavaScript in double precision, as pages have it."""
