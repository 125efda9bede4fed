"""Lower bounds for each start: the certificate where one exists, else the hull or the tube bound.

docs/certificate.md proves all three. A change must leave every bound below every control that is found (tests).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from rans.errors import ConfigError
from rans.evaluation.measure.statistics import figure
from rans.model.drift import FREE
from rans.model.spacecraft import Spacecraft
from rans.model.timing import MOST_STEPS
from rans.optimal.certificate import attitude_tube, hull
from rans.optimal.certificate.certificate import (
    Certificate,
    bounder,
    certified_least_fuel,
    certified_least_time,
)
from rans.optimal.certificate.goal_set import GoalSet, check_period, pulse, rounded_up
from rans.optimal.certificate.problem import Problem, SearchEffort, TooManyPoints, Unreachable
from rans.processes import Workers, nothing
from rans.progress import Progress, unseen
from rans.scenario import Scenario
from rans.table import Table
from rans.tasks.base import Task
from rans.tasks.derived import goal_stands_still, is_constrained
from rans.tasks.goal_set import REST_SPEED, REST_SPIN, aims, check_errors

CERTIFIED = (
    "The hull bound holds for any commands between 0 and 1; relaxed is a local optimum of those; "
    "certified holds for every on/off controller at the control rate."
)

SETTLING = (
    "Settling is bounded by the first moment within the tolerances at a speed that allows to stay; "
    "no control found proves that it can be met."
)

_SEARCHED = 2.0
"""Multiple of the hull's bound up to which a certified least time is searched; that of each craft tried is within
1.3 of it. A least time beyond it has a bound that is valid, but not the best."""
_SEARCHED_PERIODS = 10
"""Control periods beyond that, because a craft that is almost there has a bound of nearly 0 s."""


Kind = Literal["arrival", "settling"]
"""Kinds of events with a bound of their own."""

_TEXTS: dict[Kind, str] = {"arrival": "first time in the goal set", "settling": "settling time"}
"""Words of the times of events, as tables of scores have them."""


class Event(NamedTuple):
    """Event whose time or impulse is measured; numbers of different events are not compared."""

    kind: Kind = "arrival"
    """arrival: first in the goal set, which asks for rest (see `goal_set`); settling: within the task's tolerances
    to the end."""
    horizon: float | None = None
    """None: the time of the event, s, is measured; else the impulse, N s, with which it has happened at this
    time, s."""

    @property
    def text(self) -> str:
        """Heading of the event, without units."""
        if self.horizon is not None:
            return f"impulse by {self.horizon:g} s"
        return _TEXTS[self.kind]


class Question(NamedTuple):
    """Question to a bound; it holds plain values, so that equal questions have equal texts."""

    craft: Spacecraft
    aims: tuple[str, ...]
    """Sorted names of the errors that the set bounds, of "position", "attitude", "velocity" and "spin"."""
    goals: GoalSet
    period: float
    """Control period of on/off commands, s."""
    horizon: float | None
    """Time at which a controller is in the goal set, s, with the least impulse (N s); None: the least time, s,
    is bounded."""
    effort: SearchEffort
    scenario: Scenario
    """Scenario whose fields are floats."""
    kind: Kind = "arrival"
    """settling: the set contains every state from which a craft can stay within the tolerances (`staying_set`)."""


@dataclass(frozen=True)
class Bound:
    """Bounds for one start, in N s or s."""

    start: int
    horizon: float | None
    """See `Question`."""
    hull: float
    """Lower bound for all commands between 0 and 1, on/off or not."""
    lower: float | None = None
    """Lower bound for on/off controllers at the control rate; None if there is no certificate."""
    upper: float = math.inf
    """Amount with ``commands``, which were replayed into the goal set; infinite if there are none."""
    commands: list[list[int]] | None = None
    """On/off commands (T, thrusters), zeros and ones, that reach the goal set."""
    seconds: float = 0.0
    """Wall time of the certificate."""
    unit: float = 0.0
    """Unit of amounts of on/off commands, a period or a pulse; 0: there is none."""
    kind: Kind = "arrival"
    """Kind of event; settling has no commands, because being in the set once is not sufficient for it."""
    tube: float | None = None
    """Lower bound for all commands between 0 and 1 from the attitudes that torque can reach; None: not computed."""

    def __repr__(self) -> str:
        result = f", {self.upper:g} found" if math.isfinite(self.upper) else ""
        return f"<Bound of the {self.event.text} from start {self.start}: {self.best:g}{result}>"

    @property
    def event(self) -> Event:
        """Event that is bounded."""
        return Event(self.kind, self.horizon)

    @property
    def best(self) -> float:
        """Largest lower bound for controllers at the control rate."""
        loose = max(self.hull, self.tube or 0.0)
        loose = rounded_up(loose, self.unit) if self.unit else loose
        return loose if self.lower is None else max(loose, self.lower)


def goal_set(task: Task) -> GoalSet:
    """Goal set of a task: its tolerances, and rest if it has a tolerance for the position.

    Raises:
        ConfigError: the task has a drift, a moving goal, constraints or errors that leave a direction free, which
            the bounds do not include.
    """
    if task.drift != FREE or not goal_stands_still(task):
        has = "a goal that moves" if task.drift == FREE else task.drift.name
        raise ConfigError(
            f"bounds are for free flight to a goal that stands still; {type(task).__name__} has {has}."
        )
    if is_constrained(task):
        raise ConfigError(
            f"bounds are for motion without constraints, and {type(task).__name__} has some."
        )
    check_errors(task)
    tolerances = task.tolerances()
    return GoalSet(
        tolerances.get("position", 0.0),
        tolerances.get("velocity", REST_SPEED),
        tolerances.get("attitude", 0.0),
        tolerances.get("spin", REST_SPIN),
    )


def staying_set(craft: Spacecraft, task: Task, period: float) -> GoalSet:
    """Set of states from which a craft can stay within the tolerances, in which every settled craft is.

    See `rans.optimal.certificate.hull.settling_set`.

    Raises:
        ConfigError: as `goal_set`.
    """
    near = task.tolerances()
    goals = goal_set(task)
    slow = hull.settling_set(craft, goals.position, goals.heading, period)
    return replace(
        slow, velocity=near.get("velocity", slow.velocity), spin=near.get("spin", slow.spin)
    )


def question(
    craft: Spacecraft,
    task: Task,
    period: float,
    event: Event,
    effort: SearchEffort,
    scenario: Scenario,
) -> Question:
    """Question about an event from one start.

    Raises:
        ConfigError: see `goal_set`; or the event is settling by a horizon.
    """
    if event.kind == "arrival":
        quantities = aims(task)
        goals = goal_set(task)
    elif event.horizon is None:  # The lattice uses the spin; the hull does not.
        quantities = aims(task) - {"spin"} | task.tolerances().keys()
        goals = staying_set(craft, task, period)
    else:
        raise ConfigError("impulse by a horizon is bounded for arrival only, not for settling.")
    return Question(
        craft, tuple(sorted(quantities)), goals, period, event.horizon, effort, scenario, event.kind
    )


def no_certificate(craft: Spacecraft, quantities: Collection[str], period: float) -> str:
    """Reason why there is no certificate for on/off controllers; "" if there is one.

    For ``quantities`` see `rans.tasks.goal_set.aims`; commands are held for a period (s).
    """
    try:
        if not {"position", "attitude"} <= set(quantities):
            raise ConfigError(
                "the on/off certificate is for tasks that ask for a pose, which fixes the "
                "whole state."
            )
        bounder(craft, period)
    except ConfigError as reason:
        return str(reason)
    return ""


def no_tube(craft: Spacecraft, quantities: Collection[str]) -> str:
    """Reason why there is no tube bound; "" if there is one.

    For ``quantities`` see `rans.tasks.goal_set.aims`.
    """
    if not {"position", "velocity", "attitude"} <= set(quantities):
        return "the tube bound is for tasks that ask for a pose."
    # In the plane, a settled craft has no more than the spin of the set in which it can stay (`staying_set`).
    if "spin" not in quantities and craft.dimension == 3:
        return (
            "the tube bound needs a limit of the spin at the end, which settling in space has not."
        )
    try:
        attitude_tube.check_covered(craft)
    except ConfigError as reason:
        return str(reason)
    return ""


def bounds_in_parallel(
    questions: Sequence[Question],
    starts: Sequence[int],
    workers: int | None = None,
    progress: Progress = unseen,
) -> Iterator[tuple[int, Bound]]:
    """Compute bounds in parallel; each comes with the number of its question, as soon as it is known.

    Args:
        questions: questions.
        starts: number of the scenario of each.
        workers: processes, by default one per processor; 1: this one.
        progress: reports answers.

    Raises:
        RansError: a process died.
    """
    jobs = list(zip(starts, questions, strict=True))
    for answer in Workers(nothing, (), workers, "searched for bounds").finished(_bound, jobs):
        yield answer
        progress(1)


def _bound(_: None, start: int, question: Question) -> Bound:
    return bound(start, question)


@dataclass(frozen=True)
class Amounts:
    """Times or impulses of an event, a start each."""

    event: Event
    values: np.ndarray
    """(N,) s or N s; infinite if the event does not happen."""

    def __getitem__(self, starts: Any) -> Amounts:
        return replace(self, values=self.values[starts])

    def over(self, bound: Amounts) -> np.ndarray:
        """Ratios (N,) to a bound.

        Raises:
            ConfigError: the bound is of another event.
        """
        return self.values / self._same(bound)

    def below(self, bound: Amounts) -> np.ndarray:
        """Whether amounts (N,) are below a bound by more than rounding, an error in a proof; raises as `over`."""
        return self.values < self._same(bound) - 1e-9

    def _same(self, bound: Amounts) -> np.ndarray:
        if self.event != bound.event:
            raise ConfigError(f"{self.event} cannot be measured by a bound of {bound.event}.")
        return bound.values


def count_of_periods(horizon: float, period: float) -> int:
    """Number of control periods of a horizon.

    Raises:
        ConfigError: the horizon is no whole number of them.
    """
    check_period(period)
    count = round(horizon / period) if math.isfinite(horizon / period) else 0
    if 1 <= count <= MOST_STEPS and abs(count * period - horizon) <= 1e-9 * horizon:
        return count
    raise ConfigError(
        f"a bound of impulse needs a horizon of 1 to {MOST_STEPS:,} whole control "
        f"periods of {period:g} s, got {horizon:g} s."
    )


def bound(start: int, question: Question) -> Bound:
    """Bounds of a question, infinite if nothing can arrive by the horizon.

    The certificate is left out of problems that are too large for it. The tube bound is computed where no
    certificate exists: it holds for throttled and pulsed thrusters and wheels, and is the closer one for them.

    Raises:
        ConfigError: a number of the question is not finite.
    """
    craft, quantities, goals, period, horizon, _, scenario, kind = question
    begin: Any = scenario.start
    end: Any = scenario.goal
    check_period(period)
    # The bound of the hull: of time without a horizon, else of fuel.
    if horizon is None:
        unit = period
        least = hull.least_time(craft, quantities, begin, end, goals)
        reachable = 0.0 if math.isinf(least) else least
        steps = _SEARCHED_PERIODS + math.ceil(_SEARCHED * reachable / period)
    else:
        steps = count_of_periods(horizon, period)
        unit = pulse(craft, period) or 0.0
        least = hull.least_fuel(craft, quantities, begin, end, horizon, goals)
    loose = Bound(start, horizon, least, unit=unit, kind=kind)
    # A certificate improves it where one exists; a bound that is not improved stays valid.
    if no_certificate(craft, quantities, period):
        if math.isinf(least) or no_tube(craft, quantities):
            return loose
        return replace(loose, tube=_tube(question, least))
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
    # Commands that reach the upper bound, as plain numbers for files.
    commands = None if result.commands is None else result.commands.astype(int).tolist()
    return replace(
        loose, lower=result.lower, upper=result.upper, commands=commands, seconds=result.seconds
    )


def _tube(question: Question, least: float) -> float:
    """Tube bound of a question whose hull bound is this."""
    craft, _, goals, period, horizon, _, scenario, _ = question
    begin: Any = scenario.start
    end: Any = scenario.goal
    if horizon is None:
        return attitude_tube.least_arrival(craft, begin, end, period, goals, least)
    return attitude_tube.least_impulse(craft, begin, end, horizon, goals)


def _certificate(question: Question, steps: int) -> Certificate | None:
    """Certificate for on/off controllers; None if no number of pulses changes the start's spin to the goal's.

    With None the bound of the hull stands alone.
    """
    craft, quantities, goals, period, horizon, effort, scenario, kind = question
    proves = bounder(craft, period)
    problem = Problem(scenario.start, scenario.goal, goals, quantities)
    if not proves.can_stop(problem):
        return None
    if kind == "settling":  # Commands are not reported, and the first open level is the bound.
        effort = replace(effort, levels=1)
    return (certified_least_time if horizon is None else certified_least_fuel)(
        proves, problem, steps, effort
    )


def without_certificate(craft: Spacecraft, quantities: Collection[str], period: float) -> str:
    """Sentences about the bounds of a craft or task without a certificate, and why; "" if there is one.

    For the arguments see `no_certificate`.
    """
    missing = no_certificate(craft, quantities, period)
    if not missing:
        return ""
    reason = no_tube(craft, quantities)
    if reason:
        return (
            f"No tight certificate exists: {missing} The hull bound in its place lets translation and "
            "rotation use all thrusters each, and holds for throttled thrust too. It is not improved, because "
            f"{reason}"
        )
    settling = " Settling has the hull bound." if craft.dimension == 3 else ""
    return (
        f"No tight certificate exists: {missing} In its place is the greater one of the hull bound and the "
        f"tube bound, which hold for throttled thrust too.{settling}"
    )


def bounds_table(
    sentence: str, measure: str, answers: Sequence[Bound], result: Sequence[float]
) -> Table:
    """Table of the bound of every start and the cost of its relaxed trajectory, NaN if there is none.

    The sentence says for which controllers the bounds hold; the measure is the bounded quantity with its unit.
    """
    has_tube = any(answer.tube is not None for answer in answers)
    tube = ("tube bound",) if has_tube else ()

    def row(answer: Bound, cost: float) -> tuple[str, ...]:
        """Row of the table for one start: hull, tube, ``cost`` of the trajectory, certified bounds and gap."""
        lower = answer.lower
        upper = answer.upper
        has_both = lower and upper < math.inf and answer.kind == "arrival"
        gap = f"{100 * (upper / lower - 1):.1f} %" if lower and has_both else "-"
        best = f"{upper:.3f}" if answer.kind != "settling" and upper < math.inf else "-"
        certain = ["-"] * 2 if lower is None else [f"{lower:.3f}", best]
        loose = [f"{answer.hull:.3f}"]
        if has_tube:
            loose.append(figure(math.nan if answer.tube is None else answer.tube, ".3f"))
        return str(answer.start), *loose, figure(cost, ".3f"), *certain, gap

    columns = ("start", "hull bound", *tube, "relaxed", "certified", "on/off found", "gap")
    rows = [*map(row, answers, result)]
    return Table(columns, rows, f"What nothing can beat: {measure}", sentence, right=columns)
