"""Bounds of the first starts of a comparison, for every kind of mission: transfers, landings, inspections.

Bounds are proven lower bounds in N s (kg for landings), and tests compare every flight with them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from rans.extend import Comparison, ConfigError, Contest, Progress, Stages, map_leaves, unseen
from rans_missions.bounds.mission_bounds import MissionBounds
from rans_missions.convex.approach import PortMeeting, least_to_approach
from rans_missions.convex.holding import least_of_mission
from rans_missions.convex.inspection import inspection_bound
from rans_missions.convex.landing import Descent, Lander, best_landing
from rans_missions.convex.rendezvous import Meeting, state_of
from rans_missions.vectors import numbers

_SHORTEST = 2.0
"""Shortest landing that is tried, s."""


def bounded(contest: Contest) -> bool:
    """Whether a contest has such bounds: a mission under nominal conditions, and a craft that fits.

    Landings have them also with engines that are dead in every episode from the start.
    """
    conditions = contest.conditions
    problem = contest.task.optimal_problem
    if conditions is not None and not (problem == "landing" and conditions.only_dead):
        return False
    fits = {
        "landing": lambda: Lander.of(contest.craft, _dead(contest), apart=True),
        "approach": lambda: _at_port(contest, 0),
        "rendezvous": lambda: _meeting(contest, 0),
    }
    if problem not in fits:
        return problem == "inspection" and contest.craft.propellant is None
    try:
        fits[problem]()
    except ConfigError:
        return False
    return True


def mission_bounds(
    contest: Contest, count: int, progress: Progress = unseen
) -> Iterator[MissionBounds]:
    """Bounds of the first start, of the first two, and so on, at most of ``count``, as soon as they are known.

    Args:
        contest: one that is `bounded`.
        count: number of starts.
        progress: reports every bound.

    Raises:
        ConfigError: see `Meeting.of`, or of a landing `Lander.of`.
    """
    problem = contest.task.optimal_problem
    spending = "propellant" if problem == "landing" else "impulse"
    lower: list[float] = []
    deadlines = None
    for k in range(min(count, contest.episodes)):
        lower.append(_lower(contest, k))
        if problem == "rendezvous":
            deadlines = [_deadline(contest, i) for i in range(k + 1)]
        progress(1)
        yield MissionBounds(np.array(lower), spending, deadlines)


def add_bounds(comparison: Comparison, certified: int, stages: Stages, **_: object) -> None:
    """Add the bounds of the first starts to a comparison; an interrupt leaves those that are known."""
    count = min(certified, comparison.contest.episodes)
    step = stages("certified bounds", count)
    found = None
    try:
        for found in mission_bounds(comparison.contest, count, step):
            comparison.mission = found
    finally:
        if found is not None:
            comparison.notes.append(found.sentence(comparison.entries))
            comparison.failures += found.impossible(comparison.entries)


def _lower(contest: Contest, k: int) -> float:
    """Lower bound of start number k, of a success by its deadline or the end of the episode.

    N s, or kg of propellant for a landing; infinite if nothing succeeds.
    """
    problem = contest.task.optimal_problem
    task: Any = contest.task
    if problem == "landing":
        lander = Lander.of(contest.craft, _dead(contest), apart=True)
        descent = Descent.of(task, craft=contest.craft)
        scenario = contest.start(k)
        start = numbers(scenario.start.p - scenario.goal.p), numbers(scenario.start.v)
        period, times = contest.timing.control_period, (_SHORTEST, contest.duration)
        best = best_landing(lander, descent, start, period, "bound", times)
        return math.inf if best is None else best.dual
    if problem == "approach":
        return least_to_approach(_at_port(contest, k), state_of(contest.start(k)))[0]
    if problem == "inspection":
        one: Any = map_leaves(lambda x: float(np.squeeze(x)), contest.start(k))
        return inspection_bound(
            contest.craft, task, one.start, one.goal, contest.duration, contest.timing
        )
    return least_of_mission(
        _meeting(contest, k),
        state_of(contest.start(k)),
        _deadline(contest, k),
        task.stay_seconds,
    )


def _dead(contest: Contest) -> tuple[int, ...]:
    """Numbers of engines that are dead in every flight."""
    return () if contest.conditions is None else contest.conditions.dead


def _meeting(contest: Contest, k: int) -> Meeting:
    task: Any = contest.task
    return Meeting.of(contest.craft, task, contest.start(k).goal)


def _at_port(contest: Contest, k: int) -> PortMeeting:
    task: Any = contest.task
    return PortMeeting.at_port(contest.craft, task, contest.timing, contest.start(k).goal)


def _deadline(contest: Contest, k: int) -> float:
    """Deadline of start number k, s: the first note of its goal is the time left until it."""
    return float(np.squeeze(contest.start(k).goal.notes.deadline))
