"""Lower bounds for each start: the certificate where one exists, else the hull or the tube bound.

docs/bounds/certificate.md proves all three. A change must leave every bound below every control that is found
(tests).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from rans.base.processes import nothing
from rans.evaluation.compare.bounds import Kind, count_of_periods
from rans.extend import (
    Bound,
    ConfigError,
    Event,
    Progress,
    Scenario,
    Spacecraft,
    Task,
    Workers,
    aims,
    check_period,
    unseen,
)
from rans_bounds import attitude_tube, hull
from rans_bounds.certificate import (
    Certificate,
    bounder,
    certified_least_fuel,
    certified_least_time,
)
from rans_bounds.goal_set import GoalSet, goal_set, pulse
from rans_bounds.problem import Problem, SearchEffort, TooManyPoints, Unreachable

_SEARCHED = 2.0
"""Multiple of the hull's bound up to which a certified least time is searched; that of each craft tried is within
1.3 of it. A least time beyond it has a bound that is valid, but not the best."""
_SEARCHED_PERIODS = 10
"""Control periods beyond that, because a craft that is almost there has a bound of nearly 0 s."""


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


def staying_set(craft: Spacecraft, task: Task, period: float) -> GoalSet:
    """Set of states from which a craft can stay within the tolerances, in which every settled craft is.

    See `rans_bounds.hull.settling_set`.

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
