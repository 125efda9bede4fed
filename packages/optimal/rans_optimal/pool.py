"""Many optimal control problems at once, in worker processes; every start gets an answer."""

from __future__ import annotations

from rans.extend import Progress, Scenario, Spacecraft, Task, Workers, each, scenario, unseen
from rans_optimal.arrival import Arrival, goal_motion
from rans_optimal.checks import check_craft, check_task, moves_goal
from rans_optimal.objectives import Objective
from rans_optimal.transcription import Trajectory, Transcription, unsolved


def solve_all(
    craft: Spacecraft,
    task: Task,
    objective: Objective,
    starts: Scenario,
    workers: int | None = None,
    progress: Progress = unseen,
    guesses: int = 1,
) -> list[Trajectory]:
    """Solve an objective from every start: N trajectories in the order of the starts.

    See `rans.base.processes.Workers` for worker processes and interrupts. The starts are of arrays (N,), as
    `rans.episode.scenario.scenarios` gives them. By default there is one worker per processor; one solves in this
    process. Progress is reported once per solved problem. A trajectory whose worker process
    died has the status "Worker_Died" and NaN for numbers.

    Raises:
        ConfigError: see `Transcription`.
    """
    # Here, not in every worker: a worker that refuses would pass for one that died.
    check_craft(craft)
    check_task(craft, task)
    example = scenario(task, craft.dimension, seed=0, episode=0)
    Arrival(task, example.goal, objective.ending)
    if moves_goal(task):
        goal_motion(task, example.goal)
    jobs = [(start, guesses) for start in each(starts)]

    def lost(start: Scenario, guesses: int) -> Trajectory:
        return unsolved(objective, craft, start.start, "Worker_Died")

    pool = Workers(Transcription, (craft, task, objective), workers)
    answers: dict[int, Trajectory] = {}
    for number, trajectory in pool.finished(_solve, jobs, lost):
        answers[number] = trajectory
        progress(1)
    return [answers[k] for k in range(len(jobs))]


def _solve(transcription: Transcription, start: Scenario, guesses: int) -> Trajectory:
    return transcription.solve(start.start, start.goal, guesses)
