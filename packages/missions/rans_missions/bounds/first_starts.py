"""Bounds of the first starts of a comparison, for every kind of mission.

Bounds are proven lower bounds in N s (kg for landings), and tests compare every flight with them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from rans.extend import (
    Comparison,
    ConfigError,
    Contest,
    Progress,
    Stages,
    check_certifiable,
    map_leaves,
    unseen,
)
from rans_missions.bounds.mission_bounds import MissionBounds
from rans_missions.bounds.ports import least_to_dock
from rans_missions.bounds.zones import Search
from rans_missions.convex.approach import PortMeeting, least_to_approach
from rans_missions.convex.holding import least_of_mission
from rans_missions.convex.inspection import inspection_bound
from rans_missions.convex.landing import Descent, Lander, best_landing
from rans_missions.convex.rendezvous import Meeting, state_of
from rans_missions.tasks import Avoid, DockPort
from rans_missions.vectors import numbers

_SHORTEST = 2.0
"""Shortest landing that is tried, s."""


def bounded(contest: Contest) -> bool:
    """Whether a contest has such bounds: a mission under nominal conditions, and a craft that fits.

    Landings have them also with engines that are dead in every episode from the start.

    Raises:
        ConfigError: nothing is drawn, and yet there is none.
    """
    conditions = contest.conditions
    is_landing = contest.task.optimal_problem == "landing"
    if conditions is not None and not (is_landing and conditions.only_dead):
        return False
    _question(contest, 0)
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
        lower.append(_question(contest, k)())
        if problem == "rendezvous":
            deadlines = np.ravel(contest.starts.goal.notes.deadline)[: k + 1].tolist()
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


def _question(contest: Contest, k: int) -> Callable[[], float]:
    """What finds the lower bound of start number k, of a success by its deadline or the end of the episode.

    N s, or kg of propellant for a landing; infinite if nothing succeeds.

    Raises:
        ConfigError: no bound covers this craft.
    """
    craft = contest.craft
    timing = contest.timing
    problem = contest.task.optimal_problem
    task: Any = contest.task
    one: Any = map_leaves(lambda x: float(np.squeeze(x)), contest.start(k))
    if problem == "landing":
        dead = () if contest.conditions is None else contest.conditions.dead
        lander = Lander.of(craft, dead, apart=True)
        return partial(_least_propellant, lander, Descent.of(task, craft=craft), one, contest)
    if problem == "approach":
        port = PortMeeting.at_port(craft, task, timing, one.goal)
        return lambda: least_to_approach(port, state_of(one))[0]
    if problem == "rendezvous":
        meeting = Meeting.of(craft, task, one.goal)
        deadline = one.goal.notes.deadline
        return partial(least_of_mission, meeting, state_of(one), deadline, task.stay_seconds)
    check_certifiable(craft, wheels=True)
    if problem == "inspection":
        return partial(inspection_bound, craft, task, one.start, one.goal, contest.duration, timing)
    # A class derived from these may end, move or drift otherwise.
    if type(task) not in (Avoid, DockPort) or numbers(one.start.v).any():
        raise ConfigError("bounds among zones and to ports are of Avoid and DockPort from rest.")
    if problem == "port":
        return partial(least_to_dock, craft, task, one, timing)
    return Search(craft, task, one, timing).bound


def _least_propellant(lander: Lander, descent: Descent, one: Any, contest: Contest) -> float:
    """Propellant below which nothing lands, kg; infinite if nothing does."""
    start = numbers(one.start.p - one.goal.p), numbers(one.start.v)
    times = _SHORTEST, contest.duration
    best = best_landing(lander, descent, start, contest.timing.control_period, "bound", times)
    return math.inf if best is None else best.dual
