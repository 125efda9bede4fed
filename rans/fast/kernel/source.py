"""The text of a step's kernel in CUDA C++, from its program.

One thread steps one spacecraft. Reads come first, so that they all wait together; each value is stored as
soon as it is known, which frees its register.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from importlib.resources import files
from typing import Literal

from rans.fast.kernel.program import Program, Store
from rans.fast.kernel.trace import Symbol, ordered

Real = Literal["float", "double"]
Action = Literal["unsigned char", "float", "double"]
"""What an action holds for each thruster: a byte, zero for shut, or a real."""

THREADS = 128
"""Of a block."""

_FUNCTIONS = {"sin": "sine", "cos": "cosine", "exp": "exponential", "minimum": "min", "maximum": "max",
              "abs": "abs", "floor": "floor", "sqrt": "sqrt", "atan2": "atan2", "real": "real"}
_BYTES = {"unsigned char": 1, "float": 4, "double": 8}


def source(program: Program, thrusters: int, action: Action, real: Real) -> str:
    """CUDA C++ of a kernel ``step``.

    Its arguments are the action, the seed's low and high word, the results' reals, final observations and
    flags, the memory, the settings, the number of spacecraft and the stride of their episodes' numbers.

    Args:
        program: what to compute.
        thrusters: number of columns of an action, whose rows follow one another.
        action: what an action holds.
        real: what reals are.
    """
    arguments = (
        f"const {action}* action", "const int* low_at", "const int* high_at",
        "real* reals", "real* final", "bool* flags",
        *(f"{given.type}* {given.symbol.value}_at" for given in (*program.memory, *program.settings)),
        "const int count", "const int stride")
    return "\n".join((
        f"typedef {real} real;",
        files("rans.fast.kernel").joinpath("functions.cuh").read_text(),
        f'extern "C" __global__ void __launch_bounds__({THREADS}) step(',
        f"    {', '.join(arguments)}) {{",
        *(f"  {line}" for line in _Writer(program).body(thrusters, action)),
        "}\n",
    ))


class _Writer:
    """Writes lines and remembers which symbols have a name by then."""

    def __init__(self, program: Program) -> None:
        self._program = program
        self._names: dict[Symbol, str] = {}

    def body(self, thrusters: int, action: Action) -> Iterator[str]:
        program = self._program
        everywhere = set(ordered([program.ended, *(store.value for store in program.always)]))
        at_end = set(ordered(store.value for store in program.at_end)) - everywhere
        yield "const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;"
        yield "if (i >= count) return;"
        yield "const size_t rows = count;"
        yield from _commands(thrusters, action)
        yield from self._loads(everywhere)
        yield from self._stores(program.always)
        yield from self._values([program.ended])
        yield f"if ({self._names[program.ended]}) {{"
        for line in (*self._loads(at_end), *self._stores(program.at_end)):
            yield f"  {line}"
        yield "}"

    def _loads(self, used: set[Symbol]) -> Iterator[str]:
        """Of those inputs that are used."""
        places = {given.symbol: "[i]" for given in self._program.memory}
        shared = (*(given.symbol for given in self._program.settings),
                  Symbol.input("low", "int"), Symbol.input("high", "int"))
        places |= dict.fromkeys(shared, "[0]")
        yield from (f"const {symbol.kind} {symbol.value} = {symbol.value}_at{place};"
                    for symbol, place in places.items() if symbol in used)

    def _stores(self, stores: Iterable[Store]) -> Iterator[str]:
        for store in stores:
            yield from self._values([store.value])
            yield f"{self._place(store)} = {self._operand(store.value)};"

    def _place(self, store: Store) -> str:
        if store.array == "memory":
            return f"memory_{store.row}_at[i]"
        if store.array == "final":
            return f"final[size_t(i) * {self._program.shape.width} + {store.row}]"
        return f"{store.array}[{store.row} * rows + i]"

    def _values(self, roots: Iterable[Symbol]) -> Iterator[str]:
        """Lines that give names to the roots and to what they are made of."""
        for symbol in ordered(roots):
            if symbol in self._names or symbol.operation == "constant":
                continue
            if symbol.operation == "input":
                self._names[symbol] = symbol.value
                continue
            expression = _expression(symbol, [self._operand(arg) for arg in symbol.args])
            self._names[symbol] = name = f"x{len(self._names)}"
            yield f"const {symbol.kind} {name} = {expression};"

    def _operand(self, symbol: Symbol) -> str:
        if symbol.operation != "constant":
            return self._names[symbol]
        number = repr(symbol.value)
        return {"real": f"real({number})", "bool": number.lower()}.get(symbol.kind, number)


def _expression(symbol: Symbol, args: list[str]) -> str:
    operation = symbol.operation
    if operation == "neg":
        return f"-{args[0]}"
    if operation == "where":
        return "{} ? {} : {}".format(*args)
    if operation in _FUNCTIONS:
        return f"{_FUNCTIONS[operation]}({', '.join(args)})"
    if symbol.kind == "int" and operation in ("+", "-", "*"):  # signed arithmetic may not wrap around in C
        return f"int(unsigned({args[0]}) {operation} unsigned({args[1]}))"
    return f"{args[0]} {operation} {args[1]}"


def _commands(thrusters: int, action: Action) -> Iterator[str]:
    """Commands as reals, from pieces as large as one instruction reads: 16 bytes at most."""
    piece = math.gcd(thrusters * _BYTES[action], 16)
    if action != "unsigned char" or piece < 4:
        yield from _numbers(thrusters, action, max(1, piece // _BYTES[action]))
        return
    words = piece // 4
    pieces = thrusters // piece
    yield from (f"const uint{words} piece_{p} = reinterpret_cast<const uint{words}*>(action)"
                f"[size_t(i) * {pieces} + {p}];" for p in range(pieces))
    for k in range(thrusters):
        word = f"piece_{k // piece}.{'xyzw'[k % piece // 4]}"
        yield f"const real command_{k} = {word} & {0xFF << 8 * (k % 4)}u ? 1 : 0;"


def _numbers(thrusters: int, action: Action, members: int) -> Iterator[str]:
    """The same where each is a number of its own."""
    kind = f"{'uchar' if action == 'unsigned char' else action}{members}"
    pieces = thrusters // members
    yield from (f"const {kind} piece_{p} = reinterpret_cast<const {kind}*>(action)"
                f"[size_t(i) * {pieces} + {p}];" for p in range(pieces))
    convert = " ? 1 : 0" if action == "unsigned char" else ""
    yield from (f"const real command_{k} = piece_{k // members}.{'xyzw'[k % members]}{convert};"
                for k in range(thrusters))
