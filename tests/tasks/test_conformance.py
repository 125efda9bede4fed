"""What every task must satisfy on every spacecraft; one line in `rans.tasks.TASKS` enrols a task."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rans.dynamics import PlanarState, SpatialState
from rans.errors import ConfigError
from rans.fields import Heading, Quat, Vec2, Vec3, leaves, map_leaves, unflatten
from rans.flight import scenarios
from rans.spacecraft import Spacecraft
from rans.spacecraft_file import load_spacecraft, spacecraft_names
from rans.tasks import (
    GYMNASIUM_IDS,
    TASKS,
    observation,
    observation_columns,
    observation_width,
    reached,
    task_class,
)
from rans.tasks.base import UNITS, state_dimension
from tests.crafts import random_states

COUNT = 64
PAPER_WIDTH = {2: 10, 3: 22}
"""Section 3.2 of the paper."""


@pytest.fixture(params=sorted(TASKS))
def task(request: pytest.FixtureRequest) -> Any:
    return task_class(request.param)()


@pytest.fixture(params=spacecraft_names())
def craft(request: pytest.FixtureRequest) -> Spacecraft:
    return load_spacecraft(request.param)


@pytest.fixture
def states(craft: Spacecraft) -> Any:
    return random_states(craft.dimension, COUNT, seed=1)


@pytest.fixture
def goals(task: Any, craft: Spacecraft) -> Any:
    return scenarios(task, craft, seed=2, count=COUNT).goal


@pytest.fixture
def thrust(craft: Spacecraft) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(3)
    return tuple(rng.integers(0, 2, (len(craft.thrusters), COUNT)).astype(float))


def everything(task: Any, state: Any, goal: Any, thrust: Any) -> dict[str, Any]:
    """Every field a task computes, by name."""
    numbered = {f"observation {i}": x for i, x in enumerate(observation(task, state, goal))}
    residual = {f"residual {i}": x for i, x in enumerate(task.residual(state, goal))}
    errors = {f"error {name}": x for name, x in task.errors(state, goal).items()}
    terms = {f"reward {name}": x for name, x in task.reward(state, goal, thrust).items()}
    flags = {"failed": task.failed(state, goal), "reached": reached(task, state, goal)}
    return {**numbered, **residual, **errors, **terms, **flags}


def at(index: int, tree: Any) -> Any:
    """One element of a batch, as plain numbers."""
    return map_leaves(lambda x: float(x[index]), tree)


def test_registration(task: Any) -> None:
    name = next(n for n, kind in TASKS.items() if kind is type(task))
    plane, space = GYMNASIUM_IDS[name]
    assert all(re.fullmatch(r"rans/\w+-v0", gymnasium_id) for gymnasium_id in (plane, space))
    assert sum(ids.count(plane) + ids.count(space) for ids in GYMNASIUM_IDS.values()) == 2
    assert dataclasses.is_dataclass(task)
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(task, dataclasses.fields(task)[0].name, None)


def test_flags_tell_tasks_apart() -> None:
    flags = [kind().flag for kind in TASKS.values()]
    assert len(set(flags)) == len(flags)


def test_shapes_and_finite(task: Any, states: Any, goals: Any, thrust: Any) -> None:
    for name, x in everything(task, states, goals, thrust).items():
        assert x.shape == (COUNT,), name
        assert np.isfinite(x).all(), name
        assert x.dtype == (np.bool_ if name in ("failed", "reached") else np.float64), name


def test_batch_is_a_loop(task: Any, states: Any, goals: Any, thrust: Any) -> None:
    batch = everything(task, states, goals, thrust)
    for index in range(0, COUNT, 7):
        command = tuple(float(c[index]) for c in thrust)
        alone = everything(task, at(index, states), at(index, goals), command)
        for name, x in alone.items():
            # sine, cosine and exp may round differently in a vector register
            np.testing.assert_allclose(batch[name][index], x, rtol=1e-13, atol=1e-14, err_msg=name)


def test_torch_is_numpy(task: Any, states: Any, goals: Any, thrust: Any) -> None:
    torch = pytest.importorskip("torch")
    lift: Callable[[Any], Any] = lambda x: torch.from_numpy(np.ascontiguousarray(x))  # noqa: E731
    state, goal = map_leaves(lift, states), map_leaves(lift, goals)
    numpy_values = everything(task, states, goals, thrust)
    torch_values = everything(task, state, goal, tuple(map(lift, thrust)))
    assert numpy_values.keys() == torch_values.keys()
    for name, x in torch_values.items():
        # last digits of two implementations of sine, cosine, exp and atan2
        np.testing.assert_allclose(x.numpy(), numpy_values[name], rtol=1e-12, atol=1e-12, err_msg=name)


def test_single_precision_stays_single(task: Any, states: Any, goals: Any, thrust: Any) -> None:
    torch = pytest.importorskip("torch")
    lift: Callable[[Any], Any] = lambda x: torch.from_numpy(x.astype(np.float32))  # noqa: E731
    state, goal = map_leaves(lift, states), map_leaves(lift, goals)
    for name, x in everything(task, state, goal, tuple(map(lift, thrust))).items():
        assert x.dtype in (torch.float32, torch.bool), name


def test_casadi_traces_the_residual(task: Any, states: Any, goals: Any) -> None:
    """Value equal to NumPy's, Jacobian finite and equal to central differences."""
    casadi = pytest.importorskip("casadi")
    state, goal = at(5, states), at(5, goals)
    x = casadi.SX.sym("x", len(leaves(state)))
    residual = casadi.vertcat(*task.residual(unflatten(state, casadi.vertsplit(x)), goal))
    traced = casadi.Function("residual", [x], [residual, casadi.jacobian(residual, x)])
    here = np.array(leaves(state))
    value, jacobian = (out.full() for out in traced(here))
    # last digits of sine and cosine
    np.testing.assert_allclose(value[:, 0], task.residual(state, goal), rtol=1e-13, atol=1e-14)
    assert np.isfinite(jacobian).all()
    step = 1e-6  # truncation step^2 and rounding eps / step: both 1e-10 at most, for values to 10
    for column, nudge in zip(jacobian.T, step * np.eye(len(here)), strict=True):
        ahead, behind = (task.residual(unflatten(state, here + s * nudge), goal) for s in (1, -1))
        difference = (np.array(ahead) - np.array(behind)) / (2 * step)
        np.testing.assert_allclose(column, difference, rtol=0, atol=1e-8)


