"""Base classes of tasks, and the observation of a policy from the terms of a task."""

from __future__ import annotations

import operator
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import reduce
from typing import TYPE_CHECKING, Any, ClassVar, Self

from rans.base.display import Settings
from rans.base.errors import ConfigError
from rans.model.drift import FREE, Drift
from rans.model.dynamics import State
from rans.model.fields import Field, Vector, where
from rans.model.random import Random
from rans.model.timing import Timing
from rans.tasks.observation_terms import (
    AngularVelocity,
    Dimension,
    Observation,
    ObservationTerm,
    OwnRotation,
    Scalar,
    VectorInW,
)
from rans.tasks.rewards import Prices, Transition, is_used, speed
from rans.tasks.settings import check_settings
from rans.tasks.shapes import Shape

if TYPE_CHECKING:
    from rans.model.spacecraft import Spacecraft
    from rans.tasks.afterwards import Afterwards

_DATA_COLUMNS = {2: 4, 3: 9}
"""Least number of columns of task data by dimension, so that the paper's tasks share a width (Table 1)."""


class Task(Settings, ABC):
    """Base class of tasks: a frozen dataclass of settings with pure functions over fields.

    The same object serves the plane and space, and every engine. Tasks do not truncate episodes; engines do.
    """

    @classmethod
    def expected(cls, task: Task, purpose: str) -> Self:
        """A task that must be of this class.

        Args:
            task: task.
            purpose: beginning of the message, such as "corridors lead to ports".

        Raises:
            ConfigError: the task is of another class.
        """
        if isinstance(task, cls):
            return task
        raise ConfigError(
            f"{purpose}, and {type(task).__name__} is not one: lqr flies most tasks, and rans train TASK makes "
            "an agent."
        )

    symmetric: ClassVar[bool] = True
    """Whether policies exploit the symmetry of the spacecraft by default (docs/decisions/learning.md)."""

    def parts(self) -> Mapping[str, Task]:
        """Tasks on which an agent is evaluated separately, by name: those of a multi-task, else the task as ""."""
        return {"": self}

    def task_of(self, goal: State) -> Task:
        """Task to which one goal (of numbers) belongs: one of a multi-task, else the task itself."""
        return self

    @abstractmethod
    def flag_of(self, goal: State) -> Field:
        """Task flag tf of the paper, which tells a policy the task of a goal."""

    @abstractmethod
    def sample(self, random: Random) -> tuple[State, State]:
        """Start and goal of one episode.

        The goal is a target state: controllers without training fly to it, pages draw it, and `errors` should be
        zero there. Further data of the goal belong into its ``notes`` (`goal_notes`).
        """

    def for_evaluation(self) -> Task:
        """The task with the starts and goals of evaluations; by default those of training."""
        return self

    @property
    def drift(self) -> Drift:
        """Motion of a free point in W; by default free flight."""
        return FREE

    def drift_at(self, goal: State) -> Drift:
        """Motion of a free point from now on; by default `drift`.

        A drift that depends on when a motion begins has its time in the ``notes`` of the goal, which `later` moves.

        Raises:
            ConfigError: `drift` is such a one, and would begin anew in every control period.
        """
        if not self.drift.steady:
            raise ConfigError(
                f"the drift of {type(self).__name__} changes with time ({type(self.drift).__name__}), so that the "
                "task must have a method drift_at(goal), with the time in the notes of the goal; drift alone would "
                "begin anew in every control period."
            )
        return self.drift

    def later(self, goal: State, time: Field) -> State:
        """Goal after a time (s); by default it does not move.

        It depends on the goal and its ``notes`` alone and not on the spacecraft, so that optimal control may
        evaluate it at any time. `rans.model.drift.step_goal` moves a goal as a free point.
        """
        return goal

    def remember(self, goal: State, state: State) -> State:
        """Goal whose ``notes`` record events of the episode, such as points seen; by default unchanged.

        Evaluated at every check (`rans.model.timing.Timing.checks`), after `later`.
        """
        return goal

    def limits(self, goal: State) -> dict[str, Shape]:
        """Zones, cones and speed limits by name, in W at the goal's instant; by default none."""
        return {}

    def constraints(self, state: State, goal: State) -> dict[str, Field]:
        """Margins by name that must not become negative, such as a distance to a wall (m); by default of `limits`.

        They are smooth, in SI units, and evaluated at every check (`rans.model.timing.Timing.checks`).
        """
        return {name: limit.gap(state.p, state.v) for name, limit in self.limits(goal).items()}

    def scenery(self, goal: State) -> tuple[Shape, ...]:
        """Shapes for pages and safety filters; by default `limits`.

        They are the shapes whose margins `constraints` returns and whose entries `observation_terms` contains.
        """
        return tuple(self.limits(goal).values())

    def markers(self, goal: State) -> tuple[tuple[Vector, Field], ...]:
        """Points in W, m, that pages mark, each with whether the mission has dealt with it; by default none."""
        return ()

    def afterwards(self, craft: Spacecraft, timing: Timing) -> Afterwards | None:
        """What controllers without training do once the mission is over; None: what they did before."""
        return None

    def done(self, state: State, goal: State) -> Field | None:
        """Whether the mission is accomplished, which ends the episode; None: it lasts until it is truncated."""
        return None

    @property
    def can_be_won(self) -> bool:
        """Whether it is a mission, which its success ends. All else is solved by whole flights (`verdict`)."""
        return type(self).done is not Task.done

    @property
    def end_key(self) -> str:
        """Name by which environments say that an episode is at its goal, which is a success of a mission alone."""
        return "is_success" if self.can_be_won else "at_goal"

    violation_ends: bool = True
    """Whether a negative margin of `constraints` ends the episode as a failure."""
    violation_weight: float = 0.0
    """Reward lost in a control period with a negative margin."""
    done_weight: float = 0.0
    """Reward for the control period in which the mission is accomplished."""
    goal_notes: ClassVar[Any] = None
    """Class of the ``notes`` of the task's goals: a frozen dataclass whose fields are numbers, vectors, shapes or
    tuples of these, each with a docstring that says its unit and frame; None: goals have no notes."""
    timing: ClassVar[Timing] = Timing()
    """Default timing of the task: control period, checks and length of an episode."""
    dimensions: ClassVar[tuple[Dimension, ...]] = (2, 3)
    """Dimensions in which the task can be flown."""
    spacecraft: ClassVar[str | None] = None
    """Name of the default spacecraft of the task; None: the default one of the dimension."""
    optimal_problem: ClassVar[str] = "trajectory"
    """Problem whose optimum ``rans optimal`` and comparisons know. "trajectory": the best trajectory, by nonlinear
    programming. Others are solved by packages (`rans.evaluation.problems.PROBLEMS`)."""

    @property
    def rows(self) -> int:
        """Rows of a batch that belong together and are flown together, such as the deputies of a team."""
        return 1

    @property
    def draws_trade_off(self) -> bool:
        """Whether every episode draws a trade-off, which policies observe; see `rans.GoToPosePriced`."""
        return False

    @property
    def held_trade_off(self) -> float | None:
        """Fixed trade-off of all episodes, which policies observe; None: there is none, or episodes draw it."""
        return None

    def with_trade_off(self, trade_off: float) -> Task:
        """The task with a fixed trade-off.

        Raises:
            ConfigError: the task has no trade-off, or the number is not within 0 to 1.
        """
        raise ConfigError(f"{type(self).__name__} has no trade-off.")

    def plain(self) -> Task:
        """The task without a trade-off in its observation; the task itself if it has no trade-off."""
        return self

    @abstractmethod
    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """Observation terms of the goal, smooth in the state: the task data td of the paper (Table 1).

        Optimal controllers drive them to their targets (`ObservationTerm.target`).
        """

    @abstractmethod
    def errors(self, state: State, goal: State) -> dict[str, Field]:
        """Errors by quantity, SI units; the names are those of `rans.tasks.quantities.QUANTITIES`."""

    @abstractmethod
    def tolerances(self) -> dict[str, float]:
        """Error of each quantity below which it counts as reached, in the units of `errors`."""

    @abstractmethod
    def reward(self, transition: Transition) -> dict[str, Field]:
        """Terms of the reward of a control period by name; the reward is their sum."""

    def reached(self, state: State, goal: State) -> Field:
        """Whether every error that has a tolerance is within it."""
        errors = self.errors(state, goal)
        tolerances = self.tolerances()
        return reduce(operator.and_, (errors[name] < tolerances[name] for name in tolerances))

    @abstractmethod
    def failed(self, state: State, goal: State) -> Field:
        """Whether the episode ends in this state as a failure."""


