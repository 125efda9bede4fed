"""Predictions as straight-line Python: the engine's numbers, and NumPy's answers where a function has no value."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rans_missions.guard import FlownBackup
from rans_missions.guard.ahead import Ahead
from rans_missions.guard.backup import _Search
from rans_missions.guard.straight_line import StraightLine, few

from rans.episode import Setup, World
from rans.model.fields import (
    Vec2,
    absolute,
    at_least,
    floor,
    leaves,
    log,
    map_leaves,
    sqrt,
    where,
    within,
)
from rans.model.spacecraft_file import load_spacecraft
from rans.model.trace import Untraceable
from rans.scenario import scenarios
from rans.tasks import load_task


@pytest.mark.parametrize(
    ("task_name", "craft_name"),
    [
        ("avoid", "free-flyer"),
        ("dock-port", "atmos"),
        ("dock-port", "floating-platform"),
        ("hold", "vbar-chaser"),
        ("inspect", "afrl-deputy"),
    ],
)
def test_a_few_spacecraft_are_predicted_as_by_the_engine(task_name: str, craft_name: str) -> None:
    craft = load_spacecraft(craft_name)
    task = load_task(task_name)
    world = World(Setup(craft, task, task.timing))
    starts = scenarios(task, craft, seed=4, count=5)
    state, goal = map_leaves(lambda x: np.asarray(x, np.float64), (starts.start, starts.goal))
    random = np.random.default_rng(2)
    drawn = random.random((len(craft.commands), 5))
    command = tuple(drawn if craft.is_continuous else np.round(drawn))
    ahead = Ahead(world)
    assert few(state)

    # The same operations but for divisions by constants, so that only rounding differs.
    fast = ahead.fly(state, goal, command)
    slow = ahead._predicted(state, goal, command)
    assert ahead._traced is not None
    assert [*ahead._traced.values()] != [None]
    for a, b in zip(leaves(fast), leaves(slow), strict=True):
        if isinstance(b, dict):
            continue
        np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-11)
    for a, b in zip(fast.margins, slow.margins, strict=True):
        assert a.keys() == b.keys()
        for name in a:
            np.testing.assert_allclose(a[name], b[name], rtol=1e-9, atol=1e-9)

    search = _Search.of(FlownBackup(), world)
    for manoeuvre in search.ways:
        np.testing.assert_array_equal(
            search.command(manoeuvre, state, goal), search._pushing(manoeuvre, state, goal)
        )
    times = np.array([[0.0], [3.0], [40.0]])
    program = ahead.traced("coast", search.coasting._margins, state, goal, times)
    assert program is not None
    exact = search.coasting._margins(state, goal, times)
    for a, b in zip(program.of_arrays(state, goal, times), exact, strict=True):
        np.testing.assert_allclose(a + 0.0 * times, b + 0.0 * times, rtol=1e-9, atol=1e-9)


def test_numbers_answer_as_numpy_does_over_zero_and_below_it() -> None:
    def function(v: Any, x: Any) -> Any:
        return Vec2(x / v.x, sqrt(v.y)), where(x < -v.y, floor(x), absolute(x))

    v = Vec2(np.array([2.0, 0.0, -0.5]), np.array([4.0, -1.0, 0.0]))
    x = np.array([-5.5, 3.0, 0.0])
    with np.errstate(all="ignore"):
        want = leaves(function(v, x))
    got = StraightLine(function, v, x).of_rows(v, x)
    np.testing.assert_array_equal(leaves(got), want)


def test_what_is_not_a_number_stays_so() -> None:
    # A least margin that forgets it would be taken for a safe one; zeros have signs.
    def function(x: Any, y: Any) -> Any:
        return at_least(x, 0.5), within(x, -1.0, 1.0), x / y

    x = np.array([np.nan, np.nan, 2.0, -3.0, 0.0])
    y = np.array([0.0, 1.0, -0.0, -0.0, 0.0])
    with np.errstate(all="ignore"):
        want = function(x, y)
    got = StraightLine(function, x, y).of_rows(x, y)
    np.testing.assert_array_equal(got, want)


def test_truths_are_counted_as_numbers() -> None:
    def function(x: Any) -> Any:
        return sum((x > bound).to(None) for bound in (0.0, 1.0, 2.0))

    program = StraightLine(function, 1.0)
    x = np.array([-0.5, 0.5, 1.5, 2.5])
    np.testing.assert_array_equal(program.of_arrays(x), [0.0, 1.0, 2.0, 3.0])
    np.testing.assert_array_equal(program.of_rows(x), [0.0, 1.0, 2.0, 3.0])


def test_a_world_without_a_hash_is_not_traced_at_every_step() -> None:
    task = load_task("avoid")
    world = World(Setup(load_spacecraft("free-flyer"), task, task.timing))
    reserve: Any = [("clearance", 0.1)]  # a list has no hash
    ahead = Ahead.of(world, reserve)
    assert ahead.traced("half", lambda x: 0.5 * x, 1.0) is None
    assert Ahead.of(world).traced("half", lambda x: 0.5 * x, 1.0) is not None
    assert Ahead.of(world) is Ahead.of(world)


def test_what_has_no_value_among_numbers_is_left_to_arrays() -> None:
    program = StraightLine(log, 1.0)
    assert program.of_rows(np.array([-1.0])) is None
    assert program.of_rows(np.array([1.0])) == 0.0


def test_a_function_that_branches_is_refused() -> None:
    with pytest.raises(Untraceable, match="branch"):
        StraightLine(lambda x: x if x > 0.0 else -x, 1.0)
