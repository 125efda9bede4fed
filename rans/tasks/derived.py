"""Properties derived from a task: its dimensions, the columns of its observation, and inputs of its reward.

Engines, environments and exported contracts take width, names and order of columns from here.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from rans.base.errors import ConfigError
from rans.base.files import first_line
from rans.model.drift import step_goal
from rans.model.dynamics import State
from rans.model.fields import Field
from rans.model.random import Random
from rans.model.spacecraft import Spacecraft
from rans.tasks.base import Task, goal_after, typed_observation
from rans.tasks.observation_terms import Column, Dimension, Layout, Observation
from rans.tasks.rewards import Transition
from rans.tasks.settings import map_settings

PLACES: dict[Dimension, str] = {2: "in the plane", 3: "in space"}


def dimensions(task: Task) -> tuple[Dimension, ...]:
    """Dimensions for which a task is declared and in which its functions can be evaluated.

    If they fail in all for which it is declared, these.
    """
    declared = task.dimensions
    return tuple(leaf for leaf in declared if _failure(task, leaf) is None) or declared


def check_dimension(task: Task, dimension: Dimension) -> None:
    """Reject a task that is declared for, or can be evaluated in, the other dimension only.

    A task that fails in both may need more than NumPy numbers and is not rejected here.

    Raises:
        ConfigError: the task is not declared for this dimension, or one of its functions, or of its drift, fails
            in this dimension and not in the other.
    """
    if dimension not in task.dimensions:
        supported = PLACES[task.dimensions[0]]
        raise ConfigError(
            f"the task {type(task).__name__} works {supported} only: fly a spacecraft that moves {supported}."
        )
    if (reason := _failure(task, dimension)) is None or dimension in (works := dimensions(task)):
        return
    own = PLACES[dimension]
    supported = PLACES[works[0]]
    raise ConfigError(
        f"the task {type(task).__name__} works {supported}, but not {own}: {type(reason).__name__}: "
        f"{first_line(reason)}. Fly a spacecraft that moves {supported}, or write the task with what states have "
        "in both, such as (goal.p - state.p).norm() and state.attitude.to(goal.attitude)."
    ) from reason


def _failure(task: Task, dimension: Dimension) -> Exception | None:
    """Exception of the functions of a task, each evaluated once on numbers; None if there is none."""
    shut = (
        np.zeros(1),
    ) * 16  # the same number in both dimensions, enough for rewards of single thrusters
    try:
        with warnings.catch_warnings(action="ignore"):
            state, goal = example_state(task, dimension)
            if {len(pose.p.columns()) for pose in (state, goal)} != {dimension}:
                raise TypeError("its sample gives states of the other dimension")
            step_goal(state, task.drift, 0.2)
            goal = goal_after(task, goal, state, 0.2)
            typed_observation(task, state, goal).columns()
            transition = Transition(state, goal, shut, shut, state, 0.2, (1.0,) * len(shut))
            sum(task.reward(transition).values())
            _ = task.failed(state, goal) | task.reached(state, goal)
            _ = task.constraints(state, goal)
            _ = task.done(state, goal)
    except Exception as error:  # code of other packages may raise anything
        return error
    return None


def example(task: Task, dimension: Dimension) -> Observation:
    """Observation of a task at the start of an episode; the types of its terms are those of all observations.

    Raises:
        ConfigError: see `check_dimension`; or the notes of a goal are not of the class ``goal_notes`` of the task.
    """
    check_dimension(task, dimension)
    task = _with_numbers(task)
    state, goal = example_state(task, dimension)
    _check_notes(task, goal)
    return typed_observation(task, state, goal)


def _check_notes(task: Task, goal: State) -> None:
    """Refuse goals whose notes are not of the class that the task declares."""
    if goal.notes is None and task.goal_notes is None:
        return
    if task.goal_notes is None or type(goal.notes) is not task.goal_notes:
        declared = "none" if task.goal_notes is None else task.goal_notes.__name__
        raise ConfigError(
            f"the notes of a goal of {type(task).__name__} are of the class {type(goal.notes).__name__}, and its "
            f"goal_notes is {declared}: name a frozen dataclass there, and let `sample` make one."
        )


def example_state(task: Task, dimension: Dimension) -> tuple[State, State]:
    """Start and goal of one episode, as arrays of one number, or of one for each row of a team."""
    first = np.zeros(task.rows, dtype=np.int32)
    start, goal = task.sample(Random(dimension, 0, 0, first, np.float64))
    # Enough stores for any craft, because the observation of a task is determined without a craft.
    return (start if start.stores else replace(start, stores=(np.ones(task.rows),) * 16)), goal


def _with_numbers(task: Task) -> Task:
    """The task with ones in place of settings that are tensors or symbols."""
    return map_settings(lambda _, x: x if isinstance(x, int | float) else np.ones(1), task)


def layout(task: Task, dimension: Dimension) -> Layout:
    """Layout of the observation of a task."""
    return example(task, dimension).layout()


def observation_width(task: Task, dimension: Dimension) -> int:
    """Number of columns of the observation: 10 in the plane and 22 in space (paper, section 3.2), or more."""
    return layout(task, dimension).width


def observation_columns(task: Task, dimension: Dimension) -> tuple[Column, ...]:
    """Name, unit and frame of each column of the observation."""
    return example(task, dimension).table()


def is_constrained(task: Task) -> bool:
    """Whether flights may break a constraint: the task defines `limits` or `constraints`."""
    kind = type(task)
    return kind.limits is not Task.limits or kind.constraints is not Task.constraints


def goal_stands_still(task: Task) -> bool:
    """Whether the goal is constant over an episode: the task defines neither `later` nor `remember`."""
    kind = type(task)
    return kind.later is Task.later and kind.remember is Task.remember


class _Noted(tuple[Field, ...]):
    """A command that records whether it is read."""

    read = False

    def __iter__(self) -> Iterator[Field]:
        self.read = True
        return super().__iter__()

    def __getitem__(self, index: Any) -> Any:
        self.read = True
        return super().__getitem__(index)


def watches_switching(task: Task, craft: Spacecraft) -> bool:
    """Whether the reward reads the previous command, determined by one evaluation on arrays of one number.

    True for a reward that cannot be evaluated on NumPy arrays.
    """
    shut = (np.zeros(1),) * craft.command_count
    previous = _Noted(shut)
    task = _with_numbers(task)
    try:
        with np.errstate(all="ignore"):
            state, goal = example_state(task, craft.dimension)
            forces = (1.0,) * craft.thruster_count
            task.reward(Transition(state, goal, shut, previous, state, 0.2, forces))
    except Exception:  # code of other packages may raise anything
        return True
    return previous.read
