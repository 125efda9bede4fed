"""What nothing can beat, per start: the certificate where one exists, else the hull bound."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass
from typing import Any

from rich.table import Table

from rans.errors import ConfigError, RansError
from rans.fields import leaves
from rans.optimal import hull
from rans.optimal.arrival import aims
from rans.optimal.certificate import Effort, least_fuel, least_time
from rans.optimal.lattice import GoalSet, Lattice
from rans.optimal.objectives import MinimumFuel, MinimumTime
from rans.optimal.pool import each
from rans.processes import submitted
from rans.scenario import Scenario
from rans.spacecraft import Spacecraft
from rans.tasks.base import Task

_CERTIFIED = ("The hull bound holds for any commands between 0 and 1; relaxed is a local optimum of those; "
              "certified holds for every on/off controller at the control rate.")

_LONGEST = 12.0
"""Time up to which the certified least time is looked for, s: twice that of the paper's starts."""


Bounding = MinimumFuel | MinimumTime
"""Objectives that have bounds."""


@dataclass(frozen=True)
class Bounded:
    """What nothing can beat from one start, in the objective's unit."""

    start: int
    hull: float
    """No commands between 0 and 1 do with less, on/off or not."""
    lower: float | None = None
    """No on/off controller at the control rate does with less; None where no certificate exists."""
    upper: float | None = None
    """What the best on/off control found needs; infinite where none was found."""
    seconds: float = 0.0
    """Wall time of the certificate."""

    def to_json(self) -> dict[str, Any]:
        """Plain values; what is missing is null."""
        return {k: None if isinstance(x, float) and not math.isfinite(x) else x
                for k, x in asdict(self).items()}


def bounds(craft: Spacecraft, task: Task, objective: Bounding, starts: Scenario, period: float,
           seconds: float, workers: int | None = None,
           progress: Callable[[], object] = lambda: None) -> tuple[list[Bounded], str]:
    """Bounds from every start, and a sentence that says what they hold for.

    Args:
        craft: what flies.
        task: where to.
        objective: what is bounded.
        starts: fields of arrays (N,).
        period: for which on/off commands are held, s.
        seconds: for every question of the certificate, see `Effort`.
        workers: processes, by default one per processor; 1 works in this process.
        progress: called once per start.

    Raises:
        RansError: a process died.
    """
    goal_set, each_start = GoalSet.of(task), list(each(starts))
    try:
        if aims(task) != {"position", "velocity", "attitude", "spin"}:
            raise ConfigError("the certificate is for tasks that ask for a pose")
        goal_set.net_spins(Lattice(craft, period), each_start[0].start, each_start[0].goal)  # type: ignore[arg-type]
    except ConfigError as reason:
        sentence = f"No on/off certificate: {reason}"
        jobs = [(k, craft, task, objective, scenario) for k, scenario in enumerate(each_start)]
        return [_called(progress, hull_bound(*job)) for job in jobs], sentence
    jobs = [(k, craft, task, objective, scenario, period, seconds) for k, scenario in enumerate(each_start)]
    if workers == 1:
        return [_called(progress, certified(*job)) for job in jobs], _CERTIFIED
    with submitted(certified, jobs, workers, leaves, (starts.start,)) as futures:
        try:
            for _ in as_completed(futures):
                progress()
            return [future.result() for future in futures], _CERTIFIED
        except BrokenProcessPool as error:
            raise RansError("a process that looked for a certificate died; the usual cause is too little "
                            "memory.") from error


def hull_bound(k: int, craft: Spacecraft, task: Task, objective: Bounding, scenario: Scenario) -> Bounded:
    """The bound of `rans.optimal.hull` from one start."""
    common = (craft, aims(task), scenario.start, scenario.goal)
    if isinstance(objective, MinimumFuel):
        horizon = objective.intervals * objective.control_period
        return Bounded(k, hull.least_fuel(*common, horizon, GoalSet.of(task)))
    return Bounded(k, hull.least_time(*common, GoalSet.of(task)))


def certified(k: int, craft: Spacecraft, task: Task, objective: Bounding, scenario: Scenario, period: float,
              seconds: float) -> Bounded:
    """Both bounds from one start; a horizon in which nothing can arrive has infinite ones."""
    lattice, start, goal = Lattice(craft, period), scenario.start, scenario.goal
    common = (GoalSet.of(task), Effort(seconds))
    loose = hull_bound(k, craft, task, objective, scenario).hull
    try:
        if isinstance(objective, MinimumFuel):
            steps = max(1, round(objective.horizon / period))
            answer = least_fuel(lattice, start, goal, steps, *common)  # type: ignore[arg-type]
        else:
            answer = least_time(lattice, start, goal, round(_LONGEST / period), *common)  # type: ignore[arg-type]
    except ConfigError:
        return Bounded(k, loose, math.inf, math.inf)
    return Bounded(k, loose, answer.lower, answer.upper, answer.seconds)


def _called(progress: Callable[[], object], answer: Bounded) -> Bounded:
    progress()
    return answer


def table(sentence: str, measure: str, answers: Sequence[Bounded], found: Sequence[float]) -> Table:
    """A row per start.

    Args:
        sentence: what the bounds hold for.
        measure: what is bounded, with its unit.
        answers: the bounds.
        found: cost of the relaxed trajectory from each start, NaN where there is none.
    """
    result = Table(title=f"What nothing can beat: {measure}", title_justify="left", caption=sentence,
                   caption_justify="left")
    for heading in ("start", "hull bound", "relaxed", "certified", "on/off found", "gap"):
        result.add_column(heading, justify="right")
    for answer, cost in zip(answers, found, strict=True):
        lower, upper = answer.lower, answer.upper
        proven = lower is not None and upper is not None and 0 < lower < math.inf
        gap = f"{100 * (upper / lower - 1):.1f} %" if proven else "-"  # type: ignore[operator]
        certain = ["-" if x is None else f"{x:.3f}" for x in (lower, upper)]
        relaxed = "-" if math.isnan(cost) else f"{cost:.3f}"
        result.add_row(str(answer.start), f"{answer.hull:.3f}", relaxed, *certain, gap)
    return result
