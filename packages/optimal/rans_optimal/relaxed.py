"""Relaxed optima: trajectories whose commands are any numbers from 0 to 1, flown in Drake.

Drake throttles thrusters too, even if the craft's valves are on/off. The trajectories are locally optimal, without
disturbances and, but for the largest return, end at the exact goal. They are references for comparison, and neither
controllers nor certificates.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from rans.evaluation.compare.run import Relaxed
from rans.extend import (
    Comparison,
    ConfigError,
    Contest,
    Progress,
    Stages,
    counted,
    impulses,
    last_fifth,
    map_leaves,
    require,
    unseen,
)
from rans_optimal.checks import check_craft, check_task
from rans_optimal.objectives import (
    MaximumReward,
    MinimumFuel,
    MinimumTime,
    Objective,
)
from rans_optimal.optima import Optimum, optima
from rans_optimal.transcription import usual_guesses

_GUESSES = 2
"""Guesses for the largest return, which has many local optima: a turn in either direction."""
_MULTIPLES = (2.0, 4.0)
"""Multiples of `Comparison.least_time` by which the least impulse is computed, if the comparison has them."""
_NAMES: dict[type[Objective], str] = {
    MinimumTime: "time",
    MinimumFuel: "fuel",
    MaximumReward: "reward",
}
"""Objectives as `Relaxed.objective` has them."""


def add_relaxed(
    comparison: Comparison, *, stages: Stages, workers: int | None, returns: bool, **_: object
) -> None:
    """Add optima with partly open thrusters to a comparison, or the reason for which there are none.

    Times come first: starts from which no found trajectory arrives by a horizon are then known, and not searched.
    That proves nothing, as these times are local optima.
    """
    contest = comparison.contest
    try:
        check_craft(contest.craft)
        check_task(contest.craft, contest.task)
        require("pydrake")
    except ConfigError as reason:
        comparison.notes.append(f"No optimum is computed: {reason}")
        return
    fastest: list[float] = []
    # Who arrives in the last fifth of an episode has not settled (`rans.episode.verdict`).
    steps = contest.timing.episode_steps
    latest = contest.timing.control_period * (steps - last_fifth(steps))
    chosen = [multiple for multiple in _MULTIPLES if multiple in comparison.multiples]
    horizons = sorted({min(horizon, latest) for horizon in comparison.horizons(chosen)})
    for objective in objectives(contest, horizons, returns):
        step = stages(f"relaxed optimum: {objective.name}", contest.episodes)
        with comparison.noting(objective.name):
            found = solve(contest, objective, workers, step, fastest)
            comparison.relaxed[objective.name] = found
            if isinstance(objective, MinimumTime):
                fastest = [optimum.arrival for optimum in found]
            # What is not searched is no failure; what the optimiser cannot find is one.
            late = [fastest[optimum.start] for optimum in found if optimum.too_early]
            if late:
                comparison.notes.append(
                    f"{objective.name}: not searched from {len(late)} of {counted(len(found), 'start')}, where "
                    f"the fastest trajectories found take {min(late):.3g} s or more."
                )
            lost = [
                optimum.status for optimum in found if not (optimum.solved or optimum.too_early)
            ]
            if lost:
                comparison.failures.append(
                    f"{objective.name}: no trajectory from {len(lost)} of {counted(len(found), 'start')} "
                    f"({'; '.join(sorted(set(lost)))})."
                )


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
    fastest: Sequence[float] = (),
) -> list[Relaxed]:
    """Optimise from every start of a contest; for workers and progress see `optima`.

    Args:
        contest: contest with the starts.
        objective: objective.
        workers: processes.
        progress: reports solved problems.
        fastest: times of the fastest trajectories found, s, NaN where there is none. Starts from which they arrive
            after the horizon of a least impulse are not optimised.
    """
    usual = usual_guesses(contest.craft, contest.task, objective)
    guesses = max(_GUESSES, usual) if isinstance(objective, MaximumReward) else usual
    # Starts from which there is a trajectory in this time.
    horizon = objective.horizon if isinstance(objective, MinimumFuel) else math.inf
    # Starts that arrive after the horizon are rows without a flight.
    late = {k for k, time in enumerate(fastest) if time > horizon}
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
        _too_early(objective, k, fastest[k]) if k in late else solved[k]
        for k in range(contest.episodes)
    ]


def _too_early(objective: Objective, start: int, time: float) -> Relaxed:
    status = f"not searched: the fastest trajectory found takes {time:.3g} s"
    return Relaxed(
        _NAMES[type(objective)], start, status, solved=False, seconds=0.0, too_early=True
    )


def _scored(contest: Contest, objective: Objective, optimum: Optimum) -> Relaxed:
    """Scores of one relaxed optimum, of its flight in Drake; only its sentence if it has no good flight.

    Of the flight, not of the solver: what the solver says is only whether there is one.
    """
    trajectory = optimum.trajectory
    flight = optimum.flight
    name = _NAMES[type(objective)]
    head = (name, optimum.start, optimum.sentence, optimum.good, trajectory.seconds)
    if flight is None or not optimum.good:
        return Relaxed(*head)
    verdict = flight.verdict
    settled = verdict.settled[0] * flight.timing.control_period if verdict.solved[0] else math.inf
    same_rate = math.isclose(trajectory.control_period, contest.timing.control_period)
    return Relaxed(
        *head,
        len(trajectory.commands) * trajectory.control_period,
        float(settled),
        float(impulses(flight)[0]),
        float(sum(term.sum() for term in flight.rewards().values())) if same_rate else math.nan,
        optimum.replay_error,
    )
