"""What a task is, and how what it shows becomes the observation of a policy."""

from __future__ import annotations

import operator
import warnings
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import reduce
from typing import Any, ClassVar, Literal

from rans.display import Settings
from rans.errors import ConfigError
from rans.model.drift import FREE, Drift
from rans.model.dynamics import State
from rans.model.fields import Field, where
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
from rans.tasks.rewards import Prices, Transition, is_used
from rans.tasks.settings import check_settings
from rans.tasks.shapes import Shape

_DATA_COLUMNS = {2: 4, 3: 9}
"""At least so many hold task data, so that the paper's tasks share a width (Table 1)."""


class Task(Settings, ABC):
    """A frozen dataclass of settings with pure functions over fields; no engine inside.

    The same object serves the plane and space, and every engine. It never truncates: time is the engine's.
    """

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "next_goal" in vars(cls):
            warnings.warn(
                f"{cls.__name__}.next_goal is deprecated and will not be called by the next version: "
                "write later(goal, time) for how the goal moves, and remember(goal, state) for what it "
                "notes of the spacecraft.",
                DeprecationWarning,
                stacklevel=2,
            )
        own: Any = cls
        if "sight" in vars(cls):
            warnings.warn(
                f"{cls.__name__}.sight is deprecated and will not be called by the next version: "
                "name it observation_terms.",
                DeprecationWarning,
                stacklevel=2,
            )
            own.observation_terms = vars(cls)["sight"]
        elif "observation_terms" in vars(cls):
            own.sight = vars(cls)["observation_terms"]  # for `super().sight` in tasks of users

    symmetric: ClassVar[bool] = True
    """Whether agents had better learn for one side of the spacecraft what serves all that look the same
    (decision 009)."""

    def parts(self) -> Mapping[str, Task]:
        """What an agent is judged on, by name: the tasks drawn from, or itself, which needs no name: ""."""
        return {"": self}

    def task_of(self, goal: State) -> Task:
        """The task that one goal, of numbers, belongs to: itself, or one of those drawn from."""
        return self

    @abstractmethod
    def flag_of(self, goal: State) -> Field:
        """The paper's task flag tf, by which a policy knows the task that a goal is of."""

    @abstractmethod
    def sample(self, random: Random) -> tuple[State, State]:
        """Start and goal of one episode.

        The goal is a state to be in: controllers that need no training fly to it, pages draw it, and
        `errors` are best zero there. What else a task must know of it goes into its ``notes``.
        """

    def for_evaluation(self) -> Task:
        """The task with the starts and goals that agents are judged on: by default those of training."""
        return self

    @property
    def drift(self) -> Drift:
        """How a free point moves where the task is set: by default it flies free."""
        return FREE

    def later(self, goal: State, time: Field) -> State:
        """Goal after a time (s): by default it stands still.

        It is a flow: it depends on the goal and its ``notes`` alone, whatever the spacecraft does, so that
        optimal control may ask for any time. `rans.model.drift.step_goal` moves a goal as free points move.
        """
        return goal

    def remember(self, goal: State, state: State) -> State:
        """Goal whose ``notes`` remember what has happened, such as points seen: by default nothing.

        Asked at every instant that `rans.model.timing.Timing.checks` says, after `later`.
        """
        return goal

    def constraints(self, state: State, goal: State) -> dict[str, Field]:
        """Margins by name that must never be negative, such as a distance to a wall (m): by default none.

        They are in SI units, smooth, and asked at every instant that `rans.model.timing.Timing.checks` says.
        """
        return {}

    def arrival(self, goal: State) -> Field | None:
        """Time (s) until the planned arrival, which controllers without training aim at; None: there is no plan."""
        return None

    def scenery(self, goal: State) -> tuple[Shape, ...]:
        """Zones, cones and limits at the goal's instant, as pages and safety filters see them: by default none.

        They are the shapes that `constraints` asks for their margins and `observation_terms` for their entries.
        """
        return ()

    def done(self, state: State, goal: State) -> Field | None:
        """Whether the mission is over and won, which ends the episode; None: it lasts until time is up."""
        return None

    violation_ends: bool = True
    """Whether a negative margin of `constraints` ends the episode as a failure."""
    violation_weight: float = 0.0
    """Reward lost in a control period with a negative margin."""
    done_weight: float = 0.0
    """Reward for the control period in which the mission is won."""
    timing: ClassVar[Timing] = Timing()
    """Control period and length of an episode where nobody says otherwise."""
    dimensions: ClassVar[tuple[Dimension, ...]] = (2, 3)
    """Dimensions that the task can be flown in."""
    spacecraft: ClassVar[str | None] = None
    """Name of the spacecraft that flies where none is named; None: the usual one of the dimension."""
    optimal_problem: ClassVar[Literal["trajectory", "rendezvous", "landing"]] = "trajectory"
    """The problem whose solution ``rans optimal`` gives: the best trajectory by nonlinear programming, the least
    impulse to a place on an orbit, or the least propellant of a landing, both by convex programming. The latter
    two are for what is derived from `rans.tasks.orbital.OrbitalMission` and `rans.tasks.land.Land`."""

    @property
    def draws_trade_off(self) -> bool:
        """Whether every episode draws a trade-off, which policies observe; see `rans.GoToPosePriced`."""
        return False

    @property
    def held_trade_off(self) -> float | None:
        """Trade-off of every episode, which policies observe; None: there is none, or episodes draw it."""
        return None

    def with_trade_off(self, trade_off: float) -> Task:
        """The task with its trade-off held; `ConfigError` if it has none, or for a number beyond 0 to 1."""
        raise ConfigError(f"{type(self).__name__} has no trade-off.")

    def plain(self) -> Task:
        """The task with nothing of a trade-off to observe: itself where there is no trade-off."""
        return self

    @abstractmethod
    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """What a policy sees of the way to the goal, smooth: the paper's task data td (Table 1).

        Optimal controllers drive it to the entries' targets.
        """

    @abstractmethod
    def errors(self, state: State, goal: State) -> dict[str, Field]:
        """Distance from the goal by quantity; the names are those of `rans.tasks.quantities.QUANTITIES`."""

    @abstractmethod
    def tolerances(self) -> dict[str, float]:
        """The error below which each quantity counts as reached, in the units of `errors`."""

    @abstractmethod
    def reward(self, transition: Transition) -> dict[str, Field]:
        """Named terms; their sum is the reward of arriving in this state."""

    def reached(self, state: State, goal: State) -> Field:
        """Whether every error that has a tolerance is within it."""
        errors = self.errors(state, goal)
        tolerances = self.tolerances()
        return reduce(operator.and_, (errors[name] < tolerances[name] for name in tolerances))

    @abstractmethod
    def failed(self, state: State, goal: State) -> Field:
        """Whether the episode ends here as a failure."""


