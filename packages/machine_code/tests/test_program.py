"""Programs against the same functions on NumPy's arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rans_machine_code import program
from rans_machine_code.program import CompiledProgram

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


def test_every_operation(monkeypatch):
    """Interpreted, and then, of the same bits, as one function."""
    monkeypatch.setattr(program, "_OFTEN", 1)
    given = inputs()
    memory = CompiledProgram(tuple(given), everything(*given)).memory(COUNT)
    given[next(iter(given))][:3] = np.nan
    memory.give(given.values())
    with np.errstate(invalid="ignore"):
        right = everything(*given.values())
    interpreted = [np.copy(x) for x in memory.run(0)]
    for found, expected in zip(interpreted, right, strict=True):
        # Numbers of order one.
        np.testing.assert_allclose(found, expected, rtol=0, atol=2e-6)
    np.testing.assert_array_equal(memory.run(0), interpreted)


@pytest.mark.parametrize("often", [0, 1000])
def test_a_later_part_uses_what_an_earlier_one_found(often, monkeypatch):
    """As functions, and interpreted."""
    monkeypatch.setattr(program, "_OFTEN", often)
    given = inputs()
    late = Symbol.input("late")
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
def test_constants_and_inputs_may_be_asked_for(asked):
    a = Symbol.input("a")
    memory = CompiledProgram([a], [(Symbol.constant(2.5), a)[asked]]).memory(3)
    memory.give([np.arange(3)])
    np.testing.assert_array_equal(
        np.broadcast_to(memory.run(0)[0], 3), ([2.5] * 3, [0, 1, 2])[asked]
    )
