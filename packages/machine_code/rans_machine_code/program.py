"""Straight-line programs of traced symbols: interpreted by machine code, or as one function.

Each operation is a function that is compiled once in a process, and a program is a list of their addresses: one of
200,000 operations, a period of a CubeSat under `lab`, flies as soon as it is traced, where LLVM takes minutes and
its code more memory than a stack has. Engines on a CPU rest on it: `tests/test_operations.py` asks for NumPy's
numbers.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache, cached_property
from typing import Any

import numpy as np
from llvmlite import ir

from rans.extend import Symbol, ordered
from rans_machine_code.llvm import (
    BOOLS,
    FLOATS,
    INTS,
    LANES,
    LONG,
    POINTER,
    Code,
    Value,
    compiled,
)

_TYPES = {"real": np.float32, "int": np.int32, "bool": np.int32}
_KINDS = {"real": FLOATS, "int": INTS, "bool": INTS}
_BLOCK = 4 * LANES
"""Spacecraft that go through a program together: values of thousands of operations stay in a processor's caches."""
_OFTEN = 30_000
"""Runs of a block after which one function of the whole program pays: it saves 7 ns an operation, and LLVM takes
0.2 ms. The step of 2,048 spacecraft is compiled after 900 runs."""
_LONGEST = 20_000
"""Operations of a program that is compiled at all, in some seconds."""
_WORDS = 5
"""Numbers of an instruction: addresses of its function, of its result and of up to three operands."""
_Key = tuple[Any, ...]
"""An operation and the kinds of its operands."""
_FUNCTIONS = dict[_Key, Any]()
"""Functions of operations on a block, of all programs."""


class CompiledProgram:
    """A straight-line program: what symbols are, from the values of its inputs.

    Args:
        inputs: whose values are given.
        parts: symbols to compute, in so many goes; a later one may use those of earlier ones, and inputs that are
            given only then.
    """

    def __init__(self, inputs: Sequence[Symbol], *parts: Iterable[Symbol]) -> None:
        self.inputs = list(inputs)
        self.parts = [list(part) for part in parts]
        lasting = dict.fromkeys((*self.inputs, *(s for part in self.parts for s in part)))
        self.places = {symbol: ~row for row, symbol in enumerate(lasting)}
        """Where inputs, constants and what is asked for lie: slots, which hold a block, or rows, below zero."""
        self.rows = len(lasting)
        self.slots = 0
        self.code = [
            np.array([*self._instructions(part)], np.int64).reshape(-1, _WORDS)
            for part in range(len(self.parts))
        ]
        """Instructions of each part: functions and places."""

    def _order(self, part: int) -> Iterator[Symbol]:
        """What a part computes, and constants."""
        before = (s for earlier in self.parts[:part] for s in earlier if s.args)
        return ordered(self.parts[part], {*self.inputs, *before})

    def _instructions(self, part: int) -> Iterator[tuple[int, ...]]:
        """Instructions of a part; a slot is another value's after its last use, but a constant's."""
        order = [*self._order(part)]
        last = {arg: symbol for symbol in order for arg in symbol.args}
        free = list[int]()
        for symbol in order:
            if symbol not in self.places and not symbol.args:
                self.places[symbol] = self.slots
                self.slots += 1
        places = dict(self.places)
        keys = {s: (s.operation, *(arg.kind for arg in s.args)) for s in order if s.args}
        functions = _operations(keys.values())
        for symbol, key in keys.items():
            operands = [places[arg] for arg in symbol.args]
            ends = {arg for arg in symbol.args if last[arg] is symbol and arg not in self.places}
            free += [places[arg] for arg in ends]
            if symbol not in places:
                if not free:
                    free.append(self.slots)
                    self.slots += 1
                places[symbol] = free.pop()
            yield functions[key], places[symbol], *operands, *[0] * (_WORDS - 2 - len(operands))

    @cached_property
    def functions(self) -> list[Callable[..., None]]:
        """Each part as a function of the rows, their length and its vectors: the same bits, thrice as fast."""
        return compiled((POINTER, LONG, LONG), *map(self._writer, range(len(self.parts))))

    def _writer(self, part: int) -> Callable[..., None]:
        """Prints the body of the function of a part, by its index: reads its inputs, and writes its symbols."""
        wanted = dict.fromkeys(s for s in self._order(part) if self.places.get(s, 0) < 0)

        def write(code: Code, rows: Value, length: Value, vectors: Value) -> None:
            def vector(number: Value, _: list[Value]) -> list[Value]:
                first = code.mul(number, LONG(LANES))
                at = {
                    symbol: code.add(code.mul(LONG(~place), length), first)
                    for symbol, place in self.places.items()
                    if place < 0
                }
                values = {s: _read(code, s, rows, at[s]) for s in at if s not in wanted}
                for symbol, value in zip(wanted, code.computed([*wanted], values), strict=True):
                    _write(code, value, rows, at[symbol])
                return []

            code.repeat(vectors, [], vector)

        return write

    def memory(self, count: int) -> ProgramMemory:
        """Buffers for runs over N values of each input."""
        return ProgramMemory(self, count)


