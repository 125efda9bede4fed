"""Symbols: fields that record the operations on them.

Running `rans.episode.step.step` on symbols gives a graph of its operations, without repeated operations and with
constants folded: the program that `rans.compile` prints as CUDA, C, LLVM and JavaScript.
"""

from __future__ import annotations

import itertools
import operator
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, ClassVar, NoReturn
from weakref import WeakValueDictionary

import numpy as np

from rans.model.operations import NUMBERS, OPERATIONS, Kind, Untraceable

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
UNTRACEABLE = (TypeError, AttributeError)
"""Exceptions of tasks that use more than arithmetic on a symbol, such as a method of tensors."""


class Symbol:
    """One value of a traced program: an input, a constant, or an operation on symbols.

    Equal operations on the same symbols are the same object.
    """

    __slots__ = ("__weakref__", "args", "kind", "operation", "serial", "value")
    __array_ufunc__ = None  # NumPy scalars on the left defer to the operators below

    _interned: ClassVar[WeakValueDictionary[tuple[Any, ...], Symbol]] = WeakValueDictionary()
    _serials = itertools.count()

    operation: str
    """"input", "constant", or one of `rans.model.operations.OPERATIONS`."""
    args: tuple[Symbol, ...]
    kind: Kind
    value: Any
    """Name of an input, or number of a constant."""
    serial: int
    """Serial number, increasing, so that that of an operation is above those of its operands."""

    @classmethod
    def _of(
        cls, operation: str, kind: Kind, args: tuple[Symbol, ...] = (), value: Any = None
    ) -> Symbol:
        """The symbol of an operation; an equal one is the same object.

        What is equal here is computed once in every printed program. A symbol holds its operands, whose ids are in
        its key.
        """
        key = (operation, kind, tuple(map(id, args)), repr(value))
        if (existing := cls._interned.get(key)) is not None:
            return existing
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
        """Input of the program with this name."""
        return cls._of("input", kind, value=name)

    @classmethod
    def constant(cls, value: Any, kind: Kind | None = None) -> Symbol:
        """Constant symbol of a number; by default of the kind of its Python type.

        Raises:
            Untraceable: the value is not a number.
        """
        if isinstance(value, Symbol):
            return value
        if isinstance(value, np.generic):
            value = value.item()
        if not isinstance(value, bool | int | float):
            raise Untraceable(
                f"an operation on a symbol has a {type(value).__name__} operand; operands must be symbols or "
                "numbers."
            )
        natural: Kind = (
            "bool" if isinstance(value, bool) else "int" if isinstance(value, int) else "real"
        )
        kind = kind or natural
        convert: Callable[[Any], Any] = {"real": float, "int": _wrapped, "bool": bool}[kind]
        return cls._of("constant", kind, value=convert(value))

    @classmethod
    def apply(cls, operation: str, *operands: Operand) -> Symbol:
        """Result of an operation on symbols and numbers, folded and simplified; equal ones are one object.

        Operands that commute are sorted, which does not change a result of IEEE arithmetic, but the text of
        kernels.
        """
        args = _alike(operation, operands)
        if all(arg.operation == "constant" for arg in args):
            return cls.constant(
                NUMBERS[operation](*(arg.value for arg in args)), _kind(operation, args)
            )
        if (simpler := _simplified(operation, args)) is not None:
            return simpler
        if operation in _COMMUTING:
            args = tuple(sorted(args, key=lambda arg: arg.serial))
        return cls._of(operation, _kind(operation, args), args)

    @property
    def operand_kind(self) -> Kind:
        """Kind of the operands, by which a language chooses the text of the operation."""
        return _operand_kind(self.operation, self.args)

    def is_number(self, value: float) -> bool:
        """Whether the symbol is a constant of this value."""
        return self.operation == "constant" and self.value == value

    def to(self, _dtype: Any) -> Symbol:
        """The symbol converted to real."""
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
    """Operands as symbols; numbers take the kind of the other operands."""
    args = [Symbol.constant(x) for x in operands]
    same = args[1:] if operation == "where" else args
    if operation != "real" and any(arg.kind == "real" for arg in same):
        same = [Symbol.constant(a.value, "real") if a.operation == "constant" else a for a in same]
    return (args[0], *same) if operation == "where" else tuple(same)


def _kind(operation: str, args: tuple[Symbol, ...]) -> Kind:
    """Kind of the result of an operation."""
    return OPERATIONS[operation].result or _operand_kind(operation, args)


def _operand_kind(operation: str, args: tuple[Symbol, ...]) -> Kind:
    """The widest kind of operands; of a choice, of the two numbers that it chooses from."""
    kinds = {arg.kind for arg in (args[1:] if operation == "where" else args)}
    if "real" in kinds:
        return "real"
    return "int" if "int" in kinds else "bool"


def _simplified(operation: str, args: tuple[Symbol, ...]) -> Symbol | None:
    """Simpler symbol with the same value wherever that is finite; None if there is none.

    A division by a constant becomes a product, which rounds otherwise: programs equal the equations to rounding.
    """
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


def ordered(roots: Iterable[Symbol], computed: Iterable[Symbol] = ()) -> Iterator[Symbol]:
    """Symbols that the roots depend on, each after its operands and close to its first use.

    Symbols in ``computed``, and those that only they depend on, are left out.
    """
    visited = set(computed)
    stack = [(root, False) for root in reversed(list(roots))]
    while stack:
        symbol, ready = stack.pop()
        if ready:
            yield symbol
        elif symbol not in visited:
            visited.add(symbol)
            stack.append((symbol, True))
            stack.extend((arg, False) for arg in reversed(symbol.args))


def substituted(roots: Iterable[Symbol], values: Mapping[Symbol, Symbol]) -> list[Symbol]:
    """The roots with some symbols replaced by others, simplified again.

    Printed steps have a branch for each value of a condition (`rans.compile.step_program`): the operations of each
    are those of the graph with the condition replaced by the value.
    """
    roots = list(roots)
    new = dict(values)
    for symbol in ordered(roots):
        if symbol in new:
            continue
        args = tuple(new[arg] for arg in symbol.args)
        same = all(map(operator.is_, args, symbol.args))
        new[symbol] = symbol if same else Symbol.apply(symbol.operation, *args)
    return [new[root] for root in roots]
