"""Worker processes that are spawned, ignore interrupts and end with their parent.

Whatever a job needs is pickled; flights of slow controllers, optima and trainings divide their work here.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any, Generic, TypeVar

import cloudpickle

from rans.errors import RansError
from rans.executors import answers, chosen_executor, use_one_thread

Answer = TypeVar("Answer")
State = TypeVar("State")

_SAFE_PATH = "PYTHONSAFEPATH"
"""Environment variable that keeps Python from searching the current folder before its library."""


def processors() -> int:
    """Number of processors that this process may use; a cluster job may have fewer than its machine."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextlib.contextmanager
def submitted(
    function: Callable[..., Answer],
    jobs: Iterable[tuple[Any, ...]],
    workers: int | None,
    prepare: Callable[..., object],
    arguments: tuple[Any, ...],
) -> Iterator[list[Future[Answer]]]:
    """Context of jobs that run in other processes, as futures in order.

    The processes are spawned instead of forked, because a fork does not copy the threads of torch and Drake. An
    interrupt, or any other early end of the block, ends the processes at once; unfinished jobs are lost.

    Args:
        function: called with one tuple of arguments per job; defined at the top level of a module.
        jobs: arguments of each job.
        workers: number of processes; None: one per processor.
        prepare: called once in every process before its first job; defined at the top level of a module.
        arguments: arguments of ``prepare``.
    """
    # Processes start with signals held back, and die with this block.
    others = set(multiprocessing.active_children())
    with contextlib.ExitStack() as files:
        file = files.enter_context(_pickled(prepare, arguments))
        with _started_safely():  # the locks of the pool start a process
            pool = files.enter_context(
                ProcessPoolExecutor(
                    workers or processors(),
                    multiprocessing.get_context("spawn"),
                    _begin,
                    (_unpickled, (file,)),
                )
            )
        try:
            with _started_safely(), _interrupts_deferred(), _script_left_alone():
                futures = [
                    pool.submit(_answered, cloudpickle.dumps((function, job))) for job in jobs
                ]
            yield futures
        except BaseException:
            for process in set(multiprocessing.active_children()) - others:
                process.kill()
            # Otherwise the thread of the pool waits forever for the rest of an unfinished answer.
            vars(pool)["_result_queue"]._writer.close()
            pool.shutdown(cancel_futures=True)
            raise


class Workers(Generic[State]):
    """Workers, each of which creates a state once and answers jobs with it.

    They are the executor of `rans.executors.run_on` within its context, and else processes of this machine, which
    start and end as those of `submitted`, and use one thread of torch each.

    Args:
        make: creates the state, such as a controller and its task; defined at the top level of a module.
        arguments: arguments of ``make``, which can be pickled.
        count: number of processes of this machine; None: one per processor; 1: jobs run in this process, whatever
            the executor.
        work: description of the work in the past tense for the error when a process dies, such as "flew episodes".
    """

    def __init__(
        self,
        make: Callable[..., State],
        arguments: tuple[Any, ...] = (),
        count: int | None = None,
        work: str = "worked",
    ) -> None:
        self._make = make
        self._arguments = arguments
        self._count = count
        self._work = work

    def ordered(
        self, function: Callable[..., Answer], jobs: Sequence[tuple[Any, ...]]
    ) -> Generator[Answer]:
        """Yield answers in the order of the jobs, each as soon as it and those before it are known.

        Args:
            function: called with the state and the arguments of a job; defined at the top level of a module.
            jobs: arguments of each job.

        Raises:
            RansError: a process died.
        """
        if self._is_here():
            yield from self._here(function, jobs)
            return
        if (executor := chosen_executor()) is not None:
            early: dict[int, Answer] = {}
            following = 0
            for number, answer in self._on(executor, function, jobs):
                early[number] = answer
                while following in early:
                    yield early.pop(following)
                    following += 1
            return
        with self._submitted(function, jobs) as futures:
            for future in futures:
                yield self._answer(future)

    def finished(
        self,
        function: Callable[..., Answer],
        jobs: Sequence[tuple[Any, ...]],
        dead: Callable[..., Answer] | None = None,
    ) -> Generator[tuple[int, Answer]]:
        """Yield number and answer of every job, in the order in which they end.

        Args:
            function: called with the state and the arguments of a job; defined at the top level of a module.
            jobs: arguments of each job.
            dead: called with the arguments of a job whose process died, for its answer; None: raise an error.

        Raises:
            RansError: a process died, and ``dead`` is None.
        """
        if self._is_here():
            yield from enumerate(self._here(function, jobs))
            return
        if (executor := chosen_executor()) is not None:
            yield from self._on(executor, function, jobs, dead)
            return
        with self._submitted(function, jobs) as futures:
            numbers = {future: k for k, future in enumerate(futures)}
            for future in as_completed(futures):
                number = numbers[future]
                if dead is not None and isinstance(future.exception(), BrokenProcessPool):
                    yield number, dead(*jobs[number])
                else:
                    yield number, self._answer(future)

    def _is_here(self) -> bool:
        """Whether jobs run in this process."""
        alone = self._count is None and processors() == 1 and chosen_executor() is None
        return alone or self._count == 1

    def _on(
        self,
        executor: Executor,
        function: Callable[..., Answer],
        jobs: Sequence[tuple[Any, ...]],
        dead: Callable[..., Answer] | None = None,
    ) -> Generator[tuple[int, Answer]]:
        """Number and answer of each job from a user's executor, as they end."""
        return answers(executor, self._make, self._arguments, function, jobs, dead, self._work)

    def _here(
        self, function: Callable[..., Answer], jobs: Iterable[tuple[Any, ...]]
    ) -> Iterator[Answer]:
        state = self._make(*self._arguments)
        for job in jobs:
            yield function(state, *job)

    def _submitted(
        self, function: Callable[..., Answer], jobs: Sequence[tuple[Any, ...]]
    ) -> contextlib.AbstractContextManager[list[Future[Answer]]]:
        """Context of a pool whose processes work on all jobs, as futures in order; no more processes than jobs.

        The state is made once in each process, at its start.
        """
        return submitted(
            _with_state,
            [(function, *job) for job in jobs],
            max(1, min(self._count or processors(), len(jobs))),
            _make_state,
            (self._make, self._arguments),
        )

    def _answer(self, future: Future[Answer]) -> Answer:
        try:
            return future.result()
        except BrokenProcessPool as error:
            raise RansError(
                f"a process that {self._work} died; the usual cause is too little memory."
            ) from error


