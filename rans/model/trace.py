"""Symbols: fields that write down what is done to them.

Running `rans.episode.step` on symbols gives its operations as a graph, every one of them
once, with constants folded: the straight-line program that `rans.compile.cuda.source` prints.
"""

from __future__ import annotations

import itertools
import math
import operator
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, ClassVar, Literal, NoReturn
from weakref import WeakValueDictionary

import numpy as np

Kind = Literal["real", "int", "bool"]
"""real: the engine's floating dtype; int: 32 bits with wrap-around."""
Operand = Any
"""A symbol or a number."""

_ARITHMETIC = {
    "+": "add",
    "-": "sub",
    "*": "mul",
    "/": "truediv",
    "&": "and",
    "|": "or",
    "^": "xor",
    ">>": "rshift",
}
_COMPARISONS = {"<": "lt", "<=": "le", ">": "gt", ">=": "ge", "==": "eq", "!=": "ne"}
_COMMUTING = ("+", "*", "&", "|", "^", "==", "!=")
_FOLDED: dict[str, Callable[..., Any]] = {
    **{
        sign: getattr(operator, f"__{name}__")
        for sign, name in (_ARITHMETIC | _COMPARISONS).items()
    },
    "neg": operator.neg,
    "abs": abs,
    "real": float,
    "floor": math.floor,
    "minimum": min,
    "maximum": max,
    "where": lambda condition, a, b: a if condition else b,
    **{name: getattr(math, name) for name in ("sin", "cos", "exp", "log", "tanh", "sqrt", "atan2")},
}
UNTRACEABLE = (TypeError, AttributeError)
"""What a task raises that does more with a symbol than arithmetic, such as calling a tensor's method."""


class Untraceable(TypeError):
    """Equations asked a symbol for what only a number has, such as a branch on its value."""


class Symbol:
    """One value of a step, of every spacecraft: an input, a constant, or an operation on symbols.

    The same operation on the same symbols is the same object.
    """

    __slots__ = ("__weakref__", "args", "kind", "operation", "serial", "value")
    __array_ufunc__ = None  # NumPy's numbers on the left leave the operator to us

    _interned: ClassVar[WeakValueDictionary[tuple[Any, ...], Symbol]] = WeakValueDictionary()
    _serials = itertools.count()

    operation: str
    """"input", "constant", or one of those above."""
    args: tuple[Symbol, ...]
    kind: Kind
    value: Any
    """Name of an input, number of a constant."""
    serial: int
    """Grows with every new symbol, so that an operation has a greater one than its operands."""

    @classmethod
    def _of(
        cls, operation: str, kind: Kind, args: tuple[Symbol, ...] = (), value: Any = None
    ) -> Symbol:
        key = (operation, kind, tuple(map(id, args)), repr(value))
        if (found := cls._interned.get(key)) is not None:
            return found
        new = object.__new__(cls)
        new.operation = operation
        new.kind = kind
        new.args = args
        new.value = value
        new.serial = next(cls._serials)
        cls._interned[key] = new
        return new

    @classmethod
    def input(cls, name: str, kind: Kind = "real") -> Symbol:
        """A value that the program is given."""
        return cls._of("input", kind, value=name)

    @classmethod
    def constant(cls, value: Any, kind: Kind | None = None) -> Symbol:
        """A number; by default of the kind that it is of.

        Raises:
            Untraceable: it is no number.
        """
        if isinstance(value, Symbol):
            return value
        if isinstance(value, np.generic):
            value = value.item()
        if not isinstance(value, bool | int | float):
            raise Untraceable(
                f"a symbol meets {type(value).__name__}, which is neither symbol nor number."
            )
        own: Kind = (
            "bool" if isinstance(value, bool) else "int" if isinstance(value, int) else "real"
        )
        kind = kind or own
        convert = {"real": float, "int": _wrapped, "bool": bool}[kind]
        return cls._of("constant", kind, value=convert(value))

    @classmethod
    def apply(cls, operation: str, *operands: Operand) -> Symbol:
        """The result of an operation, computed at once where it is known."""
        args = _alike(operation, operands)
        if all(arg.operation == "constant" for arg in args):
            return cls.constant(
                _FOLDED[operation](*(arg.value for arg in args)), _kind(operation, args)
            )
        if (simpler := _simplified(operation, args)) is not None:
            return simpler
        if operation in _COMMUTING:
            args = tuple(sorted(args, key=lambda arg: arg.serial))
        return cls._of(operation, _kind(operation, args), args)

    def is_number(self, value: float) -> bool:
        """Whether it is this constant."""
        return self.operation == "constant" and self.value == value

    def to(self, _dtype: Any) -> Symbol:
        """As a real, whatever the engine's floating dtype is."""
        return Symbol.apply("real", self)

    def __neg__(self) -> Symbol:
        return Symbol.apply("neg", self)

    def __abs__(self) -> Symbol:
        return Symbol.apply("abs", self)

    def __invert__(self) -> Symbol:
        return Symbol.apply("^", self, True if self.kind == "bool" else -1)

    __hash__ = object.__hash__

    def __bool__(self) -> NoReturn:
        raise Untraceable("a symbol has no value to branch on; use `rans.model.fields.where`.")


