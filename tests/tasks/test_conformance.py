"""What every task must satisfy on every spacecraft; one line in `rans.tasks.TASKS` enrols a task."""

from __future__ import annotations

import dataclasses
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_missions.tasks import Avoid, Dock, DockPort
from rans_missions.tasks.orbital import TargetOrbit
from rans_optimal.arrival import residual

from rans import ConfigError
from rans.base.display import meanings
from rans.episode.scenario import scenarios
from rans.model.fields import leaves, map_leaves, unflatten
from rans.model.random import Random
from rans.tasks import (
    TASKS,
    GoToPose,
    GoToPosePriced,
    gymnasium_ids,
    load_task,
    observation,
    observation_columns,
    observation_width,
)
from rans.tasks.derived import dimensions, layout
from rans.tasks.quantities import QUANTITIES
from tests.support.transitions import COUNT, arrival

PAPER_WIDTH = {2: 10, 3: 22}
"""Section 3.2 of the paper."""
ADDED_WIDTH = {
    GoToPosePriced: {2: 1, 3: 1},
    # Of each of three zones the way, relative velocity and direction, and a distance.
    Avoid: {2: 21, 3: 30},
    # Velocity and spin to gain, the cone's axis and its margin.
    DockPort: {2: 6, 3: 10},
}
"""What other tasks observe beside it."""


def everything(task: Any, state: Any, goal: Any, command: Any, previous: Any) -> dict[str, Any]:
    """Every field a task computes, by name."""
    numbered = {f"observation {i}": x for i, x in enumerate(observation(task, state, goal))}
    residual = {f"residual {i}": x for i, x in enumerate(data(task, state, goal))}
    errors = {f"error {name}": x for name, x in task.errors(state, goal).items()}
    reward = task.reward(arrival(state, goal, command, previous))
    terms = {f"reward {name}": x for name, x in reward.items()}
    flags = {"failed": task.failed(state, goal), "reached": task.reached(state, goal)}
    return {**numbered, **residual, **errors, **terms, **flags}


def data(task: Any, state: Any, goal: Any) -> list[Any]:
    """The columns of what a task shows."""
    return [x for entry in task.observation_terms(state, goal) for x in entry.columns()]


def at(index: int, tree: Any) -> Any:
    """One element of a batch, as plain numbers."""
    return map_leaves(lambda x: float(x[index]), tree)


def test_registration(task):
    name = next(n for n, kind in TASKS.items() if kind is type(task))
    ids = gymnasium_ids(name)
    assert tuple(ids) == dimensions(task)
    assert all(re.fullmatch(r"rans/\w+-v0", gymnasium_id) for gymnasium_id in ids.values())
    assert sum(ids.items() <= gymnasium_ids(other).items() for other in TASKS) == 1
    assert dataclasses.is_dataclass(task)
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(task, dataclasses.fields(task)[0].name, None)


def test_flags_tell_tasks_apart():
    flags = [kind.flag for kind in TASKS.values() if "flag" in vars(kind)]
    assert len(set(flags)) == len(flags)


def in_torch(task: Any, states: Any, goals: Any, commands: Any, kind: type) -> dict[str, Any]:
    """Every field, of tensors of a NumPy type."""
    torch = pytest.importorskip("torch")

    def lift(x: Any) -> Any:
        return torch.from_numpy(np.ascontiguousarray(x, kind))

    both = (tuple(map(lift, command)) for command in commands)
    return everything(task, map_leaves(lift, states), map_leaves(lift, goals), *both)


def test_one_by_one_in_batches_and_in_torch(task, states, goals, commands):
    """Numbers are the same but for rounding; single precision stays single."""
    torch = pytest.importorskip("torch")
    batch = everything(task, states, goals, *commands)
    double, single = (
        in_torch(task, states, goals, commands, kind) for kind in (np.float64, np.float32)
    )
    assert batch.keys() == double.keys() == single.keys()
    for name, x in batch.items():
        assert x.shape == (COUNT,), name
        assert np.isfinite(x).all(), name
        assert x.dtype == (np.bool_ if name in ("failed", "reached") else np.float64), name
        assert single[name].dtype in (torch.float32, torch.bool), name
        # last digits of two implementations of sine, cosine, exp and atan2
        np.testing.assert_allclose(double[name].numpy(), x, rtol=1e-12, atol=1e-12, err_msg=name)
    for index in range(0, COUNT, 7):
        both = [tuple(float(c[index]) for c in command) for command in commands]
        alone = everything(task, at(index, states), at(index, goals), *both)
        for name, x in alone.items():
            # sine, cosine and exp may round differently in a vector register
            np.testing.assert_allclose(batch[name][index], x, rtol=1e-13, atol=1e-14, err_msg=name)


