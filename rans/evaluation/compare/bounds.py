"""What nothing can beat, per start: the certificate where one exists, else the hull bound.

docs/certificate.md proves both.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from rich.table import Table

from rans import terminal
from rans.errors import ConfigError
from rans.evaluation.measure.statistics import figure
from rans.model.drift import FREE
from rans.model.spacecraft import Spacecraft
from rans.model.timing import MOST_STEPS
from rans.optimal.certificate import hull
from rans.optimal.certificate.certificate import (
    Certificate,
    Effort,
    Problem,
    TooManyPoints,
    Unreachable,
    bounder,
    least_fuel,
    least_time,
)
from rans.optimal.certificate.goal_set import GoalSet, check_period, pulse, rounded_up
from rans.processes import Workers, nothing
from rans.progress import Progress, unseen
from rans.scenario import Scenario
from rans.tasks.base import Task
from rans.tasks.derived import goal_stands_still
from rans.tasks.goal_set import REST_SPEED, REST_SPIN, aims

CERTIFIED = (
    "The hull bound holds for any commands between 0 and 1; relaxed is a local optimum of those; "
    "certified holds for every on/off controller at the control rate."
)

SETTLING = (
    "Settling is bounded by the first moment within the tolerances at a speed that allows to stay; "
    "no control found proves that it can be met."
)

_LONGEST = 25.0
"""Time up to which the certified least time is looked for, s: an episode's."""


Kind = Literal["arrival", "settling"]
"""What a bound of its own exists of."""


class Event(NamedTuple):
    """What numbers are about; those of different events are not compared."""

    kind: Kind | Literal["staying"] = "arrival"
    """Arrival: in the goal set, which asks for rest (see `goal_set`), whatever follows. Settling: within the
    task's tolerances for good. Staying: in the goal set for good."""
    horizon: float | None = None
    """None: its time, s; else the thrust-time, N s, with which it holds at this time, s."""

    @property
    def text(self) -> str:
        """As a heading, without units."""
        if self.horizon is not None:
            return f"thrust-time by {self.horizon:g} s"
        return "time of arrival for good" if self.kind == "staying" else f"time of {self.kind}"


class Question(NamedTuple):
    """What is bounded; plain values, so that equal questions have equal answers and equal texts."""

    craft: Spacecraft
    aims: tuple[str, ...]
    """Sorted: what the set asks for, of "position", "attitude", "velocity" and "spin"."""
    goals: GoalSet
    period: float
    """For which on/off commands are held, s."""
    horizon: float | None
    """Bounded is the least thrust-time (N s) with which a controller is in the goal set at this time, s;
    None: the least time, s."""
    effort: Effort
    scenario: Scenario
    """Of floats."""
    kind: Kind = "arrival"
    """Settling: the set is one that everyone is in who stays within the tolerances (see `staying_set`)."""


@dataclass(frozen=True)
class Bound:
    """What nothing can beat from one start, in N s or s."""

    start: int
    horizon: float | None
    """See `Question`."""
    hull: float
    """No commands between 0 and 1 do with less, on/off or not."""
    lower: float | None = None
    """No on/off controller at the control rate does with less; None where no certificate exists."""
    upper: float = math.inf
    """What ``commands`` need, replayed into the goal set; infinite where none were found."""
    commands: list[list[int]] | None = None
    """(T, thrusters) zeros and ones."""
    seconds: float = 0.0
    """Wall time of the certificate."""
    unit: float = 0.0
    """What on/off commands need comes in whole multiples of it (periods, pulses); 0: in any amount."""
    kind: Kind = "arrival"
    """Of settling there are no commands: being in that set once is necessary, not sufficient."""

    def __repr__(self) -> str:
        result = f", {self.upper:g} found" if math.isfinite(self.upper) else ""
        return f"<Bound of the {self.event.text} from start {self.start}: {self.best:g}{result}>"

    @property
    def event(self) -> Event:
        """What it bounds."""
        return Event(self.kind, self.horizon)

    @property
    def best(self) -> float:
        """What no on/off controller beats, by all proofs there are."""
        hull = rounded_up(self.hull, self.unit) if self.unit else self.hull
        return hull if self.lower is None else max(hull, self.lower)


