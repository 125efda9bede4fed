"""Straight-line programs of traced symbols as machine code, vector by vector, in rows of one memory.

Engines on a CPU rest on it: `tests/test_operations.py` asks for NumPy's numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from rans.extend import Symbol, ordered
from rans_machine_code.llvm import (
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
QUICK = 0
THOROUGH = 1
"""Optimisations of LLVM, whose bits are equal. A step under lab conditions in space takes 1.0 and 1.9 s to compile,
and then 2.6 and 1.6 ms for 2,048 spacecraft, 0.34 and 0.29 ms for 64."""


class CompiledProgram:
    """A straight-line program: what symbols are, from the values of its inputs.

    Args:
        inputs: whose values are given.
        parts: symbols to compute, in so many goes; a later one may use what earlier ones have computed, and
            inputs that are given only then.
        level: `QUICK` or `THOROUGH`.
    """

    def __init__(
        self, inputs: Sequence[Symbol], *parts: Iterable[Symbol], level: int = QUICK
    ) -> None:
        self.inputs = dict.fromkeys(inputs)
        self.parts = [list(part) for part in parts]
        # The part that computes a symbol; rows of inputs, of what is asked for, and of what a later part reads.
        home = dict[Symbol, int]()
        lasting = dict.fromkeys((*self.inputs, *(s for part in self.parts for s in part)))
        read: list[list[Symbol]] = []
        for number, part in enumerate(self.parts):
            order = list(ordered(part, {*self.inputs, *(s for s in home if s.args)}))
            home = dict.fromkeys(order, number) | home
            needed = dict.fromkeys((*part, *(arg for symbol in order for arg in symbol.args)))
            read.append([s for s in needed if s in self.inputs or (s.args and home[s] != number)])
            lasting |= dict.fromkeys(read[-1])
        self.rows = {symbol: row for row, symbol in enumerate(lasting)}
        self.functions: list[Callable[..., None]] = []
        for number, given in enumerate(read):
            stored = [symbol for symbol in lasting if home.get(symbol) == number]
            write = self._writer(given, stored)
            self.functions.append(compiled((POINTER, LONG, LONG), write, level))

    def _writer(self, read: Sequence[Symbol], stored: Sequence[Symbol]) -> Callable[..., None]:
        """What prints a function of a memory, the length of a row and the vectors in a row, in 32-bit numbers."""

        def write(code: Code, memory: Value, stride: Value, vectors: Value) -> None:
            def vector(number: Value, _: list[Value]) -> list[Value]:
                """Print the program for vector ``number`` of every row; truth values are whole numbers there."""
                first = code.mul(number, LONG(LANES))
                places = {
                    symbol: code.add(code.mul(LONG(self.rows[symbol]), stride), first)
                    for symbol in (*read, *stored)
                }
                values = dict[Symbol, Value]()
                for symbol in read:
                    value = code.read(memory, places[symbol], _KINDS[symbol.kind])
                    values[symbol] = code.to_bool(value) if symbol.kind == "bool" else value
                for symbol, value in zip(stored, code.computed(stored, values), strict=True):
                    value = code.zext(value, INTS) if symbol.kind == "bool" else value
                    code.write(value, memory, places[symbol])
                return []

            code.repeat(vectors, [], vector)

        return write

    def memory(self, count: int) -> ProgramMemory:
        """Buffers for runs over N values of each input."""
        return ProgramMemory(self, count)


class ProgramMemory:
    """Buffers in which a program runs for N values; two threads must not share them."""

    def __init__(self, program: CompiledProgram, count: int) -> None:
        # Views of the block are made once. `give` and `put` copy into them, so that code keeps the addresses.
        vectors = -(-count // LANES)
        self._block = block = np.zeros((len(program.rows), vectors * LANES), np.float32)
        self._arguments = block.ctypes.data, vectors * LANES, vectors
        self._values = {
            symbol: block[row].view(_TYPES[symbol.kind])[:count]
            for symbol, row in program.rows.items()
        }
        self._inputs = [self._values[symbol] for symbol in program.inputs]
        self._parts = [
            (function, [self._values[symbol] for symbol in part])
            for function, part in zip(program.functions, program.parts, strict=True)
        ]

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
        function, values = self._parts[part]
        function(*self._arguments)
        return values