def test_casadi_traces_the_residual(task, states, goals):
    """Value equal to NumPy's, Jacobian equal to central differences, and finite at the goal.

    There a norm or an angle would give NaN, and there the optimal controller ends.
    """
    casadi = pytest.importorskip("casadi")
    state = at(5, states)
    goal = at(5, goals)
    x = casadi.SX.sym("x", len(leaves(state)))
    residual = casadi.vertcat(*data(task, unflatten(state, casadi.vertsplit(x)), goal))
    traced = casadi.Function("residual", [x], [residual, casadi.jacobian(residual, x)])
    here = np.array(leaves(state))
    value, jacobian = (out.full() for out in traced(here))
    # last digits of sine and cosine
    np.testing.assert_allclose(value[:, 0], data(task, state, goal), rtol=1e-13, atol=1e-14)
    assert np.isfinite(jacobian).all()
    # of the goal itself: notes that it has beside its state are no variables
    assert np.isfinite(traced(np.array(leaves(replace(goal, notes=state.notes))))[1].full()).all()
    step = 1e-6  # truncation step^2 and rounding eps / step: both 1e-10 at most, for values to 10
    for column, nudge in zip(jacobian.T, step * np.eye(len(here)), strict=True):
        ahead, behind = (data(task, unflatten(state, here + s * nudge), goal) for s in (1, -1))
        difference = (np.array(ahead) - np.array(behind)) / (2 * step)
        np.testing.assert_allclose(column, difference, rtol=0, atol=1e-8)


def test_casadi_traces_the_reward(task, states, goals, commands):
    casadi = pytest.importorskip("casadi")
    state = at(5, states)
    goal = at(5, goals)
    here = np.array(leaves(state))
    numbers = [[float(c[5]) for c in command] for command in commands]
    x, *pairs = (casadi.SX.sym("x", len(values)) for values in (here, *numbers))
    symbolic = unflatten(state, casadi.vertsplit(x))
    terms = task.reward(arrival(symbolic, goal, *map(casadi.vertsplit, pairs)))
    traced = casadi.Function("reward", [x, *pairs], [casadi.vertcat(*terms.values())])
    expected = task.reward(arrival(state, goal, *numbers))
    assert terms.keys() == expected.keys()
    # last digits of exp and atan2
    np.testing.assert_allclose(
        traced(here, *numbers).full()[:, 0], list(expected.values()), rtol=1e-13, atol=1e-14
    )


def test_observation_table_names_every_column(task, craft, states, goals):
    dimension = craft.dimension
    columns = observation_columns(task, dimension)
    values = observation(task, states, goals)
    width = PAPER_WIDTH[dimension] + ADDED_WIDTH.get(type(task), {2: 0, 3: 0})[dimension]
    assert len(columns) == len(values) == observation_width(task, dimension) == width
    assert all(len(c) == 3 and all(isinstance(part, str) and part for part in c) for c in columns)
    named = [c[0] for c in columns if c[0] != "unused"]
    assert len(set(named)) == len(named)
    for (what, unit, _), value in zip(columns, values, strict=True):
        assert unit in {"-", "m", "rad", "m/s", "rad/s"}
        if what == "unused":
            assert not value.any()
        if what == "task flag":
            assert (value == task.flag_of(goals)).all()


def test_at_the_goal_nothing_is_left(task, craft, goals):
    for part in task.parts().values():
        np.testing.assert_allclose(np.stack(residual(part, goals, goals)), 0.0, rtol=0, atol=1e-14)
    for name, error in task.errors(goals, goals).items():
        np.testing.assert_allclose(error, 0.0, atol=1e-14, err_msg=name)
    assert not task.failed(goals, goals).any()
    assert task.reached(goals, goals).all()