@dataclass(frozen=True)
class SingleTask(Prices, Task):
    """What the tasks with one kind of goal have in common, a multi-task has not.

    A setting is a number, a range (low, high) or a truth value, and what it may be follows from its name;
    what is none of these, or may be negative, is a ``ClassVar``, or for a `__post_init__` of your own.

    Raises:
        ConfigError: see `rans.tasks.settings.check_settings`.
    """

    flag: ClassVar[float] = -1.0
    """The paper's tf, which policies see. The paper's are 0 to 4; other tasks need none of their own."""

    def __post_init__(self) -> None:
        check_settings(self)

    def flag_of(self, goal: State) -> Field:
        """The same for every goal."""
        return float(self.flag)

    def tolerances(self) -> dict[str, float]:
        """The settings named after a quantity, such as "position_tolerance"."""
        return {
            one.name.removesuffix("_tolerance"): getattr(self, one.name)
            for one in fields(self)
            if one.name.endswith("_tolerance")
        }


def goal_after(task: Task, goal: State, state: State, time: Field) -> State:
    """Goal and what it remembers a time (s) later, when the state is reached."""
    old = getattr(task, "next_goal", None)  # of plug-ins written for an earlier version
    if old is not None:
        return old(goal, state, time)
    return task.remember(task.later(goal, time), state)


def reward_terms(
    task: Task, transition: Transition, done: Field | None, violated: Field | None
) -> dict[str, Field]:
    """Terms of a task's reward by name, with those for winning and for violated constraints."""
    terms = dict(task.reward(transition))
    zero = transition.state.p.columns()[0] * 0.0  # of the precision that everything has
    if done is not None and is_used(task.done_weight):
        terms["done"] = where(done, zero + task.done_weight, zero)
    if violated is not None and is_used(task.violation_weight):
        terms["violation"] = where(violated, zero - task.violation_weight, zero)
    return terms


def typed_observation(task: Task, state: State, goal: State) -> Observation:
    """All that a policy sees of this state, with this goal."""
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
    """The columns of `observation_terms`, which `rans.tasks.observation_columns` names."""
    return typed_observation(task, state, goal).columns()
