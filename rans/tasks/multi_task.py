"""One agent for many tasks: every episode draws one of them (MultiTask2D, MultiTask3D)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import zip_longest
from typing import ClassVar

from rans.base.display import default
from rans.base.errors import ConfigError, checked
from rans.model.dynamics import State
from rans.model.fields import Field, leaves, unflatten, where
from rans.model.random import Random
from rans.tasks.base import SingleTask, Task
from rans.tasks.go_to_pose import GoToPose
from rans.tasks.go_to_position import GoToPosition
from rans.tasks.observation_terms import (
    Block,
    Choice,
    ObservationTerm,
    Scalar,
    TaskDependent,
    VectorInW,
)
from rans.tasks.rewards import Transition
from rans.tasks.tracking import TrackTwist, TrackVelocity, TrackVelocityHeading


@dataclass(frozen=True)
class DrawnTask:
    """What a goal of `MultiTask` notes."""

    flag: Field
    """Flag of the task that the episode draws."""


@dataclass(frozen=True)
class MultiTask(Task):
    """One of several tasks in every episode, drawn with equal probability (paper: section 3.2, task flag).

    >>> pose = rans.GoToPose(thrust_weight=0.1)
    >>> list(rans.MultiTask(("go-to-pose", "track-velocity"), go_to_pose=pose).parts())
    ['go-to-pose', 'track-velocity']

    Start, goal, reward, failure and observation are those of the drawn task, which the policy knows by its flag.
    Each task has its own settings. Agents are evaluated on each of the `parts` separately, with the same
    observations.

    Raises:
        ConfigError: there is no task to draw from, an unknown one, or one twice.
    """

    tasks: tuple[str, ...] = (
        "go-to-position",
        "go-to-pose",
        "track-velocity",
        "track-twist",
        "track-velocity-heading",
    )
    """The tasks to draw from."""
    go_to_position: GoToPosition = field(default_factory=GoToPosition)
    """Settings of go-to-position where it is drawn."""
    go_to_pose: GoToPose = field(default_factory=GoToPose)
    """Settings of go-to-pose where it is drawn."""
    track_velocity: TrackVelocity = field(default_factory=TrackVelocity)
    """Settings of track-velocity where it is drawn."""
    track_twist: TrackTwist = field(default_factory=TrackTwist)
    """Settings of track-twist where it is drawn."""
    track_velocity_heading: TrackVelocityHeading = field(default_factory=TrackVelocityHeading)
    """Settings of track-velocity-heading where it is drawn."""

    symmetric: ClassVar[bool] = False
    goal_notes = DrawnTask

    def __post_init__(self) -> None:
        parts = fields(self)[1:]
        for part in parts:
            checked(part.name, getattr(self, part.name), type(default(part)))
        names = [part.name.replace("_", "-") for part in parts]
        if (
            not self.tasks
            or len(set(self.tasks)) < len(self.tasks)
            or not set(self.tasks) <= set(names)
        ):
            raise ConfigError(
                f"tasks must be different ones of {', '.join(names)}, got {self.tasks!r}."
            )

    def parts(self) -> dict[str, SingleTask]:
        """The tasks to draw from, by name."""
        return {name: getattr(self, name.replace("-", "_")) for name in self.tasks}

    def task_of(self, goal: State) -> SingleTask:
        """Task to which one goal (of numbers) belongs."""
        return next(
            part for part in self.parts().values() if part.flag == round(float(self.flag_of(goal)))
        )

    def for_evaluation(self) -> MultiTask:
        """The task with the starts and goals of evaluations."""
        judged = {
            name.replace("-", "_"): part.for_evaluation() for name, part in self.parts().items()
        }
        return replace(self, **judged)

    def flag_of(self, goal: State) -> Field:
        """Flag of the drawn task, from the notes of its goal."""
        return goal.notes.flag

    def sample(self, random: Random) -> tuple[State, State]:
        """Start and goal of the drawn task, whose flag is in the goal's notes; every task draws.

        All tasks draw, whichever is chosen, so that a batch of fields draws as one episode does.
        """
        parts = tuple(self.parts().values())
        draw = random.unit() * len(self.tasks)
        flag = draw * 0.0 + float(parts[0].flag)
        for rank, part in enumerate(parts[1:], start=1):
            flag = where(draw >= rank, float(part.flag), flag)
        pairs = [part.sample(random) for part in parts]
        start, goal = unflatten(pairs[0], self._chosen_row(flag, [leaves(pair) for pair in pairs]))
        return start, replace(goal, notes=DrawnTask(flag))

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """The drawn task's vector, which all have first, and further columns, 0 if unused; agents rely on it."""
        flag = self.flag_of(goal)
        terms = [part.observation_terms(state, goal) for part in self.parts().values()]
        vectors = self._chosen_row(flag, [first.columns() for first, *_ in terms])
        rest = self._chosen_row(
            flag, [[x for entry in data for x in entry.columns()] for _, *data in terms]
        )
        vector = VectorInW("task data ", "-", type(goal.p)(*vectors))
        return (
            (vector, TaskDependent("task data", "-", rest, self._choices(terms, len(rest))))
            if rest
            else (vector,)
        )

    def _choices(
        self, terms: Sequence[tuple[ObservationTerm, ...]], width: int
    ) -> tuple[Choice, ...]:
        """Blocks of the second term of `observation_terms`, by the flag of the drawn task.

        Symmetries mirror the columns by it.
        """

        def blocks(data: Sequence[ObservationTerm]) -> tuple[Block, ...]:
            used = tuple(entry.block() for entry in data)
            return (*used, *(Block(Scalar, 1),) * (width - sum(block.width for block in used)))

        return tuple(
            (float(part.flag), blocks(data))
            for part, (_, *data) in zip(self.parts().values(), terms, strict=True)
        )

    def tolerances(self) -> dict[str, float]:
        """Not available, because the tasks have different tolerances.

        Raises:
            ConfigError: always.
        """
        raise ConfigError(
            "a multi-task is judged on each of its tasks separately, as their tolerances "
            "differ: name one of them."
        )

    def errors(self, state: State, goal: State) -> dict[str, Field]:
        """Errors of the drawn task; the error of a quantity that it does not have is zero."""
        return self._chosen_terms(
            goal, [part.errors(state, goal) for part in self.parts().values()]
        )

    def reward(self, transition: Transition) -> dict[str, Field]:
        """Reward terms of the drawn task; terms that it does not have are zero."""
        return self._chosen_terms(
            transition.goal, [part.reward(transition) for part in self.parts().values()]
        )

    def reached(self, state: State, goal: State) -> Field:
        """Whether every error of the drawn task is within its tolerance."""
        return self._chosen(
            self.flag_of(goal), [part.reached(state, goal) for part in self.parts().values()]
        )

    def failed(self, state: State, goal: State) -> Field:
        """Whether the drawn task has failed."""
        return self._chosen(
            self.flag_of(goal), [part.failed(state, goal) for part in self.parts().values()]
        )

    def _chosen(self, flag: Field, values: Sequence[Field]) -> Field:
        """Value of the drawn task among the values of all tasks."""
        result = values[0]
        for part, value in zip(tuple(self.parts().values())[1:], values[1:], strict=True):
            if not (isinstance(value, float) and isinstance(result, float) and value == result):
                result = where(flag == part.flag, value, result)
        return result

    def _chosen_row(self, flag: Field, rows: Iterable[Iterable[Field]]) -> tuple[Field, ...]:
        """Row of the drawn task; shorter rows are padded with zeros."""
        return tuple(self._chosen(flag, column) for column in zip_longest(*rows, fillvalue=0.0))

    def _chosen_terms(self, goal: State, terms: Sequence[dict[str, Field]]) -> dict[str, Field]:
        names = dict.fromkeys(name for some in terms for name in some)
        flag = self.flag_of(goal)
        return {name: self._chosen(flag, [some.get(name, 0.0) for some in terms]) for name in names}
