"""Functions of vectors as machine code of this processor, by LLVM through llvmlite, which numba brings.

Users print only through `Code`, whose operations round as NumPy's do unless they say otherwise.
"""

from __future__ import annotations

import contextlib
import ctypes
import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from functools import lru_cache
from typing import Any

from llvmlite import binding, ir

from rans.extend import ACTIVATIONS, Symbol, ordered
from rans_machine_code.dialect import LLVM

Value = Any
"""Of LLVM, or a number of Python's: llvmlite has no types."""
FEATURES = binding.get_host_cpu_features().flatten()
"""Of this processor, as LLVM writes them: "+avx2,-avx512f,..."."""
LANES = 16
"""Numbers in a vector; LLVM cuts it into as many as the processor has."""
TILE, ROWS = (2, 8) if "+avx512f" in FEATURES else (1, 4)
"""Vectors that a product of matrices works on at a time, and rows of weights: their sums fill the registers.
Sums are the same, bit by bit, whatever they are."""

INT = ir.IntType(32)
LONG = ir.IntType(64)
FLOAT = ir.FloatType()
POINTER = ir.IntType(8).as_pointer()
INTS = ir.VectorType(INT, LANES)
BOOLS = ir.VectorType(ir.IntType(1), LANES)
FLOATS = ir.VectorType(FLOAT, LANES)

_NUMERATOR = (
    -2.76076847742355e-16,
    2.00018790482477e-13,
    -8.60467152213735e-11,
    5.12229709037114e-08,
    1.48572235717979e-05,
    6.37261928875436e-04,
    4.89352455891786e-03,
)
_DENOMINATOR = (
    1.19825839466702e-06,
    1.18534705686654e-04,
    2.26843463243900e-03,
    4.89352518554385e-03,
)
_EXPONENTIAL = (
    1.9875691500e-4,
    1.3981999507e-3,
    8.3334519073e-3,
    4.1665795894e-2,
    1.6666665459e-1,
    5.0000001201e-1,
)
_MAGIC = 1.5 * 2**23
"""Added to a float32 it leaves the nearest whole number in the last bits."""
_SATURATED = 7.90531110763549805
"""Of the hyperbolic tangent in float32: Eigen's (Eigen/src/Core/MathFunctionsImpl.h, ptanh_float)."""


@lru_cache(None, typed=True)
def constant(value: float) -> Value:
    """A vector of one number or truth value; the same object for each, which is written faster."""
    kind = {bool: BOOLS, int: INTS, float: FLOATS}[type(value)]
    return ir.Constant(kind, [value] * LANES)


