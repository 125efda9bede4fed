"""Relaxed optima: trajectories whose thrust may be anything between shut and open, flown in Drake.

Drake throttles there too, whatever the craft's valves can do. They are locally optimal, know the future and,
but for the greatest reward, arrive at the exact goal: marks to measure by, no controllers or certificates.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rans.evaluation.compare.contest import Contest
from rans.evaluation.compare.optima import Optimum, optima
from rans.evaluation.measure.metrics import impulses, returns, settling_times
from rans.optimal.trajectory.objectives import MaximumReward, MinimumFuel, MinimumTime, Objective
from rans.optimal.trajectory.transcription import usual_guesses
from rans.progress import Progress, unseen

_GUESSES = 2
"""For the greatest reward, whose local optima are many: turning either way round."""


@dataclass(frozen=True)
class Relaxed:
    """One optimum from one start; NaN for what an unsolved problem does not have."""

    objective: Objective
    start: int
    status: str
    """How it ended, in words."""
    solved: bool
    """Whether there is a trajectory, and Drake flies it."""
    seconds: float
    """Wall time of the optimiser."""
    arrival: float = math.nan
    """At the exact goal, s."""
    settling: float = math.nan
    """When all errors enter their tolerances for good, in Drake, s."""
    thrust: float = math.nan
    """Thrust-time, N s."""
    total: float = math.nan
    """Sum of the task's rewards over the episode, in Drake; NaN if it acts at a rate of its own."""
    replay_error: float = math.nan
    """Largest distance between the optimised path and the one flown in Drake, m."""


def objectives(contest: Contest, horizons: Sequence[float]) -> list[Objective]:
    """Least time, least thrust-time for each horizon (s), and the greatest sum of the task's rewards."""
    period = contest.timing.control_period
    greatest: Any = MaximumReward(contest.duration, period)
    return [MinimumTime(), *(MinimumFuel(horizon, period) for horizon in horizons), greatest]


def solve(
    contest: Contest,
    objective: Objective,
    workers: int | None = None,
    progress: Progress = unseen,
) -> list[Relaxed]:
    """The optimum from every start of a contest; see `optima` for workers and progress."""
    usual = usual_guesses(contest.craft, contest.task)
    guesses = max(_GUESSES, usual) if isinstance(objective, MaximumReward) else usual
    result = optima(
        contest.craft,
        contest.task,
        objective,
        contest.starts,
        guesses,
        workers,
        progress,
        contest.timing,
    )
    return [_scored(contest, objective, one) for one in result]


def _scored(contest: Contest, objective: Objective, one: Optimum) -> Relaxed:
    trajectory = one.trajectory
    flight = one.flight
    head = (objective, one.start, one.sentence, one.good, trajectory.seconds)
    if flight is None or not one.good:
        return Relaxed(*head)
    same_rate = math.isclose(trajectory.control_period, contest.timing.control_period)
    return Relaxed(
        *head,
        len(trajectory.commands) * trajectory.control_period,
        float(settling_times(flight)[0]),
        float(impulses(flight)[0]),
        float(returns(flight)[0]) if same_rate else math.nan,
        one.replay_error,
    )