_ERRORS: dict[str, Callable[[Any, Any], Field]] = {
    "position": lambda state, goal: (goal.p - state.p).norm(),
    "attitude": lambda state, goal: state.attitude.to(goal.attitude).magnitude(),
    "velocity": lambda state, goal: (goal.v - state.v).norm(),
    "spin": lambda state, goal: speed(state.spin()),
}
"""Errors (fields) by quantity."""


@dataclass(frozen=True)
class SingleTask(Prices, Task):
    """Base class of tasks with one kind of goal, as opposed to `rans.MultiTask`.

    A setting is a number, a range (low, high) or a boolean; its bounds follow from its name
    (`rans.tasks.settings.check_settings`). Other values, and values that may be negative, must be a ``ClassVar``
    or be checked in a `__post_init__` of your own.

    Raises:
        ConfigError: see `rans.tasks.settings.check_settings`.
    """

    flag: ClassVar[float] = -1.0
    """Task flag tf of the paper, which policies observe. The tasks of the paper have 0 to 4; others may keep -1."""

    def __post_init__(self) -> None:
        check_settings(self)

    def flag_of(self, goal: State) -> Field:
        """Task flag, the same for every goal."""
        return float(self.flag)

    def errors(self, state: State, goal: State) -> dict[str, Field]:
        """Errors of pose and motion that have a tolerance; the spin is relative to a goal at rest."""
        return {name: _ERRORS[name](state, goal) for name in self.tolerances() if name in _ERRORS}

    def tolerances(self) -> dict[str, float]:
        """Tolerances by quantity, from the settings named QUANTITY_tolerance."""
        return {
            field.name.removesuffix("_tolerance"): getattr(self, field.name)
            for field in fields(self)
            if field.name.endswith("_tolerance")
        }


