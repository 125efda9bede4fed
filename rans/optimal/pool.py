"""Many optimal control problems at once, in worker processes; every start gets an answer."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool

from rans.dynamics import State
from rans.fields import leaves, map_leaves
from rans.optimal.objectives import Objective
from rans.optimal.transcription import Trajectory, Transcription, unsolved
from rans.scenario import Scenario
from rans.spacecraft import Spacecraft
from rans.tasks.base import Task

_WORKER_DIED = "Worker_Died"

_transcriptions: list[Transcription] = []
"""One per objective, in each worker process."""


def solve_all(craft: Spacecraft, task: Task, objectives: Sequence[Objective], starts: Scenario,
              workers: int | None = None,
              progress: Callable[[], object] = lambda: None) -> list[list[Trajectory]]:
    """Solve every objective from every start.

    Worker processes are started afresh, not forked: the parent may hold threads (torch, Drake) that a
    fork would copy half alive. With the default start method of a script that means its top level must
    be guarded by ``if __name__ == "__main__"``. An interrupt waits for the problems in work, drops the
    rest and is raised again.

    Args:
        craft: what flies.
        task: where to.
        objectives: what to minimise.
        starts: fields of arrays (N,), as `rans.flight.scenarios` gives them.
        workers: processes, by default one per processor; 1 solves in this process.
        progress: called once per solved problem.

    Returns:
        Per objective N trajectories in the order of the starts. One whose worker process died has the
        status "Worker_Died" and NaN for numbers.
    """
    jobs = [(index, scenario) for index in range(len(objectives)) for scenario in _each(starts)]
    workers = workers or os.cpu_count() or 1
    if workers == 1:
        _build(craft, task, objectives)
        answers = [_called(progress, _solve(*job)) for job in jobs]
    else:
        answers = _in_processes(craft, task, objectives, jobs, workers, progress)
    count = len(jobs) // max(1, len(objectives))
    return [answers[i * count:(i + 1) * count] for i in range(len(objectives))]


def _in_processes(craft: Spacecraft, task: Task, objectives: Sequence[Objective],
                  jobs: Sequence[tuple[int, Scenario]], workers: int,
                  progress: Callable[[], object]) -> list[Trajectory]:
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _build_in_worker,
                             (craft, task, objectives)) as pool:
        try:
            with _interrupts_ignored():  # by the workers that start now, for as long as they live
                futures = [pool.submit(_solve, *job) for job in jobs]
            for _ in as_completed(futures):
                progress()
        except BaseException:
            pool.shutdown(cancel_futures=True)  # waits for the few in work
            raise
        return [_answer(future, objectives[index], craft, scenario.start)
                for future, (index, scenario) in zip(futures, jobs, strict=True)]


def _answer(future: Future[Trajectory], objective: Objective, craft: Spacecraft,
            start: State) -> Trajectory:
    try:
        return future.result()
    except BrokenProcessPool:
        return unsolved(objective, craft, start, _WORKER_DIED)


def _build_in_worker(craft: Spacecraft, task: Task, objectives: Sequence[Objective]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the parent decides
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _build(craft, task, objectives)


def _end_with_parent() -> None:
    """A parent that was killed leaves no workers behind."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _build(craft: Spacecraft, task: Task, objectives: Sequence[Objective]) -> None:
    _transcriptions[:] = [Transcription(craft, task, objective) for objective in objectives]


def _solve(index: int, scenario: Scenario) -> Trajectory:
    return _transcriptions[index].solve(scenario.start, scenario.goal)


def _called(progress: Callable[[], object], answer: Trajectory) -> Trajectory:
    progress()
    return answer


def _each(starts: Scenario) -> Iterator[Scenario]:
    """The scenarios of a batch, of floats."""
    for k in range(len(leaves(starts.start)[0])):
        yield map_leaves(lambda field, k=k: float(field[k]), starts)


@contextlib.contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """A process started now ignores Ctrl-C from its first moment, and not only once it has loaded."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