def goal_set(task: Task) -> GoalSet:
    """A task's tolerances, and rest where it has a place; what it leaves open is not looked at.

    `ConfigError` if something pulls at the spacecraft, the goal moves or there are constraints, of which the
    bounds know nothing.
    """
    if task.drift != FREE or not goal_stands_still(task):
        raise ConfigError(
            "bounds hold for free flight to a goal that stands still; "
            f"{type(task).__name__} has {task.drift.name} or a goal that moves."
        )
    if type(task).constraints is not Task.constraints:
        raise ConfigError(
            f"bounds hold for motion without constraints, and {type(task).__name__} has some."
        )
    tolerances = task.tolerances()
    return GoalSet(
        tolerances.get("position", 0.0),
        tolerances.get("velocity", REST_SPEED),
        tolerances.get("attitude", 0.0),
        tolerances.get("spin", REST_SPIN),
    )


def staying_set(craft: Spacecraft, task: Task, period: float) -> GoalSet:
    """Where everyone is who has settled: within the tolerances, and slow enough to stay there.

    See `rans.optimal.certificate.hull.settling_set`; raises as `goal_set`.
    """
    near = task.tolerances()
    goals = goal_set(task)
    slow = hull.settling_set(craft, goals.position, goals.heading, period)
    return replace(
        slow, velocity=near.get("velocity", slow.velocity), spin=near.get("spin", slow.spin)
    )


def question(
    craft: Spacecraft, task: Task, period: float, event: Event, effort: Effort, scenario: Scenario
) -> Question:
    """What is asked about an event from one start.

    Raises:
        ConfigError: see `goal_set`; or the event is thrust-time to settle by a horizon, or staying, whose
            bound is the greater one of arrival and settling.
    """
    if event.kind == "staying":
        raise ConfigError("staying has no bound of its own: ask for those of arrival and settling.")
    if event.kind == "arrival":
        wanted = aims(task)
        goals = goal_set(task)
    elif event.horizon is None:  # of the spin the lattice makes use, not the hull
        wanted = aims(task) - {"spin"} | task.tolerances().keys()
        goals = staying_set(craft, task, period)
    else:
        raise ConfigError("thrust-time by a horizon is bounded for arrival only, not for settling.")
    return Question(
        craft, tuple(sorted(wanted)), goals, period, event.horizon, effort, scenario, event.kind
    )


def no_certificate(craft: Spacecraft, wanted: Collection[str], period: float) -> str:
    """Why on/off controllers have no bound of their own here; nothing if they do.

    Of what is wanted see `rans.tasks.goal_set.aims`; commands are held for a period (s).
    """
    try:
        if not {"position", "attitude"} <= set(wanted):
            raise ConfigError(
                "the on/off certificate is for tasks that ask for a pose, which fixes the "
                "whole state."
            )
        bounder(craft, period)
    except ConfigError as reason:
        return str(reason)
    return ""


def bounds(
    questions: Sequence[Question],
    starts: Sequence[int],
    workers: int | None = None,
    progress: Progress = unseen,
) -> Iterator[tuple[int, Bound]]:
    """The answers as they are found, each with the number of its question; `RansError` if a process died.

    Args:
        questions: what is asked.
        starts: number of the scenario of each.
        workers: processes, by default one per processor; 1 works in this process.
        progress: reports answers.
    """
    jobs = list(zip(starts, questions, strict=True))
    for answer in Workers(nothing, (), workers, "searched for bounds").finished(_bound, jobs):
        yield answer
        progress(1)


def _bound(_: None, start: int, question: Question) -> Bound:
    return bound(start, question)


