from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rans import TASKS, Engine, GoToPose, Spacecraft
from rans.compile.step_program import StepProgram, trace_step
from rans.model.fields import absolute, at_least, cos, where, wrap
from rans.model.random import hash4
from rans.model.trace import Symbol, Untraceable, ordered, substituted
from tests.support.crafts import ANY_CRAFT
from tests.support.engines import FLYER, PLATFORM

x: Any = Symbol.input("x")
y: Any = Symbol.input("y")
n: Any = Symbol.input("n", "int")
number: Any = Symbol.constant


def test_the_same_operation_is_one_symbol():
    assert x * y + 1.0 is 1.0 + y * x
    assert x - y is not y - x
    assert cos(x) is cos(x)
    assert where(x > y, x, y) is where(x > y, x, y)


@pytest.mark.parametrize(
    ("folded", "expected"),
    [
        (x + 0.0, x),
        (x - 0, x),
        (0.0 - x, -x),
        (x * 1, x),
        (x * -1.0, -x),
        (-(0.0 - x), x),
        (x / 1.0, x),
        (x / 4.0, x * 0.25),
        (np.float64(2.0) * x, x * 2.0),
        (where(x > y, x, x), x),
        (where(number(True), x, y), x),
        (where(number(False), x, y), y),
        (n.to(None).to(None), n.to(None)),
        ((x > y) & True, x > y),
        ((x > y) | False, x > y),
        (n >> 0, n),
        (n ^ 0, n),
    ],
)
def test_what_needs_no_operation_is_none(folded, expected):
    assert folded is expected


@pytest.mark.parametrize(
    ("folded", "value"),
    [
        (x * 0.0, 0.0),
        (n * 0 + 7, 7),
        (number(2**30) * 4, 0),
        (number(2**31 - 1) + 1, -(2**31)),
        (absolute(number(-2.0)), 2.0),
        (at_least(number(0.5), 1.0), 1.0),
        (wrap(number(1.5 * math.pi)), -0.5 * math.pi),
        ((x > y) & False, False),
        ((x > y) | True, True),
    ],
)
def test_what_is_known_is_a_constant(folded, value):
    assert folded.operation == "constant"
    assert folded.value == pytest.approx(value, abs=1e-15)


def test_random_words_of_constants_wrap_around_as_numpys():
    counters = (3, 2**31 - 1, -5, 123456789)
    with np.errstate(over="ignore"):
        expected = hash4(*(np.array([c], dtype=np.int32) for c in counters))
    assert [w.value for w in hash4(*map(number, counters))] == [int(w[0]) for w in expected]


def test_operands_come_before_operations():
    roots = [cos(x * y) + x, x * y]
    seen = set()
    for symbol in ordered(roots):
        assert symbol not in seen
        assert seen.issuperset(symbol.args)
        seen.add(symbol)
    assert len(seen) == 5
    assert seen.issuperset(roots)


def test_a_known_condition_simplifies_what_depends_on_it():
    ended = x > 1.0
    chosen = where(ended, y, x) * 2.0
    assert substituted([chosen, y], {ended: number(True)}) == [y * 2.0, y]
    assert substituted([chosen], {ended: number(False)})[0] is x * 2.0


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: bool(x > 0.0),
        lambda: max(x, y),
        lambda: float(x),
        lambda: math.sin(x),
        lambda: np.sin(x),
        lambda: x + "1",
        lambda: x * np.ones(3),
    ],
)
def test_what_is_no_field_arithmetic_is_refused(wrong):
    with pytest.raises(TypeError):
        wrong()


# The programs


def traced(craft: Spacecraft, task: Any) -> StepProgram:
    engine = Engine(craft, task, 2)
    return trace_step(engine._world, engine.episode, engine.dtype)


def operations(symbols: Any) -> set[Symbol]:
    return {s for s in ordered(symbols) if s.operation not in ("input", "constant")}


def count(program: StepProgram) -> tuple[int, int]:
    """Operations of a step without ends, and those on top of them because there are some."""
    going = operations([program.ended, *(store.value for store in program.going())])
    every = operations(store.value for store in (*program.always, *program.at_end))
    return len(going), len(every - going)


@pytest.mark.parametrize(
    ("craft", "single", "multi"),
    [
        (PLATFORM, (222, 145), (337, 620)),
        (FLYER, (900, 430), (1030, 1405)),
    ],
    ids=["plane", "space"],
)
def test_no_program_grows_unseen(craft, single, multi):
    """Bounds a tenth above the longest of the tasks; raise them when a step has more to do."""
    for name in ANY_CRAFT:
        task = TASKS[name]
        always, at_end = count(traced(craft, task()))
        most = multi if name == "multi-task" else single
        if name in ("avoid", "dock-port"):  # zones and cones at four instants of a period
            most = (3600, 1200)
        assert (always <= most[0], at_end <= most[1]) == (True, True), (name, always, at_end)


def test_a_task_that_branches_is_not_traced():
    class Branching(GoToPose):
        def failed(self, state: Any, goal: Any) -> Any:
            return state.p.x > 1.0 if state.p.x > 0.0 else state.p.x < -1.0

    engine = Engine(PLATFORM, GoToPose(), 2)
    setup = engine._world.setup._replace(task=Branching())
    world = replace(engine._world, setup=setup)
    with pytest.raises(Untraceable):
        trace_step(world, engine.episode, engine.dtype)
