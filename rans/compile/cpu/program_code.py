"""Arithmetic of a traced program as machine code, with the same results as NumPy's, bit by bit.

Every operation here is rounded as IEEE 754 says, alone, and so it is in NumPy; what is not, such as a sine,
stays NumPy's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from llvmlite import ir

from rans.compile.cpu.llvm import (
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
from rans.model.trace import Symbol

_BOOLS, _BYTES = (ir.VectorType(ir.IntType(bits), LANES) for bits in (1, 8))
_KINDS = {"real": FLOATS, "int": INTS, "bool": _BYTES}
_REAL: dict[str, Callable[..., Value]] = {
    "+": Code.fadd,
    "-": Code.fsub,
    "*": Code.fmul,
    "/": Code.fdiv,
    "neg": Code.fneg,
    **{
        name: lambda code, x, called=called: code.intrinsic(f"llvm.{called}.v{LANES}f32", x)
        for name, called in (("abs", "fabs"), ("sqrt", "sqrt"), ("floor", "floor"))
    },
    **{
        sign: lambda code, a, b, sign=sign: code.fcmp_ordered(sign, a, b)
        for sign in ("<", "<=", ">", ">=", "==")
    },
    "!=": lambda code, a, b: code.fcmp_unordered("!=", a, b),
}
_INT: dict[str, Callable[..., Value]] = {
    "+": Code.add,
    "-": Code.sub,
    "*": Code.mul,
    "neg": Code.neg,
    ">>": Code.ashr,
    "&": Code.and_,
    "|": Code.or_,
    "^": Code.xor,
    "real": lambda code, x: code.sitofp(x, FLOATS),
    **{
        sign: lambda code, a, b, sign=sign: code.icmp_signed(sign, a, b)
        for sign in ("<", "<=", ">", ">=", "==", "!=")
    },
}
_BOOL: dict[str, Callable[..., Value]] = {
    "&": Code.and_,
    "|": Code.or_,
    "^": Code.xor,
    "==": lambda code, a, b: code.icmp_signed("==", a, b),
}
_TABLES = {"real": _REAL, "int": _INT, "bool": _BOOL}


def is_arithmetic(symbol: Symbol) -> bool:
    """Whether an operation is one of those."""
    args = symbol.args[1:] if symbol.operation == "where" else symbol.args
    if len({arg.kind for arg in args}) > 1:  # NumPy computes those in double precision
        return False
    return symbol.operation == "where" or symbol.operation in _TABLES[args[0].kind]


def in_phases(symbols: Iterable[Symbol]) -> list[Symbol]:
    """In another order, in which arithmetic comes in few stretches."""
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
        def vector(number: Value, _: list[Value]) -> list[Value]:
            values = dict[Symbol, Value]()

            def address(symbol: Symbol) -> Value:
                first = code.mul(number, LONG(LANES))
                start = code.mul(LONG(rows[symbol]), stride)
                start = code.mul(start, LONG(4)) if symbol.kind == "bool" else start
                return code.at(memory, code.add(start, first), _KINDS[symbol.kind])

            def value(symbol: Symbol) -> Value:
                if symbol.operation == "constant":
                    return (
                        ir.Constant(_BOOLS, [symbol.value] * LANES)
                        if symbol.kind == "bool"
                        else constant(symbol.value)
                    )
                if symbol not in values:
                    loaded = code.load(address(symbol), align=1)
                    values[symbol] = code.trunc(loaded, _BOOLS) if symbol.kind == "bool" else loaded
                return values[symbol]

            # Results stay in registers, and are written only if others read them.
            for symbol in symbols:
                args = [value(arg) for arg in symbol.args]
                values[symbol] = (
                    code.select(*args)
                    if symbol.operation == "where"
                    else _TABLES[symbol.args[0].kind][symbol.operation](code, *args)
                )
                if symbol in stored:
                    loaded = values[symbol]
                    loaded = code.zext(loaded, _BYTES) if symbol.kind == "bool" else loaded
                    code.store(loaded, address(symbol), align=1)
            return []

        code.repeat(vectors, [], vector)

    program.function(name, (POINTER, LONG, LONG), body)
