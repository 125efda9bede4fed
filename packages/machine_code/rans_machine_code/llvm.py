"""Functions of vectors as machine code of this processor, by LLVM through llvmlite, which numba brings.

Users print only through `Code`. Arithmetic rounds as IEEE 754 says, functions are good to some units in the last
place, and both are the same on every processor.
"""

from __future__ import annotations

import contextlib
import ctypes
import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

from llvmlite import binding, ir

from rans.extend import ACTIVATIONS, Dialect, Symbol, ordered

Value = Any
"""A value of LLVM, or a number of Python: llvmlite has no types."""
FEATURES = binding.get_host_cpu_features().flatten()
"""Features of this processor, as LLVM writes them: "+avx2,-avx512f,..."."""
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
# Cephes' (Moshier, 1989) of the sine and the cosine within pi/4, and of the arc tangent within tan(pi/8).
_SINE = (-1.9515295891e-4, 8.3321608736e-3, -1.6666654611e-1)
_COSINE = (2.443315711809948e-5, -1.388731625493765e-3, 4.166664568298827e-2)
_TANGENT = (8.05374449538e-2, -1.38776856032e-1, 1.99777106478e-1, -3.33329491539e-1)
_MAGIC = 1.5 * 2**23
"""Added to a float32 it leaves the nearest whole number in the last bits."""
_SATURATED = 7.90531110763549805
"""Argument from which the hyperbolic tangent is 1 in float32, as Eigen has it (Eigen/src/Core/MathFunctionsImpl.h,
ptanh_float)."""


LLVM = Dialect(
    "LLVM",
    texts={
        **{"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv", "neg": "fneg", "where": "select"},
        **{sign: f"fcmp_ordered {sign}" for sign in ("<", "<=", ">", ">=", "==")},
        "!=": "fcmp_unordered !=",
        **{name: f"real_function {name}" for name in ("abs", "sqrt", "floor")},
        **{name: name for name in ("sin", "cos", "tanh", "exp", "log", "log1p", "atan2")},
        **{"maximum": "larger", "minimum": "smaller"},
    },
    ints={
        **{"+": "add", "-": "sub", "*": "mul", "neg": "neg", ">>": "ashr", "abs": "size"},
        **{"&": "and_", "|": "or_", "^": "xor", "real": "to_real"},
        **{sign: f"icmp_signed {sign}" for sign in ("<", "<=", ">", ">=", "==", "!=")},
    },
    bools={
        **{"&": "and_", "|": "or_", "^": "xor", "real": "to_real"},
        **{sign: f"icmp_signed {sign}" for sign in ("==", "!=")},
    },
)
"""Methods of `Code`, each with its first argument, which write an operation on vectors of float32, of whole numbers
and of truth values."""


def constant(value: float) -> Value:
    """A vector of one number or truth value; the same object for each, which is written faster."""
    return _constant(value, math.copysign(1.0, value))


