"""Arithmetic of a traced program as machine code, with the same results as NumPy's, bit by bit.

Every operation here is rounded as IEEE 754 says, alone, and so it is in NumPy; what is not, such as a sine,
stays NumPy's.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from llvmlite import ir

from rans.extend import Symbol
from rans.model.operations import OPERATIONS
from rans_machine_code.dialect import LLVM
from rans_machine_code.llvm import (
    BOOLS,
    FLOATS,
    INTS,
    LANES,
    LONG,
    POINTER,
    Code,
    MachineModule,
    Value,
    constant,
)

_BYTES = ir.VectorType(ir.IntType(8), LANES)
_KINDS = {"real": FLOATS, "int": INTS, "bool": _BYTES}


def is_arithmetic(symbol: Symbol) -> bool:
    """Whether an operation is one of those."""
    args = symbol.args[1:] if symbol.operation == "where" else symbol.args
    if len({arg.kind for arg in args}) > 1:  # NumPy computes those in double precision
        return False
    operation = OPERATIONS.get(symbol.operation)
    is_exact = operation is not None and operation.is_exact
    return is_exact and (symbol.operation, symbol.operand_kind) in LLVM


def in_phases(symbols: Iterable[Symbol]) -> list[Symbol]:
    """In another order, in which arithmetic comes in few stretches.

    Operands stay before what is made of them, and in the old order within a stretch.
    """
    phases = dict[Symbol, int]()
    order = list(symbols)
    arithmetic = {symbol: is_arithmetic(symbol) for symbol in order}
    for symbol in order:
        before = [
            phases[arg] + (arithmetic[symbol] and not arithmetic[arg])
            for arg in symbol.args
            if arg in phases
        ]
        phases[symbol] = max(before, default=0)
    return sorted(order, key=lambda symbol: (phases[symbol], not arithmetic[symbol]))


def write_function(
    program: MachineModule,
    name: str,
    symbols: Sequence[Symbol],
    rows: Mapping[Symbol, int],
    stored: set[Symbol],
) -> None:
    """Print a function that computes symbols, vector by vector, in the rows of a memory.

    Its arguments are the memory, the length of a row and the vectors in a row, all in numbers of 32 bits.

    Args:
        program: to which the function is added.
        name: of the function.
        symbols: symbols to compute, arithmetic only, in this order.
        rows: row of every symbol that is in memory; a result may overwrite a row that it is computed from.
        stored: results to write, which other functions read.
    """

    def body(code: Code, memory: Value, stride: Value, vectors: Value) -> None:
        """Print the loop over the vectors of a row.

        Rows of truth values hold a byte a value, in the first quarter of a row of 32-bit numbers.
        """

        def vector(number: Value, _: list[Value]) -> list[Value]:
            """Print the symbols for vector ``number``: loads where needed, stores of what ``stored`` names."""
            values = dict[Symbol, Value]()

            def address(symbol: Symbol) -> Value:
                first = code.mul(number, LONG(LANES))
                start = code.mul(LONG(rows[symbol]), stride)
                start = code.mul(start, LONG(4)) if symbol.kind == "bool" else start
                return code.at(memory, code.add(start, first), _KINDS[symbol.kind])

            def value(symbol: Symbol) -> Value:
                if symbol.operation == "constant":
                    return constant(symbol.value)
                if symbol not in values:
                    loaded = code.load(address(symbol), align=1)
                    values[symbol] = code.trunc(loaded, BOOLS) if symbol.kind == "bool" else loaded
                return values[symbol]

            # Results stay in registers, and are written only if others read them.
            for symbol in symbols:
                values[symbol] = code.operation(symbol, [value(arg) for arg in symbol.args])
                if symbol in stored:
                    loaded = values[symbol]
                    loaded = code.zext(loaded, _BYTES) if symbol.kind == "bool" else loaded
                    code.store(loaded, address(symbol), align=1)
            return []

        code.repeat(vectors, [], vector)

    program.function(name, (POINTER, LONG, LONG), body)
