"""Many optimal control problems at once, in worker processes; every start gets an answer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool

from rans.model.spacecraft import Spacecraft
from rans.optimal.trajectory.allocation import check_attitude
from rans.optimal.trajectory.arrival import Arrival, goal_motion, moves_goal
from rans.optimal.trajectory.objectives import Objective
from rans.optimal.trajectory.transcription import Trajectory, Transcription, unsolved
from rans.processes import processors, submitted
from rans.scenario import Scenario, each, scenario
from rans.tasks.base import Task

_transcriptions: list[Transcription] = []
"""One per objective, in each worker process."""


def solve_all(
    craft: Spacecraft,
    task: Task,
    objectives: Sequence[Objective],
    starts: Scenario,
    workers: int | None = None,
    progress: Callable[[], object] = lambda: None,
    guesses: int = 1,
) -> list[list[Trajectory]]:
    """Solve every objective from every start: per objective N trajectories in the order of the starts.

    See `rans.processes.submitted` for worker processes and interrupts. The starts are of arrays (N,), as
    `rans.scenario.scenarios` gives them. By default there is one worker per processor; one solves in this
    process. Progress is called once per solved problem. A trajectory whose worker process
    died has the status "Worker_Died" and NaN for numbers.

    Raises:
        ConfigError: see `Transcription`.
    """
    check_attitude(craft, task)
    example = scenario(task, craft.dimension, seed=0, episode=0)
    for (
        objective
    ) in objectives:  # says here, not in every worker, if this task has no such trajectories
        Arrival(task, example.goal, objective.ending)
    if moves_goal(task):
        goal_motion(task, example.goal)
    jobs = [(index, one, guesses) for index in range(len(objectives)) for one in each(starts)]
    workers = workers or processors()
    answers = []
    if workers == 1:
        _build(craft, task, objectives)
        for job in jobs:
            answers.append(_solve(*job))
            progress()
    else:
        with submitted(_solve, jobs, workers, _build, (craft, task, objectives)) as futures:
            for _ in as_completed(futures):
                progress()
            answers = [
                unsolved(objectives[index], craft, one.start, "Worker_Died")
                if isinstance(future.exception(), BrokenProcessPool)
                else future.result()
                for future, (index, one, _) in zip(futures, jobs, strict=True)
            ]
    count = len(jobs) // max(1, len(objectives))
    return [answers[i * count : (i + 1) * count] for i in range(len(objectives))]


def _build(craft: Spacecraft, task: Task, objectives: Sequence[Objective]) -> None:
    _transcriptions[:] = [Transcription(craft, task, objective) for objective in objectives]


def _solve(index: int, one: Scenario, guesses: int) -> Trajectory:
    return _transcriptions[index].solve(one.start, one.goal, guesses)