@dataclass(frozen=True)
class Amounts:
    """Numbers of starts, with the event they are of."""

    event: Event
    values: np.ndarray
    """(N,) s or N s; infinite where the event does not happen."""

    def __getitem__(self, starts: Any) -> Amounts:
        return replace(self, values=self.values[starts])

    def over(self, bound: Amounts) -> np.ndarray:
        """(N,) multiples of a bound; `ConfigError` if that is of another event."""
        return self.values / self._same(bound)

    def below(self, bound: Amounts) -> np.ndarray:
        """(N,) whether they beat it by more than rounding, which a bound excludes; raises as `over`."""
        return self.values < self._same(bound) - 1e-9

    def _same(self, bound: Amounts) -> np.ndarray:
        if self.event != bound.event:
            raise ConfigError(f"{self.event} cannot be measured by a bound of {bound.event}.")
        return bound.values


def whole_periods(horizon: float, period: float) -> int:
    """Control periods that a horizon is made of; `ConfigError` if it is not."""
    check_period(period)
    count = round(horizon / period) if math.isfinite(horizon / period) else 0
    if 1 <= count <= MOST_STEPS and abs(count * period - horizon) <= 1e-9 * horizon:
        return count
    raise ConfigError(
        f"a bound of thrust-time needs a horizon of 1 to {MOST_STEPS:,} whole control "
        f"periods of {period:g} s, got {horizon:g} s."
    )


def bound(start: int, question: Question) -> Bound:
    """One answer, infinite where nothing can arrive by the horizon; `ConfigError` for what is not finite.

    The hull's bound is all there is of problems that are too large for a certificate.
    """
    craft, wanted, goals, period, horizon, _, scenario, kind = question
    begin: Any = scenario.start
    end: Any = scenario.goal
    check_period(period)
    if horizon is None:
        steps = max(1, round(_LONGEST / period))
        unit = period
        least = hull.least_time(craft, wanted, begin, end, goals)
    else:
        steps = whole_periods(horizon, period)
        unit = pulse(craft, period) or 0.0
        least = hull.least_fuel(craft, wanted, begin, end, horizon, goals)
    loose = Bound(start, horizon, least, unit=unit, kind=kind)
    if no_certificate(craft, wanted, period):
        return loose
    if math.isinf(least):
        return replace(loose, lower=math.inf)
    try:
        result = _certificate(question, steps)
    except Unreachable:
        return replace(loose, lower=math.inf)
    except TooManyPoints:
        return loose
    if result is None:
        return loose
    if kind == "settling":
        return replace(loose, lower=result.lower, seconds=result.seconds)
    commands = None if result.commands is None else result.commands.astype(int).tolist()
    return replace(
        loose, lower=result.lower, upper=result.upper, commands=commands, seconds=result.seconds
    )


def _certificate(question: Question, steps: int) -> Certificate | None:
    """Of on/off controllers; None for a start whose spin no number of pulses takes to the goal's."""
    craft, wanted, goals, period, horizon, effort, scenario, _ = question
    proves = bounder(craft, period)
    problem = Problem(scenario.start, scenario.goal, goals, wanted)
    if not proves.can_stop(problem):
        return None
    return (least_time if horizon is None else least_fuel)(proves, problem, steps, effort)


def table(sentence: str, measure: str, answers: Sequence[Bound], result: Sequence[float]) -> Table:
    """A row per start, of its bound and the cost found for its relaxed trajectory, NaN where there is none.

    The sentence says what the bounds hold for; the measure is what is bounded, with its unit.
    """

    def row(answer: Bound, cost: float) -> tuple[str, ...]:
        lower = answer.lower
        upper = answer.upper
        shown = lower is not None and lower < math.inf and answer.kind == "arrival"
        gap = f"{100 * (upper / lower - 1):.1f} %" if lower and shown else "-"
        best = "-" if answer.kind == "settling" else f"{upper:.3f}"
        certain = ["-"] * 2 if lower is None else [f"{lower:.3f}", best]
        return str(answer.start), f"{answer.hull:.3f}", figure(cost, ".3f"), *certain, gap

    return terminal.table(
        f"What nothing can beat: {measure}",
        ("start", "hull bound", "relaxed", "certified", "on/off found", "gap"),
        map(row, answers, result),
        sentence,
        "right",
    )
