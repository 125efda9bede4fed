"""Programs run by NumPy against the same functions on NumPy's arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rans_machine_code.program import CompiledProgram, ProgramMemory

from rans.model.fields import absolute, atan2, cos, exp, floor, log, sin, sqrt, where
from rans.model.trace import Symbol

COUNT = 50


def everything(a: Any, b: Any, n: Any) -> tuple[Any, ...]:
    """Every operation there is, with values that are used late, early, and by several."""
    near = a < b
    odd = (n & 1) == 1
    low = where(near, a, b)
    chosen = where(odd, where(near, 1.0, -2.0), low * 0.5)
    count = where(odd & ~near, n * 1664525 + 7, n ^ (n >> 3))
    root = sqrt(absolute(a)) + log(exp(b) + 1.0)
    return (
        chosen + sin(root) * cos(low),
        atan2(root, low) - floor(a),
        count,
        near | odd,
        where(near, odd, b > 0.5),
        -root / (1.0 + low * low),
    )


def inputs() -> dict[Symbol, Any]:
    generator = np.random.default_rng(1)
    a, b = generator.normal(size=(2, COUNT)).astype(np.float32)
    return {
        Symbol.input("a"): a,
        Symbol.input("b"): b,
        Symbol.input("n", "int"): generator.integers(-(2**31), 2**31, COUNT).astype(np.int32),
    }


def test_every_operation() -> None:
    given = inputs()
    memory = CompiledProgram(tuple(given), everything(*given)).memory(COUNT)
    for _ in range(2):  # the second run finds what the first has left
        memory.give(given.values())
        for found, expected in zip(memory.run(0), everything(*given.values()), strict=True):
            assert found.dtype == (np.float32 if expected.dtype == np.float64 else expected.dtype)
            # The same operations, of numbers of order one, but for those that NumPy makes of float64.
            np.testing.assert_allclose(found, expected, rtol=0, atol=2e-6)


def test_a_later_part_uses_what_an_earlier_one_found() -> None:
    given = inputs()
    late: Any = Symbol.input("late")
    a, b, _ = tuple[Any, ...](given)
    first = (a * b, a + 1.0)
    second = ((a * b) * late, where(a > b, late, a + 1.0), a * b)
    memory = CompiledProgram((*given, late), first, second).memory(COUNT)
    x, y, _ = given.values()
    memory.give(given.values())
    np.testing.assert_array_equal(memory.run(0), (x * y, x + np.float32(1)))
    memory.put(late, 3.0)
    np.testing.assert_array_equal(
        memory.run(1), (x * y * 3, np.where(x > y, np.float32(3), x + 1), x * y)
    )


@pytest.mark.parametrize("asked", [0, 1])
def test_constants_and_inputs_may_be_asked_for(asked: int) -> None:
    a = Symbol.input("a")
    memory = CompiledProgram([a], [(Symbol.constant(2.5), a)[asked]]).memory(3)
    memory.give([np.arange(3)])
    np.testing.assert_array_equal(
        np.broadcast_to(memory.run(0)[0], 3), ([2.5] * 3, [0, 1, 2])[asked]
    )


def test_machine_code_finds_numpys_numbers_bit_by_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    """In two parts, also of what is no number."""
    given = inputs()
    late: Any = Symbol.input("late")
    a, b, n = symbols = tuple[Any, ...](given)
    first = everything(*symbols)
    second = everything(b, a, n + 1)
    program = CompiledProgram((*given, late), first, (*second, first[0] * late, first[-1] + late))
    numpy, machine = (program.memory(COUNT) for _ in range(2))
    for memory in (numpy, machine):
        memory.give(given.values())
        memory.put(a, np.where(np.arange(COUNT) < 3, np.nan, given[a]))
        memory.put(late, 3.0)

    def found(memory: ProgramMemory, often: int) -> list[np.ndarray]:
        monkeypatch.setattr("rans_machine_code.program._OFTEN", often)
        with np.errstate(all="ignore"):
            return [value.copy() for part in (0, 1) for value in memory.run(part)]

    expected = found(numpy, 10**9)
    for _ in range(3):  # machine code from the second on
        for value, other in zip(found(machine, 2), expected, strict=True):
            np.testing.assert_array_equal(value.view(np.uint8), other.view(np.uint8))
    assert len(machine._calls[0]) < len(numpy._calls[0]) / 2
