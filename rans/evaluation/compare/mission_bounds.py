"""Lower bounds of the impulse of missions on an orbit, beside the flights of a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rans.errors import ConfigError, SolverFailed
from rans.evaluation.compare.contest import Contest, Entry
from rans.evaluation.measure.metrics import impulses
from rans.model.dynamics import State
from rans.model.fields import leaves
from rans.optimal.convex.rendezvous import Meeting, rendezvous
from rans.progress import Progress, unseen

_TIMES = 8
"""Times at which the front of a start is bounded."""
_ROUNDING = 1e-6
"""Relative error of an impulse and of a bound by rounding."""
_EARLIEST = 0.25
"""Earliest of these times, as a share of the deadline."""


@dataclass(frozen=True)
class MissionBounds:
    """Lower bounds for the first starts of a comparison, without limits such as cones and keep-out balls."""

    lower: np.ndarray
    """(n,) N s: of success by the deadline of each of the first n starts."""
    times: np.ndarray
    """(m,) s: times of the front of the first start."""
    front: np.ndarray
    """(m,) N s: of success by each of these times; infinite where the thrusters are too weak."""

    def ratios(self, entry: Entry) -> np.ndarray:
        """Impulse over the lower bound of the same start, of those of the first n flights that succeeded."""
        flight = entry.flight
        assert flight.done is not None
        succeeded = flight.done & ~flight.violated()
        count = len(self.lower)
        return (impulses(flight)[:count] / self.lower)[succeeded[:count]]

    def sentence(self, entries: Sequence[Entry]) -> str:
        """Mean ratio of every contestant, in a sentence."""
        parts = []
        for entry in entries:
            ratios = self.ratios(entry)
            mean = f"{ratios.mean():.3f}" if len(ratios) else "none succeeded"
            some = f" ({len(ratios)})" if 0 < len(ratios) < len(self.lower) else ""
            parts.append(f"{entry.name} {mean}{some}")
        return (
            f"Impulse over the certified least, mean of the first {len(self.lower)} starts that succeeded: "
            f"{', '.join(parts)}."
        )

    def impossible(self, entries: Sequence[Entry]) -> list[str]:
        """Sentences about flights below their bound, each of which would prove an error in the package."""
        return [
            f"{entry.name} beats the certified least impulse: the bound or the flight is wrong."
            for entry in entries
            if np.any(self.ratios(entry) < 1.0 - _ROUNDING)
        ]

    def to_json(self) -> dict[str, Any]:
        """Data for `rans.files.write_json`; what is impossible is None."""
        return {
            "lower": [x if np.isfinite(x) else None for x in self.lower.tolist()],
            "times": self.times.tolist(),
            "front": [x if np.isfinite(x) else None for x in self.front.tolist()],
        }


def bounded(contest: Contest) -> bool:
    """Whether a contest has such bounds: an orbital mission under nominal conditions, and a craft that fits."""
    if contest.conditions is not None or contest.task.optimal_problem != "rendezvous":
        return False
    try:
        _meeting(contest, contest.start(0).goal)
    except ConfigError:
        return False
    return True


def mission_bounds(contest: Contest, count: int, progress: Progress = unseen) -> MissionBounds:
    """Bounds of the first ``count`` starts, and of the front of the first.

    Raises:
        ConfigError: see `Meeting.of`.
    """
    lower = []
    for k in range(min(count, contest.episodes)):
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
    return min(count, contest.episodes) + _TIMES


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
