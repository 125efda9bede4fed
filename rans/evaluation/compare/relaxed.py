"""Relaxed optima: trajectories whose commands are any numbers from 0 to 1, flown in Drake.

Drake throttles thrusters too, even if the craft's valves are on/off. The trajectories are locally optimal, without
disturbances and, but for the largest return, end at the exact goal. They are references for comparison, and neither
controllers nor certificates.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from rans.evaluation.compare.contest import Contest
from rans.evaluation.compare.optima import Optimum, optima
from rans.evaluation.measure.metrics import impulses, returns, settling_times
from rans.model.fields import map_leaves
from rans.optimal.trajectory.objectives import MaximumReward, MinimumFuel, MinimumTime, Objective
from rans.optimal.trajectory.transcription import usual_guesses
from rans.progress import Progress, unseen

_GUESSES = 2
"""Guesses for the largest return, which has many local optima: a turn in either direction."""


@dataclass(frozen=True)
class Relaxed:
    """Optimum of one objective from one start; numbers without a solution are NaN."""

    objective: Objective
    start: int
    status: str
    """Result in words."""
    solved: bool
    """Whether there is a trajectory, and the flight in Drake follows it."""
    seconds: float
    """Wall time of the optimiser."""
    arrival: float = math.nan
    """Time of arrival at the exact goal, s."""
    settling: float = math.nan
    """Time from which all errors are within their tolerances, in Drake, s."""
    thrust: float = math.nan
    """Impulse, N s."""
    total: float = math.nan
    """Sum of the task's rewards over the episode, in Drake; NaN if its control period is not the task's."""
    replay_error: float = math.nan
    """Largest distance between the optimised path and the flight in Drake, m."""
    too_early: bool = False
    """Whether the objective's time is less than the least time from this start: not a failure, but impossible."""


def objectives(
    contest: Contest, horizons: Sequence[float], returns: bool = True
) -> list[Objective]:
    """Least time, least impulse for each horizon (s), and with ``returns`` the largest return of the task."""
    period = contest.timing.control_period
    asked: list[Any] = [MinimumTime(), *(MinimumFuel(horizon, period) for horizon in horizons)]
    return [*asked, MaximumReward(contest.duration, period)] if returns else asked


def solve(
    contest: Contest,
    objective: Objective,
    workers: int | None = None,
    progress: Progress = unseen,
    earliest: Sequence[float] = (),
) -> list[Relaxed]:
    """Optimise from every start of a contest; for workers and progress see `optima`.

    Args:
        contest: contest with the starts.
        objective: objective.
        workers: processes.
        progress: reports solved problems.
        earliest: least times of the starts, s, NaN where it is not known. Starts from which an arrival at the
            horizon of a least impulse is impossible are not optimised.
    """
    usual = usual_guesses(contest.craft, contest.task, objective)
    guesses = max(_GUESSES, usual) if isinstance(objective, MaximumReward) else usual
    # Starts from which there is a trajectory in this time.
    horizon = objective.horizon if isinstance(objective, MinimumFuel) else math.inf
    # Starts whose arrival the horizon forbids are rows without a flight.
    late = {k for k, least in enumerate(earliest) if least > horizon}
    possible = [k for k in range(contest.episodes) if k not in late]
    starts = map_leaves(lambda x: x[possible], contest.starts)
    answers = (
        optima(
            contest.craft,
            contest.task,
            objective,
            starts,
            guesses,
            workers,
            progress,
            contest.timing,
        )
        if possible
        else []
    )
    solved = {
        k: _scored(contest, objective, replace(answer, start=k))
        for k, answer in zip(possible, answers, strict=True)
    }
    progress(len(late))
    return [
        _too_early(objective, k, earliest[k]) if k in late else solved[k]
        for k in range(contest.episodes)
    ]


def _too_early(objective: Objective, start: int, least: float) -> Relaxed:
    status = f"impossible: the least time is {least:.3g} s"
    return Relaxed(objective, start, status, solved=False, seconds=0.0, too_early=True)


def _scored(contest: Contest, objective: Objective, optimum: Optimum) -> Relaxed:
    """Scores of one relaxed optimum, of its flight in Drake; only its sentence if it has no good flight.

    Of the flight, not of the solver: what the solver says is only whether there is one.
    """
    trajectory = optimum.trajectory
    flight = optimum.flight
    head = (objective, optimum.start, optimum.sentence, optimum.good, trajectory.seconds)
    if flight is None or not optimum.good:
        return Relaxed(*head)
    same_rate = math.isclose(trajectory.control_period, contest.timing.control_period)
    return Relaxed(
        *head,
        len(trajectory.commands) * trajectory.control_period,
        float(settling_times(flight)[0]),
        float(impulses(flight)[0]),
        float(returns(flight)[0]) if same_rate else math.nan,
        optimum.replay_error,
    )