@lru_cache(4096, typed=True)
def _constant(value: float, _sign: float) -> Value:
    """A vector of one number; zeros of both signs are equal keys, so that the sign is another."""
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
        """The number x clipped to the interval from low to high; NaN stays."""
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

    def log(self, x: Value) -> Value:
        """The logarithm, which is minus infinity at zero and not a number below."""
        bits = self.bitcast(x, INTS)
        # x = m 2^k, m within a factor sqrt(2) of 1.
        power = self.ashr(self.sub(bits, constant(0x3F3504F3)), constant(23))
        m = self.bitcast(self.sub(bits, self.shl(power, constant(23))), FLOATS)
        one = self.everywhere(1.0)
        rest = self._twice_artanh(self.fdiv(self.fsub(m, one), self.fadd(m, one)))
        result = self.times_plus(self.to_real(power), self.everywhere(math.log(2.0)), rest)
        beyond = self.fsub(self.real_function("sqrt", x), self.everywhere(math.inf))
        return self.select(self.fcmp_ordered(">", x, self.everywhere(0.0)), result, beyond)

    def log1p(self, x: Value) -> Value:
        """log(1 + x): near 0 by a series, elsewhere, where 1 + x keeps the digits of x, by `log`."""
        one = self.everywhere(1.0)
        series = self._twice_artanh(self.fdiv(x, self.fadd(x, self.everywhere(2.0))))
        near = self.fcmp_ordered("<=", self.real_function("abs", x), self.everywhere(0.5))
        return self.select(near, series, self.log(self.fadd(one, x)))

    def _twice_artanh(self, z: Value) -> Value:
        """2 artanh(z) = log((1 + z) / (1 - z)) of numbers within 1/3, by its series."""
        return self.fmul(z, self._polynomial(self.fmul(z, z), [2 / k for k in range(15, 0, -2)]))

    def sin(self, x: Value) -> Value:
        """The sine, within 1e-7 up to 1e6 rad.

        Beyond 6e6 rad, where float32 lie half a radian apart, it is some number from -1 to 1.
        """
        return self._sine_of(x, 0)

    def cos(self, x: Value) -> Value:
        """The cosine, as good as `sin`."""
        return self._sine_of(x, 1)

    def _sine_of(self, x: Value, quarters: int) -> Value:
        """The sine of an angle and so many quarters of a turn."""
        # Cody and Waite's reduction to pi/4: pi/2 is a sum of three floats.
        magic = self.everywhere(_MAGIC)
        shifted = self.times_plus(x, self.everywhere(2.0 / math.pi), magic)
        turns = self.fsub(shifted, magic)
        for part in (-1.5707962513e0, -7.5497894159e-8, -5.3903029534e-15):
            x = self.times_plus(turns, self.everywhere(part), x)
        # Angles beyond 2^22 quarters of a turn are not reduced: their powers would overflow.
        x = self.within(x, -1.0, 1.0)
        square = self.fmul(x, x)
        sine = self.times_plus(self._polynomial(square, _SINE), self.fmul(square, x), x)
        cosine = self.times_plus(
            self._polynomial(square, _COSINE),
            self.fmul(square, square),
            self.times_plus(square, self.everywhere(-0.5), self.everywhere(1.0)),
        )
        number = self.add(self.bitcast(shifted, INTS), constant(quarters))
        size = self.select(self.to_bool(self.and_(number, constant(1))), cosine, sine)
        return self.select(self.to_bool(self.and_(number, constant(2))), self.fneg(size), size)

    def atan2(self, y: Value, x: Value) -> Value:
        """The angle of a vector (x, y), from -pi to pi; of one that is shorter than 1e-30, some angle."""
        a, b = (self.real_function("abs", each) for each in (y, x))
        least = self.everywhere(1e-30)  # so that the angle of no vector is 0
        # A number that is none stays in one of both: `smaller` gives its first then, and so does `larger`.
        t = self.fdiv(self.smaller(a, b), self.larger(self.larger(b, a), least))
        # Within tan(pi/8), or turned by pi/4.
        one = self.everywhere(1.0)
        far = self.fcmp_ordered(">", t, self.everywhere(math.sqrt(2.0) - 1.0))
        t = self.select(far, self.fdiv(self.fsub(t, one), self.fadd(t, one)), t)
        square = self.fmul(t, t)
        angle = self.times_plus(self._polynomial(square, _TANGENT), self.fmul(square, t), t)
        angle = self.fadd(angle, self.select(far, self.everywhere(math.pi / 4), constant(0.0)))
        # Into the octant, the half and the sign of the vector.
        for is_other, of in (
            (self.fcmp_ordered(">", a, b), math.pi / 2),
            (self.icmp_signed("<", self.bitcast(x, INTS), constant(0)), math.pi),
        ):
            angle = self.select(is_other, self.fsub(self.everywhere(of), angle), angle)
        return self.intrinsic(f"llvm.copysign.v{LANES}f32", angle, y)

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
        return self.computed([ACTIVATIONS[name].formula(symbol)], {symbol: x})[0]

    def operation(self, symbol: Symbol, operands: Sequence[Value]) -> Value:
        """What a symbol is, of its operands; `rans.model.operations.Untraceable` where there is no code for it."""
        kind = symbol.operand_kind
        method, *given = LLVM.pattern(symbol.operation, kind).split()
        chosen = symbol.operation == "where"
        converted = [
            value
            if arg.kind == kind or (chosen and k == 0)
            else self.to_real(value)
            if kind == "real"
            else self.zext(value, INTS)
            for k, (arg, value) in enumerate(zip(symbol.args, operands, strict=True))
        ]
        return getattr(self, method)(*given, *converted)

    def real_function(self, name: str, x: Value) -> Value:
        """A function of LLVM on vectors of float32."""
        return self.intrinsic(f"llvm.{name.replace('abs', 'fabs')}.v{LANES}f32", x)

    def to_real(self, x: Value) -> Value:
        """Whole numbers, or truth values, as float32."""
        return self.uitofp(x, FLOATS) if x.type == BOOLS else self.sitofp(x, FLOATS)

    def to_bool(self, x: Value) -> Value:
        """Whether whole numbers are not zero."""
        return self.icmp_signed("!=", x, constant(0))

    def size(self, x: Value) -> Value:
        """Whole numbers without their signs."""
        return self.larger(x, self.neg(x))

    def larger(self, a: Value, b: Value) -> Value:
        """The larger of two numbers; the first where one of them is not a number."""
        return self.select(self._less(a, b), b, a)

    def smaller(self, a: Value, b: Value) -> Value:
        """The smaller of two numbers; the first where one of them is not a number."""
        return self.select(self._less(b, a), b, a)

    def _less(self, a: Value, b: Value) -> Value:
        return (self.fcmp_ordered if a.type == FLOATS else self.icmp_signed)("<", a, b)

    def computed(self, roots: Sequence[Symbol], values: dict[Symbol, Value]) -> list[Value]:
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


def compiled(kinds: Sequence[ir.Type], *writes: Callable[..., object]) -> list[Any]:
    """Functions that Python may call without its lock; arguments are addresses and whole numbers.

    Args:
        kinds: of the arguments of each.
        *writes: prints one, given its `Code` and arguments; together they take LLVM less time.
    """
    module: Any = ir.Module()
    names = [f"run_{k}" for k in range(len(writes))]
    for name, write in zip(names, writes, strict=True):
        new = ir.Function(module, ir.FunctionType(ir.VoidType(), kinds), name)
        code = Code(new.append_basic_block())
        write(code, *new.args)
        code.ret_void()
    with contextlib.suppress(RuntimeError):  # newer versions do so themselves
        binding.initialize()
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    machine = binding.Target.from_default_triple().create_target_machine(
        cpu=binding.get_host_cpu_name(), features=FEATURES, opt=3, jit=True
    )
    engine: Any = binding.create_mcjit_compiler(binding.parse_assembly(str(module)), machine)
    engine.finalize_object()
    typed = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * len(kinds))
    functions = [typed(engine.get_function_address(name)) for name in names]
    for function in functions:
        vars(function)["engine"] = engine  # the code lives as long as they
    return functions
