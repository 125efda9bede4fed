"""Lower bounds of what missions spend, beside flights: impulse in orbits, propellant of landings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from rans.errors import ConfigError, SolverFailed
from rans.evaluation.compare.contest import Contest, Entry
from rans.evaluation.measure.metrics import impulses, propellant_used
from rans.model.dynamics import State
from rans.model.fields import leaves, map_leaves
from rans.optimal.convex.holding import least_to_hold
from rans.optimal.convex.inspection import inspection_bound
from rans.optimal.convex.landing import Descent, Lander, Landing, best_landing, landing
from rans.optimal.convex.rendezvous import Meeting, rendezvous
from rans.progress import Progress, unseen

_TIMES = 8
"""Times at which the front of a start on an orbit is bounded, from the earliest deadline of the task on."""
_ROUNDING = 1e-6
"""Relative error of what is spent and of a bound by rounding."""
_AROUND = (8.0, 16.0)
"""Times before and after the landing of least propellant, s, within which the front is bounded in every period."""
_SHORTEST = 2.0
"""Shortest landing that is tried, s."""


@dataclass(frozen=True)
class MissionBounds:
    """Lower bounds for the first starts of a comparison.

    On an orbit they are of the impulse, without limits such as cones and keep-out balls, and of inspections too
    (`rans.optimal.convex.inspection`). Of landings they are of the propellant, within the limits of the task, for a
    craft that has to turn and whose engines may be throttled one by one (`rans.optimal.convex.landing`).
    """

    lower: np.ndarray
    """(n,) of success from each of the first n starts, on an orbit by its deadline; infinite: there is none."""
    times: np.ndarray
    """(m,) s: times of the front of the first start."""
    front: np.ndarray
    """(m,) of success by each of these times, or of a landing at this time; infinite: there is none."""
    spending: Literal["impulse", "propellant"] = "impulse"
    """What is bounded: impulse, N s, or propellant, kg."""
    path: np.ndarray | None = None
    """(N + 1, 3) m: the positions of the landing that gives the bound of the first start; None: no landing."""
    deadlines: np.ndarray | None = None
    """(n,) s: deadline of each of these starts; None: the end of the episode."""

    @property
    def unit(self) -> str:
        """Unit of the bounds: N s for impulse, kg for propellant."""
        return "N s" if self.spending == "impulse" else "kg"

    def spent(self, entry: Entry) -> np.ndarray:
        """Impulse, N s, or propellant, kg, of the first n flights (n,)."""
        amounts = impulses if self.spending == "impulse" else propellant_used
        return amounts(entry.flight)[: len(self.lower)]

    def over(self, entry: Entry) -> np.ndarray:
        """Ratio of cost to the lower bound of the same start, (n,); NaN without a success, or for a bound of 0."""
        flight = entry.flight
        assert flight.done is not None
        succeeded = (flight.done & ~flight.violated())[: len(self.lower)]
        lower = np.where(self.lower > 0.0, self.lower, np.nan)
        return np.where(succeeded, self.spent(entry) / lower, np.nan)

    def ratios(self, entry: Entry) -> np.ndarray:
        """Ratio of cost to the bound (> 0) of the same start, for those of the first n flights that succeeded."""
        over = self.over(entry)
        return over[~np.isnan(over)]

    def table(self, entries: Sequence[Entry]) -> tuple[tuple[str, ...], list[list[str]]]:
        """Headings, and a row for each start: deadline, bound, and what each contestant spent, with the ratio."""
        rows = []
        over = [self.over(entry) for entry in entries]
        for k, lower in enumerate(self.lower):
            cells = [
                self._cell(entry, k, float(ratio[k]))
                for entry, ratio in zip(entries, over, strict=True)
            ]
            deadline = [] if self.deadlines is None else [f"{self.deadlines[k]:,.0f}"]
            least = f"{lower:.3g}" if math.isfinite(lower) else "impossible"
            rows.append([str(k), *deadline, least, *cells])
        headings = ["start"] if self.deadlines is None else ["start", "deadline, s"]
        return (*headings, f"least {self.spending}, {self.unit}", *(e.name for e in entries)), rows

    def _cell(self, entry: Entry, k: int, ratio: float) -> str:
        """Text of the cost of a contestant from a start, and its ratio to the bound, if there is one."""
        if not entry.won[k]:
            return "did not succeed"
        spent = f"{self.spent(entry)[k]:.3g}"
        return spent if math.isnan(ratio) else f"{spent} ({ratio:.3f})"

    def sentence(self, entries: Sequence[Entry]) -> str:
        """Mean ratio of every contestant, in a sentence."""
        parts = []
        for entry in entries:
            ratios = self.ratios(entry)
            mean = f"{ratios.mean():.3f}" if len(ratios) else "none succeeded"
            some = f" ({len(ratios)})" if 0 < len(ratios) < len(self.lower) else ""
            parts.append(f"{entry.name} {mean}{some}")
        return (
            f"{self.spending.capitalize()} over the certified least, mean of the first {len(self.lower)} starts "
            f"that succeeded: {', '.join(parts)}."
        )

    def impossible(self, entries: Sequence[Entry]) -> list[str]:
        """Sentences about flights below their bound, each of which would prove an error in the package."""
        return [
            f"{entry.name} beats the certified least {self.spending}: the bound or the flight is wrong."
            for entry in entries
            if np.any(self.ratios(entry) < 1.0 - _ROUNDING)
        ]

    def to_json(self) -> dict[str, Any]:
        """Data for `rans.files.write_json`; what is impossible is None."""
        return {
            "spending": self.spending,
            "deadlines": None if self.deadlines is None else self.deadlines.tolist(),
            "lower": [x if np.isfinite(x) else None for x in self.lower.tolist()],
            "times": self.times.tolist(),
            "front": [x if np.isfinite(x) else None for x in self.front.tolist()],
        }


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
    """Bounds of the first start, and of its front."""
    if contest.task.optimal_problem == "landing":
        return _landing_bounds(contest, progress)
    lower = _lower(contest, 0)
    progress(1)
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
    """Lower bound of start number k, of a success by a time, s; None: by its deadline or the end of the episode."""
    problem = contest.task.optimal_problem
    if problem == "landing":
        best = _best_landing(contest, k)
        return math.inf if best is None else best.dual
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
    landed = contest.task.optimal_problem == "landing"
    return min(count, contest.episodes) + (1 if landed else _TIMES)


def _landing_bounds(contest: Contest, progress: Progress) -> MissionBounds:
    """Bounds of the first landing; the certified ones are those that the dual solutions prove."""
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
    return MissionBounds(np.array([first.dual]), around, front, "propellant", first.p)


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


def _deadline(contest: Contest, k: int) -> float:
    """Deadline of start number k, s: the first note of its goal is the time left until it."""
    notes: Any = contest.start(k).goal.notes
    return float(np.squeeze(notes[0]))


def _least(contest: Contest, k: int, deadline: float) -> float:
    start = contest.start(k)
    state = [float(np.squeeze(x)) for x in (*leaves(start.start.p), *leaves(start.start.v))]
    meeting = _meeting(contest, start.goal)
    task: Any = contest.task
    try:
        if task.stay_seconds:
            return least_to_hold(meeting, np.array(state), deadline, task.stay_seconds)
        return rendezvous(meeting, np.array(state), deadline).lower
    except SolverFailed:
        return float("inf")
