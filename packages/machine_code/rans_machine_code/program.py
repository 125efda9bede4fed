"""A traced program run by NumPy: every operation once, in memory that stays in a processor's caches.

One that is run often becomes machine code, but for what only NumPy computes (`rans_machine_code.program_code`).
Engines on a CPU rest on it: `tests/test_program.py` asks for NumPy's bits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from rans.extend import Symbol, ordered
from rans.model.operations import OPERATIONS
from rans_machine_code.program_code import (
    LANES,
    MachineModule,
    in_phases,
    is_arithmetic,
    write_function,
)

_FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: operation.meaning for name, operation in OPERATIONS.items()},
    # NumPy takes where these two write by name only.
    "minimum": lambda a, b, to: np.minimum(a, b, out=to),
    "maximum": lambda a, b, to: np.maximum(a, b, out=to),
}
"""Operations with the array that they write as their last argument."""
_TYPES = {"real": np.float32, "int": np.int32, "bool": np.bool_}
_OFTEN = 300
"""Runs after which compiling pays: 0.15 to 0.2 ms an operation, which takes NumPy 0.7 us or more in a run."""
_Value = Symbol | tuple[str, Symbol]
"""A symbol, or of a condition ("mask", it): all bits where it holds."""


@dataclass(frozen=True)
class _Operation:
    name: str
    kind: str
    args: tuple[_Value, ...]
    of: _Value
    """What it computes."""


class CompiledProgram:
    """A straight-line program: what symbols are, from the values of its inputs.

    Args:
        inputs: whose values are given.
        parts: symbols to compute, in so many goes; a later one may use what earlier ones have computed, and
            inputs that are given only then.
    """

    def __init__(self, inputs: Sequence[Symbol], *parts: Iterable[Symbol]) -> None:
        # No memory is shared by values that are both still to be read, nor by a truth value (a byte) and a number.
        self._inputs = tuple(inputs)
        self._wanted = [list(part) for part in parts]
        orders = []
        computed = set(inputs)
        for part in self._wanted:
            orders.append(in_phases(s for s in ordered(part, computed) if s.args))
            computed.update(orders[-1])
        everything = [s for order in orders for s in order]
        uses: dict[_Value, int] = {}
        for at, symbol in enumerate(everything):
            uses |= dict.fromkeys((*_args(symbol), *symbol.args), at)
        # A value's memory is another's after its last use; what is asked for stays.
        lasting = {*self._inputs, *(s for part in self._wanted for s in part)}
        # A truth value takes a byte: machine code, vector by vector, would write numbers over the next ones.
        self._slots, self._count = dict[_Value, int](), len(self._inputs)
        self._slots |= {symbol: slot for slot, symbol in enumerate(self._inputs)}
        free: dict[bool, list[int]] = {True: [], False: []}
        self._programs: list[list[_Operation]] = []
        at = 0
        for order in orders:
            self._programs.append(program := [])
            for symbol in order:
                for value in (*filter(lambda x: x not in self._slots, _masks(symbol)), symbol):
                    slots = free[_is_truth(value)]
                    self._slots[value] = slots.pop() if slots else self._new()
                    program.append(
                        _Operation("mask", "int", (value[1],), value)
                        if isinstance(value, tuple)
                        else _Operation(symbol.operation, symbol.kind, _args(symbol), symbol)
                    )
                for value in dict.fromkeys((*_args(symbol), *symbol.args)):
                    if uses[value] == at and value in self._slots and value not in lasting:
                        free[_is_truth(value)].append(self._slots[value])
                at += 1

    def _new(self) -> int:
        self._count += 1
        return self._count - 1

    @cached_property
    def stretches(self) -> list[list[Callable[..., None] | _Operation]]:
        """The parts as machine code where there is arithmetic, and operations of NumPy's between.

        Fixes the machine module: a later change of the program would not be seen.
        """
        groups = list[tuple[int, bool, list[_Operation]]]()
        for part, program in enumerate(self._programs):
            for operation in program:
                if isinstance(operation.of, Symbol):
                    simple = is_arithmetic(operation.of)
                    if not (simple and groups and groups[-1][:2] == (part, True)):
                        groups.append((part, simple, []))
                    groups[-1][2].append(operation)
        stored = {s for part in self._wanted for s in part}
        homes = dict[Symbol, int]()
        for number, (*_, group) in enumerate(groups):
            for symbol in _symbols(group):
                stored |= {arg for arg in symbol.args if homes.get(arg, number) != number}
                homes[symbol] = number
        rows = {symbol: slot for symbol, slot in self._slots.items() if isinstance(symbol, Symbol)}
        self._machine, functions = MachineModule(), [list[Any]() for _ in self._programs]
        for number, (_, simple, group) in enumerate(groups):
            if simple:
                write_function(self._machine, f"stretch_{number}", _symbols(group), rows, stored)
        for number, (part, simple, group) in enumerate(groups):
            functions[part] += [self._machine.compiled(f"stretch_{number}")] if simple else group
        return functions

    def memory(self, count: int) -> ProgramMemory:
        """Buffers for runs over N values of each input."""
        return ProgramMemory(self, count)


class ProgramMemory:
    """Buffers in which a program runs for N values; two threads must not share them."""

    def __init__(self, program: CompiledProgram, count: int) -> None:
        # Views of the block are made once. `give` and `put` copy into them, so that code keeps the addresses.
        self._program = program
        self._runs = 0
        length = -(-count // LANES) * LANES
        self._block = block = np.zeros((program._count, length), np.float32)
        self._length = length
        self._place = {
            value: self._typed(block[slot], value)[:count] for value, slot in program._slots.items()
        }
        self._inputs = {symbol: self._place[symbol] for symbol in program._inputs}
        self._calls = [[self._call(operation) for operation in part] for part in program._programs]
        self._wanted = [[self._value(s) for s in part] for part in program._wanted]
        if "stretches" in vars(program):
            self._compile()

    def give(self, values: Iterable[Any]) -> None:
        """Values of the first inputs, or fewer: arrays (N,) or numbers."""
        for buffer, value in zip(self._inputs.values(), values, strict=False):
            buffer[...] = value

    def put(self, symbol: Symbol, value: Any) -> None:
        """The value of one input."""
        self._inputs[symbol][...] = value

    def value(self, symbol: Symbol) -> np.ndarray:
        """Value of an input."""
        return self._inputs[symbol]

    def run(self, part: int) -> list[Any]:
        """The values of one part's symbols; they are overwritten when it is run again.

        Counts runs, and compiles at run `_OFTEN`.
        """
        if part == 0:
            self._runs += 1
            if self._runs == _OFTEN:
                self._compile()
        for function, args in self._calls[part]:
            function(*args)
        return self._wanted[part]

    def _compile(self) -> None:
        """Bind every operation to its function and its memory, once for all runs."""
        where = self._block.ctypes.data, self._length, self._length // LANES
        self._calls = [
            [
                self._call(operation) if isinstance(operation, _Operation) else (operation, where)
                for operation in part
            ]
            for part in self._program.stretches
        ]

    @staticmethod
    def _typed(row: np.ndarray, value: _Value) -> np.ndarray:
        kind = "int" if isinstance(value, tuple) else value.kind
        return row.view(_TYPES[kind])[: len(row)]  # a truth value is a byte

    def _value(self, value: _Value) -> Any:
        if isinstance(value, Symbol) and value.operation == "constant":
            return _TYPES[value.kind](value.value)
        return self._inputs[value] if value in self._inputs else self._place[value]

    def _call(self, operation: _Operation) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        """The NumPy function of an operation and its arguments, of which the last is where it writes.

        NumPy's bits are what machine code must reproduce, so that a function here is also the oracle of
        `program_code`.
        """
        args = [self._value(arg) for arg in operation.args]
        to = self._place[operation.of]
        match operation.name:
            case "mask":
                return _mask, (args[0], to)
            case "where" if operation.kind == "bool":
                return _choose_bool, (*args, to)
            case "where":
                return _choose, (*(x.view(np.int32) for x in (*args, to)),)
            case "real":
                return _convert, (*args, to)
        return _FUNCTIONS[operation.name], (*args, to)


def _symbols(operations: Sequence[_Operation]) -> list[Symbol]:
    return [operation.of for operation in operations if isinstance(operation.of, Symbol)]


def _is_truth(value: _Value) -> bool:
    return isinstance(value, Symbol) and value.kind == "bool"


def _args(symbol: Symbol) -> tuple[_Value, ...]:
    """Symbols that an operation reads; a choice reads the mask of its condition."""
    if symbol.operation == "where" and symbol.kind != "bool":
        return ("mask", symbol.args[0]), *symbol.args[1:]
    return symbol.args


def _masks(symbol: Symbol) -> list[_Value]:
    return [value for value in _args(symbol) if isinstance(value, tuple)]


def _mask(condition: np.ndarray, to: np.ndarray) -> None:
    np.subtract(0, condition, to, dtype=np.int32)


def _choose(mask: np.ndarray, a: Any, b: Any, to: np.ndarray) -> None:
    np.bitwise_xor(a, b, to)
    np.bitwise_and(to, mask, to)
    np.bitwise_xor(to, b, to)


def _choose_bool(condition: np.ndarray, a: Any, b: Any, to: np.ndarray) -> None:
    np.copyto(to, np.where(condition, a, b))


def _convert(whole: np.ndarray, to: np.ndarray) -> None:
    np.copyto(to, whole)