def test_errors_have_units_and_tolerances(task, states, goals):
    errors = task.errors(states, goals)
    assert errors.keys() <= QUANTITIES.keys()
    assert all((e >= 0).all() for e in errors.values())
    for part in task.parts().values():
        tolerances = part.tolerances()
        assert tolerances.keys() <= part.errors(states, goals).keys() <= errors.keys()
        assert tolerances
        assert all(t > 0 for t in tolerances.values())


def test_reached_means_every_error_within_its_tolerance(task, states, goals):
    inside = task.reached(states, goals)
    for index in range(COUNT):
        goal = at(index, goals)
        errors = task.errors(at(index, states), goal)
        tolerances = drawn(task, goal).tolerances()
        assert inside[index] == all(errors[n] < t for n, t in tolerances.items())


def drawn(task: Any, goal: Any) -> Any:
    """The task itself, or that part of it which the goal is for."""
    return next(part for part in task.parts().values() if part.flag_of(goal) == task.flag_of(goal))


def test_reward_is_best_at_the_goal(task, states, goals, commands):
    idle = tuple(0.0 * c for c in commands[0])
    there = np.sum(list(task.reward(arrival(goals, goals, idle, idle)).values()), axis=0)
    elsewhere = np.sum(list(task.reward(arrival(states, goals, *commands)).values()), axis=0)
    assert (there > elsewhere).all()


def test_spawns_lie_inside_the_stated_range(task, craft):
    every = scenarios(task, craft, seed=6, count=2000 * len(task.parts()))
    assert not task.failed(every.start, every.goal).any()
    every_part = task.parts()
    for part in every_part.values():
        mine = np.flatnonzero(task.flag_of(every.goal) == np.full(len(every.start.p.x), part.flag))
        start, goal = (map_leaves(lambda x: x[mine], s) for s in (every.start, every.goal))  # noqa: B023
        if hasattr(part, "spawn_distance"):
            (low, high) = part.spawn_distance
            # The port's target is at the origin, away from which the docked state is.
            around = 0.0 if isinstance(part, DockPort) else goal.p.columns()
            way = np.subtract(around, start.p.columns())
        else:
            (low, high) = part.target_speed
            way = np.subtract(goal.v.columns(), start.v.columns())
        distance = np.linalg.norm(way, axis=0)
        # the draw is within [low, high); a direction's length is off by an eps
        assert distance.min() >= low - 1e-14
        assert distance.max() <= high + 1e-14
        width = high - low  # 2000 uniform draws miss 1 % of the range at an end once in 5e8 seeds
        assert distance.min() < low + 0.01 * width
        assert distance.max() > high - 0.01 * width
        assert low == 0 or not part.reached(start, goal).any()


def test_every_note_of_a_goal_has_a_name_and_a_meaning():
    """Sampled goals have the notes that their task declares, by name, and no number can be read by its rank."""
    ellipse = Dock(orbit=TargetOrbit(eccentricity=0.1, semi_major_axis_km=8000.0))
    tasks = (*(load_task(name) for name in filter(TASKS.comes_with_rans, TASKS)), ellipse)
    for task in tasks:
        episodes = Random(dimensions(task)[-1], 1, 2, np.arange(3, dtype=np.int32), np.float64)
        _, goal = task.sample(episodes)
        assert type(goal.notes) is (task.goal_notes or type(None))
        if task.goal_notes is not None:
            assert meanings(task.goal_notes).keys() == vars(goal.notes).keys()
            with pytest.raises(TypeError):
                goal.notes[0]  # pyrefly: ignore[bad-index]


def test_notes_of_another_class_than_declared_are_refused():
    class Nameless(GoToPose):
        def sample(self, random: Random) -> Any:
            start, goal = super().sample(random)
            return start, replace(goal, notes=(goal.p.x,))

    with pytest.raises(ConfigError, match=r"goal of Nameless are of the class tuple.* is none"):
        layout(Nameless(), 2)
