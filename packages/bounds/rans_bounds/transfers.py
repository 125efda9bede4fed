"""Bounds of transfers to a goal that stands still, as comparisons and commands of RANS ask for them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from rans.evaluation.measure.statistics import figure
from rans.extend import (
    Bound,
    Comparison,
    ConfigError,
    Contest,
    Event,
    Scenario,
    Spacecraft,
    Stages,
    Table,
    Task,
    Terminal,
    aims,
    check_certifiable,
    each,
    progress,
    require,
    stages,
)
from rans_bounds import hull
from rans_bounds.first_starts import certified_bounds
from rans_bounds.goal_set import goal_set
from rans_bounds.problem import SearchEffort
from rans_bounds.starts import (
    bound,
    bounds_in_parallel,
    no_certificate,
    question,
    staying_set,
    without_certificate,
)

CERTIFIED = (
    "The hull bound holds for any commands between 0 and 1; relaxed is a local optimum of those; "
    "certified holds for every on/off controller at the control rate."
)

SETTLING = (
    "Settling is bounded by the first moment within the tolerances at a speed that allows to stay; "
    "no control found proves that it can be met."
)


class Transfers:
    """See `rans.evaluation.compare.certificates.Certificates`."""

    def check(self, craft: Spacecraft, task: Task, period: float) -> None:
        """Refuse (`ConfigError`) what has no bound, also where the package for its certificate is missing."""
        goal_set(task)
        check_certifiable(craft, wheels=True)
        if not no_certificate(craft, aims(task), period):
            require("numba")

    def greatest_force(self, craft: Spacecraft) -> float:
        """Greatest force of the hull, N."""
        return float(hull.Reach.of(craft).force.max())

    def least_times(self, contest: Contest) -> list[float]:
        """The hull's bounds, 5 to 12 % below the relaxed optimum; they take milliseconds."""
        goals = goal_set(contest.task)
        return [
            hull.least_time(contest.craft, aims(contest.task), one.start, one.goal, goals)
            for one in each(contest.starts)
        ]

    def last_watched(self, contest: Contest) -> float:
        """Latest time, s, from which every flight that leaves the tolerances is seen to leave them."""
        craft = contest.craft
        period = contest.timing.control_period
        within = staying_set(craft, contest.task, period)
        return max(0.0, contest.duration - hull.staying_time(craft, within, period))

    def bound(
        self,
        number: int,
        craft: Spacecraft,
        task: Task,
        period: float,
        event: Event,
        seconds: float,
        start: Scenario,
    ) -> Bound:
        """Bound of one start, in this process."""
        return bound(number, question(craft, task, period, event, SearchEffort(seconds), start))

    def add_bounds(
        self,
        bounds: list[Bound],
        craft: Spacecraft,
        task: Task,
        period: float,
        event: Event,
        measure: str,
        seconds: float,
        starts: Scenario,
        costs: Sequence[float],
    ) -> None:
        """Bounds in parallel, with a table of each event."""
        effort = SearchEffort(seconds)
        every_start = [*each(starts)]
        unknown = [math.nan] * len(every_start)
        events = {event: (measure, costs or unknown)}
        if event.horizon is None:  # the trajectories arrive, which is another event
            events[Event("settling")] = "time s to settle", unknown
        sentence = without_certificate(craft, aims(task), period) or CERTIFIED
        for asked, (unit, upper) in events.items():
            questions = [question(craft, task, period, asked, effort, one) for one in every_start]
            title = sentence if asked.kind == "arrival" else f"{sentence} {SETTLING}"
            found: list[tuple[int, Bound]] = []
            try:
                with progress() as bars:
                    step = stages(bars)("bounds", len(questions))
                    numbers = range(len(questions))
                    found.extend(bounds_in_parallel(questions, numbers, progress=step))
            finally:
                found.sort(key=lambda answer: answer[0])
                answers = [answer for _, answer in found]
                bounds += answers
                if found:
                    own = [upper[number] for number, _ in found]
                    Terminal().table(bounds_table(title, unit, answers, own))


TRANSFERS = Transfers()
"""What the core finds by its entry point."""


def add_first_starts(
    comparison: Comparison,
    *,
    certified: int,
    cache: Path | None,
    stages: Stages,
    workers: int | None,
    **_: object,
) -> None:
    """Add the bounds of the first starts by `certified_bounds`, after the reasons why they are loose or none."""
    contest = comparison.contest
    note = comparison.notes.append
    try:
        goal_set(contest.task)
        check_certifiable(contest.craft, wheels=True)
    except ConfigError as reason:
        note(f"No bound is certified: {reason}")
        return
    period = contest.timing.control_period
    if reason := without_certificate(contest.craft, aims(contest.task), period):
        note(reason)
    count = min(certified, contest.episodes)
    events = comparison.events()
    step = stages("certified bounds", count * len(events))
    loose = set()
    for answer in certified_bounds(contest, count, events, cache, workers, step):
        if answer.lower is None:
            loose.add(answer.event)
        # Answers come as they are found; their order in files must not depend on it.
        comparison.certified.append(answer)
        comparison.certified.sort(key=lambda bound: (bound.start, events.index(bound.event)))
    if loose and not reason:
        texts = ", ".join(event.text for event in events if event in loose)
        note(
            f"The hull bound alone stands for some starts: {texts}. The certificate's search is too large "
            "there, or no number of pulses stops the spin."
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