def _binary(operation: str, *, swapped: bool = False) -> Callable[[Symbol, Operand], Symbol]:
    if swapped:
        return lambda self, other: Symbol.apply(operation, other, self)
    return lambda self, other: Symbol.apply(operation, self, other)


for _sign, _name in (_ARITHMETIC | _COMPARISONS).items():
    setattr(Symbol, f"__{_name}__", _binary(_sign))
for _sign, _name in _ARITHMETIC.items():
    setattr(Symbol, f"__r{_name}__", _binary(_sign, swapped=True))


def _wrapped(value: int) -> int:
    return (int(value) + 2**31) % 2**32 - 2**31


def _alike(operation: str, operands: tuple[Operand, ...]) -> tuple[Symbol, ...]:
    """The operands as symbols; numbers take the kind of the symbols beside them."""
    args = [Symbol.constant(x) for x in operands]
    same = args[1:] if operation == "where" else args
    if operation != "real" and any(arg.kind == "real" for arg in same):
        same = [Symbol.constant(a.value, "real") if a.operation == "constant" else a for a in same]
    return (args[0], *same) if operation == "where" else tuple(same)


def _kind(operation: str, args: tuple[Symbol, ...]) -> Kind:
    if operation in _COMPARISONS:
        return "bool"
    kinds = {arg.kind for arg in (args[1:] if operation == "where" else args)}
    if (
        operation in ("real", "/", "sin", "cos", "exp", "log", "tanh", "sqrt", "atan2")
        or "real" in kinds
    ):
        return "real"
    return "int" if "int" in kinds else "bool"


def _simplified(operation: str, args: tuple[Symbol, ...]) -> Symbol | None:
    """A simpler symbol with the same value wherever that is finite; None if there is none."""
    a = args[0]
    b = args[-1]
    if operation in ("+", "*", "&", "|", "^") and a.operation == "constant":
        a, b = b, a
    match operation:
        case "+" | "-" | "|" | "^" | ">>" if b.is_number(0):
            return a
        case "-" if a.is_number(0):
            return -b
        case "*" if b.is_number(0):
            return b
        case "*" | "/" if b.is_number(1):
            return a
        case "*" if b.is_number(-1):
            return -a
        case "/" if b.operation == "constant":
            return a * (1.0 / b.value)
        case "neg" if a.operation == "neg":
            return a.args[0]
        case "where" if args[1] is args[2] or a.operation == "constant":
            return args[1] if args[1] is args[2] or a.value else args[2]
        case "real" if a.kind == "real":
            return a
        case "&" | "|" if b.kind == "bool" and b.operation == "constant":
            return a if b.value == (operation == "&") else b
    return None


def ordered(roots: Iterable[Symbol], known: Iterable[Symbol] = ()) -> Iterator[Symbol]:
    """Everything that the roots are made of, operands before operations, late enough to be used soon.

    Without what is known, and without what only that is made of.
    """
    seen = set(known)
    stack = [(root, False) for root in reversed(list(roots))]
    while stack:
        symbol, ready = stack.pop()
        if ready:
            yield symbol
        elif symbol not in seen:
            seen.add(symbol)
            stack.append((symbol, True))
            stack.extend((arg, False) for arg in reversed(symbol.args))


def substituted(roots: Iterable[Symbol], values: Mapping[Symbol, Symbol]) -> list[Symbol]:
    """The roots as they are when some symbols have other values, simplified again."""
    roots = list(roots)
    new = dict(values)
    for symbol in ordered(roots):
        if symbol in new:
            continue
        args = tuple(new[arg] for arg in symbol.args)
        same = all(map(operator.is_, args, symbol.args))
        new[symbol] = symbol if same else Symbol.apply(symbol.operation, *args)
    return [new[root] for root in roots]
