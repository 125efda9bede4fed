"""Bounds of the first starts of a comparison, for every kind of mission: transfers, landings, inspections.

Bounds are proven lower bounds in N s (kg for landings), and tests compare every flight with them.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from rans.evaluation.compare.mission_bounds import MissionBounds
from rans.extend import ConfigError, Contest, Progress, SolverFailed, State, map_leaves, unseen
from rans_missions.convex.approach import PortMeeting, least_to_approach
from rans_missions.convex.holding import least_to_hold
from rans_missions.convex.inspection import inspection_bound
from rans_missions.convex.landing import Descent, Lander, Landing, best_landing, landing
from rans_missions.convex.rendezvous import Meeting, rendezvous, state_of

_TIMES = 8
"""Times at which the front of a start on an orbit is bounded, from the earliest deadline of the task on."""
_AROUND = (8.0, 16.0)
"""Times before and after the landing of least propellant, s, within which the front is bounded in every period."""
_SHORTEST = 2.0
"""Shortest landing that is tried, s."""


def bounded(contest: Contest) -> bool:
    """Whether a contest has such bounds: a mission under nominal conditions, and a craft that fits.

    Landings have them also with engines that are dead in every episode from the start.
    """
    nominal = contest.conditions is None
    problem = contest.task.optimal_problem
    try:
        if problem == "landing":
            Lander.of(contest.craft, _dead(contest), apart=True)
            return contest.conditions is None or contest.conditions.only_dead
        if nominal and problem == "approach":
            _at_port(contest, 0)
            return True
        if nominal and problem == "rendezvous":
            _meeting(contest, contest.start(0).goal)
            return True
    except ConfigError:
        pass
    return nominal and problem == "inspection" and contest.craft.propellant is None


def mission_bounds(
    contest: Contest, count: int, progress: Progress = unseen, before: MissionBounds | None = None
) -> MissionBounds:
    """Bounds of the first ``count`` starts, and of the front of the first.

    Args:
        contest: one that is `bounded`.
        count: number of starts.
        progress: reports every bound.
        before: bounds of fewer starts of this contest, which are not computed again.

    Raises:
        ConfigError: see `Meeting.of`, or of a landing `Lander.of`.
    """
    count = min(count, contest.episodes)
    if before is None:
        before = _first_bounds(contest, progress)
    lower = [*before.lower]
    for k in range(len(lower), count):
        lower.append(_lower(contest, k))
        progress(1)
    deadlines = None
    if contest.task.optimal_problem == "rendezvous":
        deadlines = np.array([_deadline(contest, k) for k in range(len(lower))])
    return replace(before, lower=np.array(lower), deadlines=deadlines)


def _first_bounds(contest: Contest, progress: Progress) -> MissionBounds:
    """Bounds of the first start and of its front: N s by the deadline, and (K,) N s over K times (s).

    Steps of progress are those that `steps_of` announces.
    """
    if contest.task.optimal_problem == "landing":
        return _landing_bounds(contest, progress)
    lower = _lower(contest, 0)
    progress(1)
    if contest.task.optimal_problem == "approach":
        return MissionBounds(np.array([lower]), np.zeros(0), np.zeros(0))
    if contest.task.optimal_problem == "inspection":
        times = np.linspace(0.0, contest.duration, _TIMES + 1)[1:]
    else:
        last = _deadline(contest, 0)
        task: Any = contest.task
        times = np.unique(np.linspace(min(task.deadline[0], last), last, _TIMES))
    front = []
    for time in times:
        front.append(_lower(contest, 0, float(time)))
        progress(1)
    return MissionBounds(np.array([lower]), times, np.array(front))


def _lower(contest: Contest, k: int, by: float | None = None) -> float:
    """Lower bound of start number k, of a success by a time, s; None: by its deadline or the end of the episode.

    N s, or kg of propellant for a landing; infinite if nothing succeeds.
    """
    problem = contest.task.optimal_problem
    if problem == "landing":
        best = _best_landing(contest, k)
        return math.inf if best is None else best.dual
    if problem == "approach":
        return least_to_approach(_at_port(contest, k), state_of(contest.start(k)))[0]
    if problem == "inspection":
        start: Any = map_leaves(lambda x: float(np.squeeze(x)), contest.start(k))
        within = contest.duration if by is None else by
        task: Any = contest.task
        return inspection_bound(
            contest.craft, task, start.start, start.goal, within, contest.timing
        )
    return _least(contest, k, _deadline(contest, k) if by is None else by)


def steps_of(contest: Contest, count: int) -> int:
    """Largest number of steps of progress that `mission_bounds` reports."""
    more = {"landing": 1, "approach": 0}.get(contest.task.optimal_problem, _TIMES)
    return min(count, contest.episodes) + more


def _landing_bounds(contest: Contest, progress: Progress) -> MissionBounds:
    """Bounds of the first landing; the certified ones are those that the dual solutions prove.

    Only `dual` is a bound: the propellant of a landing may be more than the least.
    """
    task: Any = contest.task
    lander = Lander.of(contest.craft, _dead(contest), apart=True)
    descent = Descent.of(task, craft=contest.craft)
    period = contest.timing.control_period
    first = _best_landing(contest, 0)
    progress(1)
    if first is None:
        progress(1)
        return MissionBounds(np.array([math.inf]), np.zeros(0), np.zeros(0), "propellant")
    early, late = (round(seconds / period) for seconds in _AROUND)
    around = first.time + period * np.arange(-early, late + 1)
    around = around[(around >= _SHORTEST) & (around <= contest.duration)]
    landings = [
        landing(lander, descent, _beside(contest, 0), float(time), period, "bound")
        for time in around
    ]
    progress(1)
    front = np.array([math.inf if landing is None else landing.dual for landing in landings])
    return MissionBounds(np.array([first.dual]), around, front, "propellant")


def _best_landing(contest: Contest, k: int) -> Landing | None:
    """The landing that gives the bound of start number k; None: there is none."""
    task: Any = contest.task
    lander = Lander.of(contest.craft, _dead(contest), apart=True)
    descent = Descent.of(task, craft=contest.craft)
    times = _SHORTEST, contest.duration
    start = _beside(contest, k)
    return best_landing(lander, descent, start, contest.timing.control_period, "bound", times)


def _dead(contest: Contest) -> tuple[int, ...]:
    """Numbers of engines that are dead in every flight."""
    return () if contest.conditions is None else contest.conditions.dead


def _beside(contest: Contest, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Position from the site, m, and velocity, m/s, of start number k, (3,) each."""
    scenario = contest.start(k)
    away = scenario.start.p - scenario.goal.p
    return np.ravel(away.columns()), np.ravel(scenario.start.v.columns())


def _meeting(contest: Contest, goal: State) -> Meeting:
    task: Any = contest.task
    return Meeting.of(contest.craft, task, goal)


def _at_port(contest: Contest, k: int) -> PortMeeting:
    task: Any = contest.task
    return PortMeeting.at_port(contest.craft, task, contest.timing, contest.start(k).goal)


def _deadline(contest: Contest, k: int) -> float:
    """Deadline of start number k, s: the first note of its goal is the time left until it."""
    return float(np.squeeze(contest.start(k).goal.notes.deadline))


def _least(contest: Contest, k: int, deadline: float) -> float:
    """Lower bound of the impulse of reaching the goal by a deadline (s), and staying if the task asks it, N s.

    Infinite where nothing arrives, and where the solver ends without an answer.
    """
    start = contest.start(k)
    state = state_of(start)
    meeting = _meeting(contest, start.goal)
    task: Any = contest.task
    try:
        if task.stay_seconds:
            return least_to_hold(meeting, state, deadline, task.stay_seconds)
        return rendezvous(meeting, state, deadline).lower
    except SolverFailed:
        return float("inf")