class ProgramMemory:
    """Buffers in which a program runs for N values; two threads must not share them."""

    def __init__(self, program: CompiledProgram, count: int) -> None:
        # `give` and `put` copy into views of the rows, so that code keeps the addresses.
        self._blocks = blocks = -(-count // _BLOCK)
        self._program = program
        short = max(map(len, program.code)) <= _LONGEST
        self._runs = _OFTEN if short else math.inf
        self._rows = rows = np.zeros((program.rows, blocks * _BLOCK), np.float32)
        self._slots = slots = np.zeros((program.slots, _BLOCK), np.float32)
        self._values = dict[Symbol, np.ndarray]()
        for symbol, place in program.places.items():
            value = (rows[~place, :count] if place < 0 else slots[place]).view(_TYPES[symbol.kind])
            if symbol.operation == "constant":
                value[...] = symbol.value
            if place < 0:
                self._values[symbol] = value
        self._inputs = [self._values[symbol] for symbol in program.inputs]
        self._wanted = [[self._values[symbol] for symbol in part] for part in program.parts]
        self._code = list[np.ndarray]()
        # Addresses take the place of places; those in rows are odd, see `_operation`.
        self._calls = list[tuple[Callable[..., None], tuple[Any, ...]]]()
        for instructions in program.code:
            code, places = instructions.copy(), instructions[:, 1:]
            in_rows = rows.ctypes.data + ~places * rows.strides[0] + 1
            in_slots = slots.ctypes.data + places * slots.strides[0]
            code[:, 1:] = np.where(places < 0, in_rows, in_slots)
            self._code.append(code)
            self._calls.append((_interpreter(), (code.ctypes.data, len(code), blocks)))

    def give(self, values: Iterable[Any]) -> None:
        """Values of the first inputs, or fewer: arrays (N,) or numbers."""
        for buffer, value in zip(self._inputs, values, strict=False):
            buffer[...] = value

    def put(self, symbol: Symbol, value: Any) -> None:
        """The value of one input."""
        self._values[symbol][...] = value

    def value(self, symbol: Symbol) -> np.ndarray:
        """Value of an input."""
        return self._values[symbol]

    def run(self, part: int) -> list[np.ndarray]:
        """The values of one part's symbols, truth values as 0 and 1; the next run overwrites them."""
        self._runs -= self._blocks
        if self._runs < 0:
            self._runs = math.inf
            length = self._rows.shape[1]
            arguments = self._rows.ctypes.data, length, length // LANES
            self._calls = [(function, arguments) for function in self._program.functions]
        function, arguments = self._calls[part]
        if all(arguments):  # a constant that is asked for has no instructions
            function(*arguments)
        return self._wanted[part]


def _read(code: Code, symbol: Symbol, array: Value, index: Value) -> Value:
    """A symbol's vector from an array of 32-bit numbers, in which truth values are whole numbers."""
    value = code.read(array, index, _KINDS[symbol.kind])
    return code.to_bool(value) if symbol.kind == "bool" else value


def _write(code: Code, value: Value, array: Value, index: Value) -> None:
    """The reverse of `_read`."""
    code.write(code.zext(value, INTS) if value.type == BOOLS else value, array, index)


@cache
def _interpreter() -> Callable[..., None]:
    """A function of instructions, of their number and of the number of blocks, which runs all for each block."""
    pointer = ir.FunctionType(ir.VoidType(), (LONG, LONG)).as_pointer()

    def write(code: Code, instructions: Value, count: Value, blocks: Value) -> None:
        def block(number: Value, _: list[Value]) -> list[Value]:
            shift = code.mul(number, LONG(4 * _BLOCK))

            def instruction(at: Value, _: list[Value]) -> list[Value]:
                words = code.add(instructions, code.mul(at, LONG(8 * _WORDS)))
                code.call(code.load(code.inttoptr(words, pointer.as_pointer())), [words, shift])
                return []

            code.repeat(count, [], instruction)
            return []

        code.repeat(blocks, [], block)

    return compiled((LONG, LONG, LONG), write)[0]


def _operations(keys: Iterable[_Key]) -> dict[_Key, int]:
    """Addresses of the code of operations on a block, which is compiled where it has not been in this process."""
    keys = set(keys)
    missing = [key for key in keys if key not in _FUNCTIONS]
    if missing:
        # Another thread may have been faster: the code of the first stays, and its addresses are used.
        for key, function in zip(
            missing, compiled((LONG, LONG), *map(_operation, missing)), strict=True
        ):
            _FUNCTIONS.setdefault(key, function)
    return {key: ctypes.cast(_FUNCTIONS[key], ctypes.c_void_p).value or 0 for key in keys}


def _operation(key: _Key) -> Callable[..., None]:
    """What prints the code of an operation.

    It is given the address of its instruction, and the bytes of a row before the block, which are added to odd
    addresses.
    """
    operation, *kinds = key
    operands = [Symbol.input(f"operand_{k}", kind) for k, kind in enumerate(kinds)]
    result = Symbol.apply(operation, *operands)

    def write(code: Code, words: Value, shift: Value) -> None:
        instruction = code.inttoptr(words, LONG.as_pointer())
        arrays = []
        for k in range(1, 2 + len(kinds)):
            word = code.load(code.gep(instruction, [LONG(k)]))
            odd = code.and_(word, LONG(1))
            address = code.add(code.sub(word, odd), code.mul(shift, odd))
            arrays.append(code.inttoptr(address, POINTER))
        to, *given = arrays

        def vector(number: Value, _: list[Value]) -> list[Value]:
            first = code.mul(number, LONG(LANES))
            values = {
                operand: _read(code, operand, array, first)
                for operand, array in zip(operands, given, strict=True)
            }
            (value,) = code.computed([result], values)
            _write(code, value, to, first)
            return []

        code.repeat(_BLOCK // LANES, [], vector)

    return write
