"""What a task is, and the observation every task shares."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Protocol

from rans.errors import ConfigError
from rans.model.dynamics import State
from rans.model.fields import Field
from rans.model.random import Random
from rans.tasks.rewards import Prices

Dimension = Literal[2, 3]


class Task(Protocol):
    """A frozen dataclass of settings with pure functions over fields; no engine inside.

    The same object serves the plane and space, and torch, NumPy and CasADi. A task never truncates:
    time belongs to the engine.
    """

    symmetric: ClassVar[bool] = True
    """Whether agents had better learn for one side of the spacecraft what serves all that look the same
    (decision 009)."""

    def parts(self) -> Mapping[str, Task]:
        """What an agent is judged on, by name: the tasks drawn from, or itself, which needs no name: ""."""
        ...

    def drawn(self, goal: Any) -> Task:
        """The task that one goal, of numbers, belongs to: itself, or one of those drawn from."""
        ...

    def flag_of(self, goal: Any) -> Field:
        """The paper's task flag tf, by which a policy knows its task."""
        ...

    def sample(self, random: Random) -> tuple[State, State]:
        """Start and goal of one episode."""
        ...

    def for_evaluation(self) -> Task:
        """The task with the starts and goals that agents are judged on."""
        ...

    def residual(self, state: Any, goal: Any) -> tuple[Field, ...]:
        """The paper's task data td (Table 1), smooth.

        Policies observe it, optimal controllers drive it to `residual_target`.
        """
        ...

    def residual_target(self, dimension: Dimension) -> tuple[float, ...]:
        """Value of `residual` at the goal."""
        ...

    def residual_columns(self, dimension: Dimension) -> tuple[Column, ...]:
        """One row of the observation table per entry of `residual`."""
        ...

    def errors(self, state: Any, goal: Any) -> dict[str, Field]:
        """Distance from the goal by quantity; the names are keys of `UNITS`."""
        ...

    def tolerances(self) -> dict[str, float]:
        """The error below which each quantity counts as reached, in the units of `errors`."""
        ...

    @property
    def watches_switching(self) -> bool:
        """Whether `reward` looks at the previous command; engines remember it only then."""
        ...

    def reward(self, state: Any, goal: Any, command: tuple[Field, ...],
               previous: tuple[Field, ...]) -> dict[str, Field]:
        """Named terms; their sum is the reward of arriving in this state.

        Args:
            state: arrived in.
            goal: of the episode.
            command: that brought it here: one field per thruster, 0 (shut) to 1 (open), whatever
                share of the thrust each got.
            previous: the command before; all shut at the start of an episode.
        """
        ...

    def reached(self, state: Any, goal: Any) -> Field:
        """Whether every error is within its tolerance."""
        ...

    def failed(self, state: Any, goal: Any) -> Field:
        """Whether the episode ends here as a failure."""
        ...


@dataclass(frozen=True)
class SingleTask(Prices, Task):
    """What the tasks with one kind of goal have in common, a multi-task has not.

    Raises:
        ConfigError: see `check_settings`.
    """

    flag: ClassVar[float] = -1.0
    """The paper's tf, which policies see. The paper's numbers are 0 to 4; other tasks need none of
    their own."""

    def __post_init__(self) -> None:
        check_settings(self)

    def parts(self) -> dict[str, Task]:
        """Itself."""
        return {"": self}

    def drawn(self, goal: Any) -> Task:
        """Itself."""
        return self

    def flag_of(self, goal: Any) -> Field:
        """The same for every goal."""
        return float(self.flag)

    def for_evaluation(self) -> Task:
        """The same: starts and goals of training are those of evaluation."""
        return self

    def reached(self, state: Any, goal: Any) -> Field:
        """Whether every error is within its tolerance."""
        errors, tolerances = self.errors(state, goal), self.tolerances()
        inside = [errors[name] < tolerances[name] for name in tolerances]
        result = inside[0]
        for condition in inside[1:]:
            result = result & condition
        return result