@dataclass(frozen=True)
class Arriving(SingleTask):
    """Base class of tasks that go to a place: starts around it, rewards of nearness, and when an episode fails."""

    spawn_distance: tuple[float, float] = (0.5, 4.5)
    """Range of the start's distance from the goal in training, m (original system)."""
    evaluation_distance: tuple[float, float] = (3.0, 4.0)
    """Range of the start's distance from the goal in evaluations, m (paper, section 4.1; 1 to 5 m in space)."""
    approach_weight: float = 0.5
    """Weight of the wide rewards, for large errors; 0 gives the reward of the original system."""
    fine_weight: float = 0.0
    """Weight of narrow copies of the rewards, for agents that keep the position within millimetres."""
    fine_scale: float = 0.02
    """Error at which the narrow rewards have fallen to 1/e, m and rad."""
    rest_position: float = 0.0
    """Distance below which the position reward is constant, so that thrust gains nothing, m."""
    position_tolerance: float = 0.05
    """Distance that counts as reached, m."""
    fail_distance: float = 8.0
    """Distance from the goal beyond which an episode fails, m (original system)."""
    fail_spin: float = 4.0
    """Angular rate beyond which an episode in space fails, rad/s; without it some policies spin up permanently."""

    position_scale: ClassVar[float] = 0.25
    """Error at which the position reward has fallen to 1/e, m (original system, 2023)."""
    approach_scale: ClassVar[float] = 1.5
    """Distance at which the approach reward has fallen to 1/e, m: a third of the farthest start."""

    def for_evaluation(self) -> Self:
        """The task with the starts of evaluations."""
        return replace(self, spawn_distance=self.evaluation_distance)

    def failed(self, state: State, goal: State) -> Field:
        """Whether the craft is too far away, or in space spins too fast."""
        lost = (goal.p - state.p).norm() > self.fail_distance
        spin = state.spin()
        return lost if len(spin) == 1 else lost | (speed(spin) > self.fail_spin)


def goal_after(task: Task, goal: State, state: State, time: Field) -> State:
    """Goal a time (s) later, with its memory updated for the state at that time."""
    return task.remember(task.later(goal, time), state)


def reward_terms(
    task: Task, transition: Transition, done: Field | None, violated: Field | None
) -> dict[str, Field]:
    """Terms (fields) of a task's reward by name, with those for success and for violated constraints.

    The order of terms is that of `Engine.term_names` and of logs.
    """
    terms = task.reward(transition)
    if not isinstance(terms, Mapping):
        raise ConfigError(
            f"{type(task).__name__}.reward must return a dict of terms by name, such as "
            f'{{"position": nearness(error, 0.5)}}, got {type(terms).__name__}.'
        )
    terms = dict(terms)
    zero = transition.state.p.columns()[0] * 0.0  # in the precision of the state
    if done is not None and is_used(task.done_weight):
        terms["done"] = where(done, zero + task.done_weight, zero)
    if violated is not None and is_used(task.violation_weight):
        terms["violation"] = where(violated, zero - task.violation_weight, zero)
    return terms


def typed_observation(task: Task, state: State, goal: State) -> Observation:
    """Observation of a measured state with a goal, as typed terms.

    This layout is the paper's, and every network's: terms may be added behind, and none may move.
    """
    flag = state.attitude.columns()[0] * 0.0 + task.flag_of(goal)
    data = task.observation_terms(state, goal)
    missing = _DATA_COLUMNS[len(state.p.columns())] - sum(len(entry.columns()) for entry in data)
    return Observation(
        (
            OwnRotation("", "-", state.attitude),
            VectorInW("v_", "m/s", state.v),
            AngularVelocity("w", "rad/s", state.spin()),
            Scalar("task flag", "-", flag),
            *data,
            *(Scalar("unused", "-", flag * 0.0) for _ in range(missing)),
        )
    )


def observation(task: Task, state: State, goal: State) -> tuple[Field, ...]:
    """Columns of the observation, as `typed_observation`; `rans.tasks.observation_columns` names them.

    Numbers of a task, which are the same for all states, become fields as the others are.
    """
    zero = state.attitude.columns()[0] * 0.0
    columns = typed_observation(task, state, goal).columns()
    return tuple(zero + x if isinstance(x, int | float) else x for x in columns)