class Code(ir.IRBuilder):
    """Writes a function on vectors."""

    def at(self, pointer: Value, index: Value, kind: ir.Type) -> Value:
        """Address in an array of a number of this 32-bit kind, or of the vector that begins with it."""
        number = kind.element if isinstance(kind, ir.VectorType) else kind
        index = LONG(index) if isinstance(index, int) else index
        address = self.gep(self.bitcast(pointer, number.as_pointer()), [index])
        return self.bitcast(address, kind.as_pointer())

    def read(self, pointer: Value, index: Value, kind: ir.Type = FLOATS) -> Value:
        """A number or vector from there."""
        return self.load(self.at(pointer, index, kind), align=4)

    def write(self, value: Value, pointer: Value, index: Value) -> None:
        """A number or vector to there."""
        self.store(value, self.at(pointer, index, value.type), align=4)

    def everywhere(self, value: Value) -> Value:
        """One number in every lane."""
        if isinstance(value, int | float):
            return constant(float(value))
        kind = ir.VectorType(value.type, LANES)
        element = self.insert_element(ir.Constant(kind, ir.Undefined), value, INT(0))
        return self.shuffle_vector(element, element, constant(0))

    def times_plus(self, a: Value, b: Value, c: Value) -> Value:
        """The sum a b + c, rounded once."""
        return self.intrinsic(f"llvm.fma.v{LANES}f32", a, b, c)

    def intrinsic(self, name: str, *values: Value) -> Value:
        """LLVM's function of this name on values of one kind."""
        function = self.module.globals.get(name) or ir.Function(
            self.module, ir.FunctionType(values[0].type, [x.type for x in values]), name
        )
        return self.call(function, values)

    def within(self, x: Value, low: float, high: float) -> Value:
        """No further than the bounds."""
        bounds = self.everywhere(low), self.everywhere(high)
        x = self.select(self.fcmp_ordered("<", x, bounds[0]), bounds[0], x)
        return self.select(self.fcmp_ordered(">", x, bounds[1]), bounds[1], x)

    def tanh(self, x: Value) -> Value:
        """The hyperbolic tangent to four units in the last place."""
        x = self.within(x, -_SATURATED, _SATURATED)
        square = self.fmul(x, x)
        above, below = (self._polynomial(square, each) for each in (_NUMERATOR, _DENOMINATOR))
        return self.fdiv(self.fmul(x, above), below)

    def exp(self, x: Value) -> Value:
        """The exponential of numbers x below 88; below -87 its value there. Cephes' expf.

        Activations made of it agree with NumPy's within 8 units in the last place
        (`tests/test_llvm.py`).
        """
        x = self.within(x, -87.0, 88.0)
        magic = self.everywhere(_MAGIC)
        rounded = self.times_plus(x, self.everywhere(math.log2(math.e)), magic)
        whole = self.fsub(rounded, magic)
        rest = self.times_plus(whole, self.everywhere(-0.693359375), x)
        rest = self.times_plus(whole, self.everywhere(2.12194440e-4), rest)
        value = self.times_plus(
            self._polynomial(rest, _EXPONENTIAL),
            self.fmul(rest, rest),
            self.fadd(rest, self.everywhere(1.0)),
        )
        # The whole number stands in the last bits of what moved it there.
        power = self.shl(self.bitcast(rounded, INTS), constant(23))
        return self.bitcast(self.add(self.bitcast(value, INTS), power), FLOATS)

    def log_one_plus(self, x: Value) -> Value:
        """log(1 + x) of numbers from 0 to 1, as 2 artanh(x / (2 + x)) by its series."""
        z = self.fdiv(x, self.fadd(x, self.everywhere(2.0)))
        return self.fmul(z, self._polynomial(self.fmul(z, z), [2 / k for k in range(15, 0, -2)]))

    def total(self, x: Value) -> Value:
        """The sum of a vector's `LANES` numbers, always by halves, so that runs agree bit by bit."""
        count = LANES
        while count > 1:
            count //= 2
            kind = ir.VectorType(INT, count)
            low, high = (
                self.shuffle_vector(x, x, ir.Constant(kind, [*range(first, first + count)]))
                for first in (0, count)
            )
            x = self.fadd(low, high)
        return self.extract_element(x, INT(0))

    def _polynomial(self, x: Value, coefficients: Sequence[float]) -> Value:
        """Highest power first."""
        result = self.everywhere(coefficients[0])
        for coefficient in coefficients[1:]:
            result = self.times_plus(result, x, self.everywhere(coefficient))
        return result

    def activation(self, name: str, x: Value) -> Value:
        """One of `rans.policy.activations.ACTIVATIONS`, or none (""); it is torch's to rounding."""
        match name:
            case "tanh":
                return self.tanh(x)
            case "relu":
                return self.select(
                    self.fcmp_ordered(">", x, self.everywhere(0.0)), x, self.everywhere(0.0)
                )
            case "elu":  # e^x - 1 = 2 t / (1 - t), t = tanh(x / 2)
                half = self.tanh(self.fmul(x, self.everywhere(0.5)))
                below = self.fdiv(self.fadd(half, half), self.fsub(self.everywhere(1.0), half))
                return self.select(self.fcmp_ordered(">", x, self.everywhere(0.0)), x, below)
            case "":
                return x
        symbol = Symbol.input("x")
        return self.evaluated([ACTIVATIONS[name].formula(symbol)], {symbol: x})[0]

    def operation(self, symbol: Symbol, operands: Sequence[Value]) -> Value:
        """What a symbol is, of its operands; `rans.model.operations.Untraceable` where there is no code for it."""
        method, *given = LLVM.pattern(symbol.operation, symbol.operand_kind).split()
        return getattr(self, method)(*given, *operands)

    def real_function(self, name: str, x: Value) -> Value:
        """A function of LLVM on vectors of float32."""
        return self.intrinsic(f"llvm.{name}.v{LANES}f32", x)

    def to_real(self, x: Value) -> Value:
        """Whole numbers as float32."""
        return self.sitofp(x, FLOATS)

    def larger(self, a: Value, b: Value) -> Value:
        """The larger of two numbers; the first where one of them is not a number."""
        return self.select(self.fcmp_ordered("<", a, b), b, a)

    def smaller(self, a: Value, b: Value) -> Value:
        """The smaller of two numbers; the first where one of them is not a number."""
        return self.select(self.fcmp_ordered(">", a, b), b, a)

    def evaluated(self, roots: Sequence[Symbol], values: Mapping[Symbol, Value]) -> list[Value]:
        """Vectors of the roots, from those of their inputs."""
        return self.extended(roots, dict(values))

    def extended(self, roots: Sequence[Symbol], values: dict[Symbol, Value]) -> list[Value]:
        """Vectors of the roots; those of every symbol on the way to them are added to ``values``."""
        for symbol in ordered(roots, values):
            if symbol.operation == "constant":
                values[symbol] = constant(symbol.value)
            else:
                values[symbol] = self.operation(symbol, [values[arg] for arg in symbol.args])
        return [values[root] for root in roots]

    def repeat(
        self,
        count: Value,
        initial: Sequence[Value],
        body: Callable[[Value, list[Value]], Sequence[Value]],
    ) -> list[Value]:
        """Run the body for 0, 1, ... count - 1 with the values it returned before; at least once.

        All that is printed after the call stands behind the loop. A body may print blocks of its own, such as a
        loop.
        """
        before = self.block
        inside = self.append_basic_block()
        self.branch(inside)
        self.position_at_end(inside)
        number = self.phi(LONG)
        values = [self.phi(value.type) for value in initial]
        for phi, value in zip([number, *values], [LONG(0), *initial], strict=True):
            phi.add_incoming(value, before)
        result = list(body(number, [*values]))
        following = self.add(number, LONG(1))
        for phi, value in zip([number, *values], [following, *result], strict=True):
            phi.add_incoming(value, self.block)
        after = self.append_basic_block()
        last = LONG(count) if isinstance(count, int) else count
        self.cbranch(self.icmp_unsigned("<", following, last), inside, after)
        self.position_at_end(after)
        return result

    def groups(self, count: int, size: int, body: Callable[[Value, int], object]) -> None:
        """Run the body for 0, size, ... with how many of the count are left of there, at most a group."""

        def group(number: Value, _: list[Value]) -> list[Value]:
            body(self.mul(number, LONG(size)), size)
            return []

        if count >= size:
            self.repeat(count // size, [], group)
        if count % size:
            body(LONG(count - count % size), count % size)


class MachineModule:
    """Functions that Python may call without its lock."""

    def __init__(self) -> None:
        self._module: Any = ir.Module()
        self._engine = None
        self._arguments = dict[str, int]()

    def function(self, name: str, kinds: Sequence[ir.Type], write: Callable[..., object]) -> None:
        """Add one; ``write`` is given its `Code` and arguments."""
        new = ir.Function(self._module, ir.FunctionType(ir.VoidType(), kinds), name)
        self._arguments[name] = len(kinds)
        code = Code(new.append_basic_block())
        write(code, *new.args)
        code.ret_void()

    def compiled(self, name: str) -> Callable[..., None]:
        """The function of this name, when all are there; arguments are addresses and whole numbers.

        It lives as long as the program. The first call compiles the module, after which no function can be added.
        """
        if self._engine is None:
            # which is larger than the code
            self._engine = _engine(str(self._module))
            self._module = None
        kinds = [ctypes.c_int64] * self._arguments[name]
        return ctypes.CFUNCTYPE(None, *kinds)(self._engine.get_function_address(name))


_SHARED: dict[Hashable, tuple[MachineModule, Callable[..., None]]] = {}
"""Of this process."""


def shared(
    name: str, alike: Hashable, kinds: Sequence[ir.Type], write: Callable[..., object]
) -> Callable[..., None]:
    """A function that is written once for all that are alike: that takes longer than hundreds of calls.

    Args:
        name: of the function.
        alike: everything else that it depends on.
        kinds: see `MachineModule.function`.
        write: see there.
    """
    if (name, alike) not in _SHARED:
        program = MachineModule()
        program.function(name, kinds, write)
        _SHARED[name, alike] = program, program.compiled(name)
    return _SHARED[name, alike][1]


@lru_cache(64)
def _engine(text: str) -> Any:
    """Machine code of a module as LLVM writes it: often the same in one process, and never changed."""
    with contextlib.suppress(RuntimeError):  # newer versions do so themselves
        binding.initialize()
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    machine = binding.Target.from_default_triple().create_target_machine(
        cpu=binding.get_host_cpu_name(), features=FEATURES, opt=3, jit=True
    )
    engine = binding.create_mcjit_compiler(binding.parse_assembly(text), machine)
    engine.finalize_object()
    return engine
