"""What is derived from a task before it is flown: the columns of what it shows, and what its reward reads."""

from __future__ import annotations

import numpy as np

from rans.model.dynamics import State
from rans.model.fields import Field, finite, where
from rans.model.random import Random
from rans.model.spacecraft import Spacecraft
from rans.model.trace import UNTRACEABLE, Symbol, depends
from rans.tasks.base import Task, sight
from rans.tasks.rewards import Transition
from rans.tasks.settings import map_settings
from rans.tasks.sight import Column, Dimension, Layout, Sight


def example(task: Task, dimension: Dimension) -> Sight:
    """What the task shows at the start of an episode, whose entries have the types that all have."""
    try:
        return sight(*symbolic(task, dimension))
    except UNTRACEABLE:  # only torch or NumPy can follow this task
        return sight(task, *example_state(task, dimension))


def example_state(task: Task, dimension: Dimension) -> tuple[State, State]:
    """Start and goal of one episode, of numbers."""
    return task.sample(Random(dimension, 0, 0, np.zeros(1, dtype=np.int32), np.float64))


def symbolic(task: Task, dimension: Dimension) -> tuple[Task, State, State]:
    """The task with symbols for its settings in memory, and start and goal of an episode of symbols.

    Raises:
        TypeError: the task's functions do more than arithmetic on fields.
    """
    def fixed(name: str, value: Field) -> Field:
        return value if isinstance(value, int | float) else Symbol.input(name)

    task = map_settings(fixed, task)
    low, high, episode = (Symbol.input(name, "int") for name in ("low", "high", "episode"))
    return task, *task.sample(Random(dimension, low, high, episode, None))


def layout(task: Task, dimension: Dimension) -> Layout:
    """Which columns of the task's observation are what."""
    return example(task, dimension).layout()


def observation_width(task: Task, dimension: Dimension) -> int:
    """Columns of the task's observation: 10 in the plane and 22 in space (paper, section 3.2), or more."""
    return layout(task, dimension).width


def observation_columns(task: Task, dimension: Dimension) -> tuple[Column, ...]:
    """What each column of `observation` holds."""
    return example(task, dimension).table()


def residual(task: Task, state: State, goal: State) -> tuple[Field, ...]:
    """How far the task's data are from where they are at the goal, column by column."""
    return tuple(x - target for entry in task.sight(state, goal)
                 for x, target in zip(entry.columns(), entry.target(), strict=True))


def paid(terms: dict[str, Field], terminated: Field) -> tuple[dict[str, Field], Field]:
    """Rewards by name, and their sum: zeros where an episode failed and left no number.

    A state that is lost has no reward, and a trainer could make nothing of NaN. In an episode that goes on
    NaN stays: there the task's reward is wrong, which a training tells.
    """
    total = sum(terms.values())
    known = finite(total) | ~terminated
    return {name: where(known, term, 0.0) for name, term in terms.items()}, where(known, total, 0.0)


def goal_stands_still(task: Task) -> bool:
    """Whether the goal stays where an episode begins: the task has no `Task.next_goal` of its own."""
    return type(task).next_goal is Task.next_goal


def watches_switching(task: Task, craft: Spacecraft) -> bool:
    """Whether the reward looks at the previous command, found by running it on symbols."""
    thrusters = range(len(craft.thrusters))
    command, previous = (tuple(Symbol.input(f"{name} {i}") for i in thrusters)
                         for name in ("command", "previous"))
    try:
        task, state, goal = symbolic(task, craft.dimension)
        terms = task.reward(Transition(state, goal, command, previous))
    except UNTRACEABLE:  # only torch or NumPy can follow this task, which may look at anything
        return True
    return depends(terms.values(), previous)