Column = tuple[str, str, str]
"""(what, unit, frame) of one column of the observation."""

UNITS = {"position": "m", "attitude": "rad", "velocity": "m/s", "spin": "rad/s"}
"""Units of the errors a task may name."""

_TASK_DATA = {2: 4, 3: 9}
"""Columns kept for task data, so that every task's observation has the same width (Table 1)."""


def observation_width(dimension: Dimension) -> int:
    """10 columns in the plane, 22 in space (paper, section 3.2)."""
    return len(_BODY_COLUMNS[dimension]) + 1 + _TASK_DATA[dimension]


def observation(task: Task, state: Any, goal: Any) -> tuple[Field, ...]:
    """The paper's observation (section 3.2): attitude, velocity, spin, task flag, task data.

    Unused task data is zero. `observation_columns` names every column.
    """
    body = (*state.attitude.columns(), *state.v.columns(), *state.spin())
    data = task.residual(state, goal)
    zero = body[0] * 0.0
    padding = (zero,) * (observation_width(state_dimension(state)) - len(body) - 1 - len(data))
    return (*body, zero + task.flag_of(goal), *data, *padding)


def observation_columns(task: Task, dimension: Dimension) -> tuple[Column, ...]:
    """What each column of `observation` holds."""
    data = task.residual_columns(dimension)
    padding = (("unused", "-", "-"),) * (_TASK_DATA[dimension] - len(data))
    return (*_BODY_COLUMNS[dimension], ("task flag", "-", "-"), *data, *padding)


def state_dimension(state: Any) -> Dimension:
    """2 for a planar state, 3 for a spatial one."""
    return 2 if len(state.p.columns()) == 2 else 3


def check_settings(task: Any) -> None:
    """Refuse settings no task can work with, by the kind their name tells.

    Raises:
        ConfigError: a scale, distance, tolerance or limit is not a finite number > 0, a weight is
            negative, or a range's bounds are in the wrong order.
    """
    for field in dataclasses.fields(task):
        name, value = field.name, getattr(task, field.name)
        numbers = [x for x in (value if isinstance(value, tuple) else (value,)) if not is_moving(x)]
        if not all(isinstance(x, int | float) and math.isfinite(x) and x >= 0 for x in numbers):
            raise ConfigError(f"{name} must be finite and not negative, got {value!r}.")
        if isinstance(value, tuple) and value[0] > value[1]:
            raise ConfigError(f"{name} must be a range (low, high), got {value!r}.")
        may_be_zero = isinstance(value, tuple) or name.endswith("_weight") or name.startswith("rest_")
        if numbers == [0] and not may_be_zero:
            raise ConfigError(f"{name} must be > 0, got {value!r}; only weights and rests may be zero.")


def is_moving(setting: Any) -> bool:
    """Whether this is a number in memory that a curriculum changes, and has checked."""
    return not isinstance(setting, int | float) and getattr(setting, "shape", None) == ()


def check_spawn(spawn_distance: tuple[float, float], fail_distance: float) -> None:
    """Refuse starts beyond the distance at which an episode fails.

    Raises:
        ConfigError: some starts are.
    """
    if fail_distance <= spawn_distance[1]:
        raise ConfigError(
            f"fail_distance must exceed the farthest start, {spawn_distance[1]} m, got {fail_distance}: "
            "episodes would fail as they begin.")


_BODY_COLUMNS: dict[int, tuple[Column, ...]] = {
    2: (
        ("cos heading", "-", "W"),
        ("sin heading", "-", "W"),
        ("v_x", "m/s", "W"),
        ("v_y", "m/s", "W"),
        ("w_z", "rad/s", "B"),
    ),
    3: (
        *((f"R_WB[{i},{j}]", "-", "W") for i in (0, 1) for j in (0, 1, 2)),
        *((f"v_{axis}", "m/s", "W") for axis in "xyz"),
        *((f"w_{axis}", "rad/s", "B") for axis in "xyz"),
    ),
}