def test_residual_is_differentiable_at_the_goal(task: Any, goals: Any) -> None:
    """Where a norm or an angle would give NaN, and where the optimal controller ends."""
    casadi = pytest.importorskip("casadi")
    goal = at(3, goals)
    x = casadi.SX.sym("x", len(leaves(goal)))
    residual = casadi.vertcat(*task.residual(unflatten(goal, casadi.vertsplit(x)), goal))
    jacobian = casadi.Function("j", [x], [casadi.jacobian(residual, x)])(np.array(leaves(goal)))
    assert np.isfinite(jacobian.full()).all()


def test_observation_table_names_every_column(
    task: Any, craft: Spacecraft, states: Any, goals: Any
) -> None:
    dimension = craft.dimension
    columns = observation_columns(task, dimension)
    values = observation(task, states, goals)
    assert state_dimension(states) == dimension
    assert len(columns) == len(values) == observation_width(dimension) == PAPER_WIDTH[dimension]
    assert all(len(c) == 3 and all(isinstance(part, str) and part for part in c) for c in columns)
    named = [c[0] for c in columns if c[0] != "unused"]
    assert len(set(named)) == len(named)
    for (what, unit, _), value in zip(columns, values, strict=True):
        assert unit in {"-", "m", "rad", "m/s", "rad/s"}
        if what == "unused":
            assert not value.any()
        if what == "task flag":
            assert (value == task.flag).all()


def test_residual_has_a_row_and_a_target_per_entry(
    task: Any, craft: Spacecraft, states: Any, goals: Any
) -> None:
    entries = len(task.residual(states, goals))
    assert len(task.residual_columns(craft.dimension)) == entries
    assert len(task.residual_target(craft.dimension)) == entries


def test_at_the_goal_nothing_is_left(task: Any, craft: Spacecraft, goals: Any) -> None:
    residual = np.stack(task.residual(goals, goals))
    target = np.array(task.residual_target(craft.dimension))[:, None]
    np.testing.assert_allclose(residual, np.broadcast_to(target, residual.shape), rtol=0, atol=1e-14)
    for name, error in task.errors(goals, goals).items():
        np.testing.assert_allclose(error, 0.0, atol=1e-14, err_msg=name)
    assert not task.failed(goals, goals).any()
    assert reached(task, goals, goals).all()


def test_errors_have_units_and_tolerances(task: Any, states: Any, goals: Any) -> None:
    errors, tolerances = task.errors(states, goals), task.tolerances()
    assert errors.keys() <= UNITS.keys()
    assert tolerances.keys() <= errors.keys()
    assert tolerances
    assert all(t > 0 for t in tolerances.values())
    assert all((e >= 0).all() for e in errors.values())