_state: list[Any] = []
"""State of `Workers` in this worker process."""


def _make_state(make: Callable[..., object], arguments: tuple[Any, ...]) -> None:
    use_one_thread()
    _state[:] = [make(*arguments)]


def _with_state(function: Callable[..., Answer], *job: Any) -> Answer:
    return function(_state[0], *job)


def nothing() -> None:
    """Create the state None, for `Workers` whose jobs need no state."""


@contextlib.contextmanager
def _pickled(prepare: Callable[..., object], arguments: tuple[Any, ...]) -> Iterator[Path]:
    """Context with a file that holds a pickled call.

    Large arguments in a pipe would block this process until the new one has read them. The pickle of
    multiprocessing would share torch tensors by files that stay open.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "prepare"
        file.write_bytes(cloudpickle.dumps((prepare, arguments)))
        yield file


def _unpickled(file: Path) -> None:
    _answered(file.read_bytes())


def _answered(job: bytes) -> Any:
    function, arguments = cloudpickle.loads(job)
    return function(*arguments)


@contextlib.contextmanager
def _started_safely() -> Iterator[None]:
    """Context in which new Python processes do not search the current folder for modules first.

    Otherwise an untrusted ``random.py`` beside an agent would run in a new process and in the resource tracker of
    multiprocessing.
    """
    before = os.environ.get(_SAFE_PATH)
    os.environ[_SAFE_PATH] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[_SAFE_PATH]
        else:
            os.environ[_SAFE_PATH] = before


@contextlib.contextmanager
def _script_left_alone() -> Iterator[None]:
    """Context in which new processes do not import the main script, as Python does by default.

    A script without ``if __name__ == "__main__"`` would otherwise repeat its work in every process.
    """
    main = vars(sys.modules["__main__"])
    hidden = {name: main.pop(name) for name in ("__file__", "__spec__") if name in main}
    main["__spec__"] = None
    try:
        yield
    finally:
        main.update(hidden)


def _begin(prepare: Callable[..., object], arguments: tuple[Any, ...]) -> None:
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # Ctrl-C reaches all processes; the parent handles it
    threading.Thread(target=_end_with_parent, daemon=True).start()
    prepare(*arguments)


def _end_with_parent() -> None:
    """End this process when its parent ends, even if the parent was killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextlib.contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Context in which new processes inherit that Ctrl-C is blocked; without effect on Windows."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # its start would unblock the signal
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


@contextlib.contextmanager
def _interrupts_deferred() -> Iterator[None]:
    """Context in which new processes ignore Ctrl-C from their start; this process handles it after the block.

    Ctrl-C in this time is not lost: it is raised again at the end.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []
    handler = signal.signal(
        signal.SIGINT, lambda number, _: received.append(number)
    )  # any thread may receive it
    try:
        with _interrupts_blocked():
            yield
    finally:
        signal.signal(signal.SIGINT, handler)
        if received:
            signal.raise_signal(signal.SIGINT)
