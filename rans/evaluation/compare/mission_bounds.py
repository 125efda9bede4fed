"""Lower bounds of what missions spend, beside flights: impulse of missions on an orbit, propellant of landings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from rans.errors import ConfigError, SolverFailed
from rans.evaluation.compare.contest import Contest, Entry
from rans.evaluation.measure.metrics import impulses, propellant_used
from rans.model.dynamics import State
from rans.model.fields import leaves
from rans.optimal.convex.landing import Descent, Lander, best_landing, landing
from rans.optimal.convex.rendezvous import Meeting, rendezvous
from rans.progress import Progress, unseen

_TIMES = 8
"""Times at which the front of a start on an orbit is bounded."""
_ROUNDING = 1e-6
"""Relative error of what is spent and of a bound by rounding."""
_EARLIEST = 0.25
"""Earliest of these times, as a share of the deadline."""
_AROUND = (8.0, 16.0)
"""How long before and after the landing of least propellant the front is bounded, in every control period, s."""
_SHORTEST = 2.0
"""Shortest landing that is tried, s."""


@dataclass(frozen=True)
class MissionBounds:
    """Lower bounds for the first starts of a comparison.

    On an orbit they are of the impulse, without limits such as cones and keep-out balls. Of landings they are of
    the propellant, within the limits of the task, for a craft that has to turn and whose engines may be throttled
    one by one (`rans.optimal.convex.landing`).
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

    @property
    def unit(self) -> str:
        """Unit of the bounds: N s for impulse, kg for propellant."""
        return "N s" if self.spending == "impulse" else "kg"

    def spent(self, entry: Entry) -> np.ndarray:
        """Impulse, N s, or propellant, kg, of the first n flights (n,)."""
        amounts = impulses if self.spending == "impulse" else propellant_used
        return amounts(entry.flight)[: len(self.lower)]

    def over(self, entry: Entry) -> np.ndarray:
        """What was spent over the lower bound of the same start, (n,); NaN where the flight did not succeed."""
        flight = entry.flight
        assert flight.done is not None
        succeeded = (flight.done & ~flight.violated())[: len(self.lower)]
        return np.where(succeeded, self.spent(entry) / self.lower, np.nan)

    def ratios(self, entry: Entry) -> np.ndarray:
        """What was spent over the bound of the same start, of those of the first n flights that succeeded."""
        over = self.over(entry)
        return over[~np.isnan(over)]

    def table(self, entries: Sequence[Entry]) -> tuple[tuple[str, ...], list[list[str]]]:
        """Headings, and a row for each start: its bound, and what each contestant spent, with the ratio."""
        rows = []
        over = [self.over(entry) for entry in entries]
        spent = [self.spent(entry) for entry in entries]
        for k, lower in enumerate(self.lower):
            cells = [
                "did not succeed" if math.isnan(ratio[k]) else f"{used[k]:.1f} ({ratio[k]:.3f})"
                for ratio, used in zip(over, spent, strict=True)
            ]
            rows.append([str(k), f"{lower:.1f}" if math.isfinite(lower) else "impossible", *cells])
        return ("start", f"least {self.spending}, {self.unit}", *(e.name for e in entries)), rows

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
            "lower": [x if np.isfinite(x) else None for x in self.lower.tolist()],
            "times": self.times.tolist(),
            "front": [x if np.isfinite(x) else None for x in self.front.tolist()],
        }


def bounded(contest: Contest) -> bool:
    """Whether a contest has such bounds: a mission under nominal conditions, and a craft that fits.

    Landings have them also with engines that are dead in every episode from the start.
    """
    nominal = contest.conditions is None
    try:
        if contest.task.optimal_problem == "landing":
            Lander.of(contest.craft, _dead(contest), apart=True)
            return contest.conditions is None or contest.conditions.only_dead
        if nominal and contest.task.optimal_problem == "rendezvous":
            _meeting(contest, contest.start(0).goal)
            return True
    except ConfigError:
        pass
    return False


def mission_bounds(contest: Contest, count: int, progress: Progress = unseen) -> MissionBounds:
    """Bounds of the first ``count`` starts, and of the front of the first.

    Raises:
        ConfigError: see `Meeting.of`, or of a landing `Lander.of`.
    """
    count = min(count, contest.episodes)
    if contest.task.optimal_problem == "landing":
        return _landing_bounds(contest, count, progress)
    lower = []
    for k in range(count):
        lower.append(_least(contest, k, _deadline(contest, k)))
        progress(1)
    times = np.linspace(_EARLIEST, 1.0, _TIMES) * _deadline(contest, 0)
    front = []
    for time in times:
        front.append(_least(contest, 0, float(time)))
        progress(1)
    return MissionBounds(np.array(lower), times, np.array(front))


def steps_of(contest: Contest, count: int) -> int:
    """How often `mission_bounds` reports progress."""
    landed = contest.task.optimal_problem == "landing"
    return min(count, contest.episodes) + (1 if landed else _TIMES)


def _landing_bounds(contest: Contest, count: int, progress: Progress) -> MissionBounds:
    """Bounds of landings; the certified ones are those that the dual solutions prove."""
    task: Any = contest.task
    lander = Lander.of(contest.craft, _dead(contest), apart=True)
    descent = Descent.of(task, craft=contest.craft)
    period = contest.timing.control_period
    times = _SHORTEST, contest.duration
    lower = []
    first = None
    for k in range(count):
        best = best_landing(lander, descent, _beside(contest, k), period, "bound", times)
        lower.append(math.inf if best is None else best.dual)
        first = best if k == 0 else first
        progress(1)
    if first is None:
        progress(1)
        return MissionBounds(np.array(lower), np.zeros(0), np.zeros(0), "propellant")
    early, late = (round(seconds / period) for seconds in _AROUND)
    around = first.time + period * np.arange(-early, late + 1)
    around = around[(around >= _SHORTEST) & (around <= contest.duration)]
    found = [
        landing(lander, descent, _beside(contest, 0), float(time), period, "bound")
        for time in around
    ]
    progress(1)
    front = np.array([math.inf if one is None else one.dual for one in found])
    return MissionBounds(np.array(lower), around, front, "propellant", first.p)


def _dead(contest: Contest) -> tuple[int, ...]:
    """Numbers of engines that are dead in every flight."""
    return () if contest.conditions is None else contest.conditions.dead


def _beside(contest: Contest, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Position from the site, m, and velocity, m/s, of start number k, (3,) each."""
    one = contest.start(k)
    away = one.start.p - one.goal.p
    return np.ravel(away.columns()), np.ravel(one.start.v.columns())


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
    try:
        return rendezvous(_meeting(contest, start.goal), np.array(state), deadline).lower
    except SolverFailed:
        return float("inf")
