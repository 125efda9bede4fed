"""Worker processes that are spawned, ignore interrupts and end with their parent.

Whatever a job needs is pickled; flights of slow controllers, optima and trainings divide their work here.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import resource_tracker
from types import TracebackType
from typing import Any, Generic, TypeVar

from rans.base.executors import answers, chosen_executor

Answer = TypeVar("Answer")
State = TypeVar("State")

_SAFE_PATH = "PYTHONSAFEPATH"
"""Environment variable that keeps Python from searching the current folder before its library."""


def processors() -> int:
    """Number of processors that this process may use; a cluster job may have fewer than its machine."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Processes(ProcessPoolExecutor):
    """Executor of processes of this machine; as a context it ends them at once after an error or an interrupt.

    The processes are spawned instead of forked, because a fork does not copy the threads of torch and Drake.
    Unfinished jobs are lost where the context ends early.

    Args:
        count: number of processes.
    """

    def __init__(self, count: int) -> None:
        self._others = set(multiprocessing.active_children())
        with _started_safely():  # the locks of the pool start a process
            super().__init__(count, multiprocessing.get_context("spawn"), _begin)

    def submit(self, function: Callable[..., Any], /, *given: Any, **named: Any) -> Future[Any]:
        """See `concurrent.futures.Executor`; it may start a process, which an interrupt does not disturb."""
        with _started_safely(), _interrupts_deferred(), _script_left_alone():
            return super().submit(function, *given, **named)

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc_val: BaseException | None,
        exc_tb: TracebackType | None,
    ) -> None:
        if exc_type is not None:
            for process in set(multiprocessing.active_children()) - self._others:
                process.kill()
            # Otherwise the thread of the pool waits forever for the rest of an unfinished answer.
            vars(self)["_result_queue"]._writer.close()
            self.shutdown(cancel_futures=True)
        super().__exit__(exc_type, exc_val, exc_tb)


@dataclass(eq=False)
class Workers(Generic[State]):
    """Workers, each of which creates a state once and answers jobs with it.

    They are the executor of `rans.base.executors.run_on` within its context, and else `Processes` of this
    machine, which use one thread of torch each.
    """

    make: Callable[..., State]
    """Creates the state, such as a controller and its task."""
    arguments: tuple[Any, ...] = ()
    """Arguments of ``make``, which can be pickled."""
    count: int | None = None
    """Number of processes of this machine; None: one per processor; 1: jobs run in this process, whatever the
    executor."""
    work: str = "worked"
    """The work in the past tense for the error when a worker is lost, such as "flew episodes"."""

    def ordered(
        self, function: Callable[..., Answer], jobs: Sequence[tuple[Any, ...]]
    ) -> Generator[Answer]:
        """Yield answers in the order of the jobs, each as soon as it and those before it are known.

        Args:
            function: called with the state and the arguments of a job.
            jobs: arguments of each job.

        Raises:
            RansError: a worker was lost.
        """
        early: dict[int, Answer] = {}
        following = 0
        for number, answer in self.finished(function, jobs):
            early[number] = answer
            while following in early:
                yield early.pop(following)
                following += 1

    def finished(
        self,
        function: Callable[..., Answer],
        jobs: Sequence[tuple[Any, ...]],
        dead: Callable[..., Answer] | None = None,
    ) -> Generator[tuple[int, Answer]]:
        """Yield number and answer of every job, in the order in which they end.

        Args:
            function: called with the state and the arguments of a job.
            jobs: arguments of each job.
            dead: called with the arguments of a job whose worker was lost, for its answer; None: raise an error.

        Raises:
            RansError: a worker was lost, and ``dead`` is None.
        """
        executor = chosen_executor()
        if self.count == 1 or (self.count is None and processors() == 1 and executor is None):
            state = self.make(*self.arguments)
            for number, job in enumerate(jobs):
                yield number, function(state, *job)
            return
        with contextlib.ExitStack() as context:
            if executor is None:
                count = min(self.count or processors(), len(jobs))
                executor = context.enter_context(Processes(max(1, count)))
            yield from answers(executor, self.make, self.arguments, function, jobs, dead, self.work)


def nothing() -> None:
    """Create the state None, for `Workers` whose jobs need no state."""


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


def _begin() -> None:
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # Ctrl-C reaches all processes; the parent handles it
    threading.Thread(target=_end_with_parent, daemon=True).start()


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
