"""Many optimal control problems at once, in worker processes; every start gets an answer."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, as_completed
from concurrent.futures.process import BrokenProcessPool

from rans.model.dynamics import State
from rans.model.fields import leaves, map_leaves
from rans.model.spacecraft import Spacecraft
from rans.optimal.trajectory.arrival import aims
from rans.optimal.trajectory.objectives import Objective
from rans.optimal.trajectory.transcription import Trajectory, Transcription, unsolved
from rans.processes import submitted
from rans.scenario import Scenario
from rans.tasks.base import Task

_WORKER_DIED = "Worker_Died"

_transcriptions: list[Transcription] = []
"""One per objective, in each worker process."""


def solve_all(craft: Spacecraft, task: Task, objectives: Sequence[Objective], starts: Scenario,
              workers: int | None = None, progress: Callable[[], object] = lambda: None,
              guesses: int = 1) -> list[list[Trajectory]]:
    """Solve every objective from every start.

    See `rans.processes.submitted` for what worker processes ask of a script, and for interrupts.

    Args:
        craft: what flies.
        task: where to.
        objectives: what to minimise.
        starts: fields of arrays (N,), as `rans.flight.scenarios` gives them.
        workers: processes, by default one per processor; 1 solves in this process.
        progress: called once per solved problem.
        guesses: from which every problem is solved, see `Transcription.solve`.

    Returns:
        Per objective N trajectories in the order of the starts. One whose worker process died has the
        status "Worker_Died" and NaN for numbers.

    Raises:
        ConfigError: see `Transcription`.
    """
    aims(task)  # says here, not in every worker, if this task has no goal of its own
    jobs = [(index, scenario, guesses) for index in range(len(objectives)) for scenario in each(starts)]
    workers = workers or os.cpu_count() or 1
    if workers == 1:
        _build(craft, task, objectives)
        answers = [_called(progress, _solve(*job)) for job in jobs]
    else:
        answers = _in_processes(craft, task, objectives, jobs, workers, progress)
    count = len(jobs) // max(1, len(objectives))
    return [answers[i * count:(i + 1) * count] for i in range(len(objectives))]


def _in_processes(craft: Spacecraft, task: Task, objectives: Sequence[Objective],
                  jobs: Sequence[tuple[int, Scenario, int]], workers: int,
                  progress: Callable[[], object]) -> list[Trajectory]:
    with submitted(_solve, jobs, workers, _build, (craft, task, objectives)) as futures:
        for _ in as_completed(futures):
            progress()
        return [_answer(future, objectives[index], craft, scenario.start)
                for future, (index, scenario, _) in zip(futures, jobs, strict=True)]


def _answer(future: Future[Trajectory], objective: Objective, craft: Spacecraft,
            start: State) -> Trajectory:
    try:
        return future.result()
    except BrokenProcessPool:
        return unsolved(objective, craft, start, _WORKER_DIED)


def _build(craft: Spacecraft, task: Task, objectives: Sequence[Objective]) -> None:
    _transcriptions[:] = [Transcription(craft, task, objective) for objective in objectives]


def _solve(index: int, scenario: Scenario, guesses: int) -> Trajectory:
    return _transcriptions[index].solve(scenario.start, scenario.goal, guesses)


def _called(progress: Callable[[], object], answer: Trajectory) -> Trajectory:
    progress()
    return answer


def each(starts: Scenario) -> Iterator[Scenario]:
    """The scenarios of a batch, of floats."""
    for k in range(len(leaves(starts.start)[0])):
        yield map_leaves(lambda field, k=k: float(field[k]), starts)