def test_reached_means_every_error_within_its_tolerance(task: Any, states: Any, goals: Any) -> None:
    inside = reached(task, states, goals)
    for index in range(COUNT):
        errors = task.errors(at(index, states), at(index, goals))
        assert inside[index] == all(errors[n] < t for n, t in task.tolerances().items())


def test_reward_is_best_at_the_goal(task: Any, states: Any, goals: Any, thrust: Any) -> None:
    idle = tuple(0.0 * c for c in thrust)
    there = np.sum(list(task.reward(goals, goals, idle).values()), axis=0)
    elsewhere = np.sum(list(task.reward(states, goals, thrust).values()), axis=0)
    assert (there > elsewhere).all()


def test_spawns_lie_inside_the_stated_range(task: Any, craft: Spacecraft) -> None:
    drawn = scenarios(task, craft, seed=6, count=2000)
    if hasattr(task, "spawn_distance"):
        low, high = task.spawn_distance
        way = np.subtract(drawn.goal.p.columns(), drawn.start.p.columns())
    else:
        low, high = task.target_speed
        way = np.subtract(drawn.goal.v.columns(), drawn.start.v.columns())
    distance = np.linalg.norm(way, axis=0)
    # the draw is within [low, high); a direction's length is off by an eps
    assert distance.min() >= low - 1e-14
    assert distance.max() <= high + 1e-14
    width = high - low  # 2000 uniform draws miss 1 % of the range at an end once in 5e8 seeds
    assert distance.min() < low + 0.01 * width
    assert distance.max() > high - 0.01 * width
    assert not task.failed(drawn.start, drawn.goal).any()
    assert low == 0 or not reached(task, drawn.start, drawn.goal).any()


def test_a_moved_world_changes_nothing(task: Any, states: Any, goals: Any, thrust: Any) -> None:
    """Errors, reward and failure are the same when start and goal are turned and shifted together."""
    moved_states, moved_goals = moved(states), moved(goals)
    here, there = (
        {"failed": task.failed(s, g), **task.errors(s, g), **task.reward(s, g, thrust)}
        for s, g in ((states, goals), (moved_states, moved_goals))
    )
    for name, x in here.items():
        # distances of 10 m carry 1e-15; an angle near zero or half a turn keeps half the digits of
        # a cosine but all of an atan2
        np.testing.assert_allclose(there[name], x, rtol=0, atol=1e-12, err_msg=name)


def moved(state: Any) -> Any:
    """The state seen from a world frame that is turned and shifted; body quantities stay."""
    if isinstance(state, PlanarState):
        turn = Rotation.from_rotvec([0, 0, 2.1]).as_matrix()[:2, :2]
        p, v = (Vec2(*(turn @ np.stack(x.columns()))) for x in (state.p, state.v))
        return PlanarState(p + Vec2(3.0, -5.0), Heading(state.attitude.angle + 2.1), v, state.w)
    turn = Rotation.from_rotvec([0.4, -1.2, 0.8])
    p, v = (Vec3(*turn.apply(np.stack(x.columns(), axis=1)).T) for x in (state.p, state.v))
    w, x, y, z = leaves(state.attitude)
    qx, qy, qz, qw = (turn * Rotation.from_quat(np.stack([x, y, z, w], axis=1))).as_quat().T
    return SpatialState(p + Vec3(3.0, -5.0, 1.0), Quat(qw, qx, qy, qz), v, state.w)


def test_the_plane_is_a_slice_of_space(task: Any) -> None:
    """A planar motion written as a spatial one has the same errors and reward."""
    flat = random_states(2, COUNT, seed=7)
    goal = random_states(2, COUNT, seed=8, speed=0.0, spin=0.0)
    command = (np.ones(COUNT),) * 8
    for name in ("errors", "reward"):
        extra = (command,) if name == "reward" else ()
        plane = getattr(task, name)(flat, goal, *extra)
        space = getattr(task, name)(embedded(flat), embedded(goal), *extra)
        assert plane.keys() == space.keys()
        for key, value in plane.items():
            # twice an atan2 against a difference of angles
            np.testing.assert_allclose(space[key], value, rtol=0, atol=1e-13, err_msg=key)


def embedded(flat: Any) -> Any:
    zero, half = np.zeros(COUNT), flat.attitude.angle / 2
    return SpatialState(Vec3(flat.p.x, flat.p.y, zero), Quat(np.cos(half), zero, zero, np.sin(half)),
                        Vec3(flat.v.x, flat.v.y, zero), Vec3(zero, zero, flat.w))


def test_an_unknown_task_is_named() -> None:
    with pytest.raises(ConfigError, match=r"no task named 'go-to-poze'; known are .*go-to-pose"):
        task_class("go-to-poze")
