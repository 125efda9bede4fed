"""Worker processes that start fresh, keep quiet when interrupted and never outlive their parent."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any, Generic, TypeVar

import cloudpickle

from rans.errors import RansError

Answer = TypeVar("Answer")
State = TypeVar("State")

_SAFE_PATH = "PYTHONSAFEPATH"
"""In the environment of a Python process: it does not put the current folder before its library."""


def processors() -> int:
    """How many this process may use: a job of a cluster may have fewer than its machine."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextlib.contextmanager
def submitted(
    function: Callable[..., Answer],
    jobs: Iterable[tuple[Any, ...]],
    workers: int | None,
    prepare: Callable[..., object],
    arguments: tuple[Any, ...],
) -> Iterator[list[Future[Answer]]]:
    """Jobs at work in other processes, as futures in their order.

    The processes are started afresh, not forked: the parent may hold threads (torch, Drake) that a fork
    would copy half alive. With the default start method of a script that means its top level must be
    guarded by ``if __name__ == "__main__"``. An interrupt, or whatever else ends the block early, ends the
    processes at once, and the jobs that they are at are lost.

    Every process, by default one per processor, calls ``prepare(*arguments)`` before its first job. This and
    the function, called with one tuple a job, are of a module's top level.
    """
    others = set(multiprocessing.active_children())
    with contextlib.ExitStack() as kept:
        file = kept.enter_context(_pickled(prepare, arguments))
        with _started_safely():  # its locks start a process already
            pool = kept.enter_context(
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
            # Else the pool's thread waits for the rest of an answer that somebody was at, for ever.
            vars(pool)["_result_queue"]._writer.close()
            pool.shutdown(cancel_futures=True)
            raise


class Workers(Generic[State]):
    """Processes that make a state each, once, and answer jobs with it.

    They start afresh and end early as those of `submitted` do, and use one thread of torch each.

    Args:
        make: makes the state, such as a controller and what it flies; of a module's top level.
        arguments: those of ``make``; they can be pickled.
        count: number of processes, None: one per processor; with 1, jobs are done in this process.
        work: what the processes do, in the past tense, for the error when one dies: "flew episodes".
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
        self._count = count or processors()
        self._work = work

    def ordered(
        self, function: Callable[..., Answer], jobs: Sequence[tuple[Any, ...]]
    ) -> Generator[Answer]:
        """Answers in the order of the jobs, each as soon as it and those before it are known.

        Args:
            function: called with the state and one tuple a job; of a module's top level.
            jobs: what is to be done.

        Raises:
            RansError: a process died.
        """
        if self._count == 1:
            yield from self._here(function, jobs)
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
        """Number and answer of every job, in the order in which they end.

        Args:
            function: called with the state and one tuple a job; of a module's top level.
            jobs: what is to be done.
            dead: called with one tuple a job for the answer where a process died; None: an error.

        Raises:
            RansError: a process died, and there is no answer for that.
        """
        if self._count == 1:
            yield from enumerate(self._here(function, jobs))
            return
        with self._submitted(function, jobs) as futures:
            numbers = {future: k for k, future in enumerate(futures)}
            for future in as_completed(futures):
                number = numbers[future]
                if dead is not None and isinstance(future.exception(), BrokenProcessPool):
                    yield number, dead(*jobs[number])
                else:
                    yield number, self._answer(future)

    def _here(
        self, function: Callable[..., Answer], jobs: Iterable[tuple[Any, ...]]
    ) -> Iterator[Answer]:
        state = self._make(*self._arguments)
        for job in jobs:
            yield function(state, *job)

    def _submitted(
        self, function: Callable[..., Answer], jobs: Sequence[tuple[Any, ...]]
    ) -> contextlib.AbstractContextManager[list[Future[Answer]]]:
        return submitted(
            _with_state,
            [(function, *job) for job in jobs],
            max(1, min(self._count, len(jobs))),
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
"""What `Workers` made in this worker process."""


def _make_state(make: Callable[..., object], arguments: tuple[Any, ...]) -> None:
    _use_one_thread()
    _state[:] = [make(*arguments)]
    _use_one_thread()  # if only this imported torch


def _use_one_thread() -> None:
    """There is one process per processor; where nobody imported torch, it need not be."""
    if torch := sys.modules.get("torch"):
        torch.set_num_threads(1)


def _with_state(function: Callable[..., Answer], *job: Any) -> Answer:
    return function(_state[0], *job)


def nothing() -> None:
    """State of `Workers` whose jobs need none."""


@contextlib.contextmanager
def _pickled(prepare: Callable[..., object], arguments: tuple[Any, ...]) -> Iterator[Path]:
    """In a file: what is large would keep this process waiting until the one that starts has read it.

    And as a plain pickle: that of multiprocessing shares torch's tensors by files that stay open.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "prepare"
        file.write_bytes(cloudpickle.dumps((prepare, arguments)))
        yield file


def _unpickled(file: Path) -> None:
    _answered(file.read_bytes())


def _answered(asked: bytes) -> Any:
    function, arguments = cloudpickle.loads(asked)
    return function(*arguments)


@contextlib.contextmanager
def _started_safely() -> Iterator[None]:
    """A Python process started now does not look for modules in the current folder first.

    It would by itself, before this one tells it where to look: a stranger's ``random.py`` beside an agent
    would run in it, and in the process that multiprocessing starts to keep account of what is shared.
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
    """A process started now does not import what runs as ``__main__``, as Python has it by default.

    A script that is not guarded by ``if __name__ == "__main__"`` would do all its work again in each.
    """
    main = vars(sys.modules["__main__"])
    kept = {name: main.pop(name) for name in ("__file__", "__spec__") if name in main}
    main["__spec__"] = None
    try:
        yield
    finally:
        main.update(kept)


@contextlib.contextmanager
def beside(function: Callable[..., object], *arguments: Any) -> Iterator[None]:
    """Another process that does something until this block ends; whatever becomes of it, the block goes on.

    It starts afresh, as those of `submitted` do, ignores Ctrl-C, and ends with this process even when that
    is killed. The function is of a module's top level.
    """
    process = multiprocessing.get_context("spawn").Process(
        target=_begin, args=(function, arguments), daemon=True
    )
    with _started_safely(), _interrupts_deferred(), _script_left_alone():
        process.start()
    try:
        yield
    finally:
        process.kill()
        process.join()


def _begin(prepare: Callable[..., object], arguments: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the parent decides
    threading.Thread(target=_end_with_parent, daemon=True).start()
    prepare(*arguments)


def _end_with_parent() -> None:
    """A parent that was killed leaves no workers behind."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextlib.contextmanager
def _interrupts_deferred() -> Iterator[None]:
    """A process started now hears no Ctrl-C from its first moment; this one hears it when the block ends."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    resource_tracker.ensure_running()  # whose start would unblock the signal
    heard: list[int] = []
    handler = signal.signal(
        signal.SIGINT, lambda number, _: heard.append(number)
    )  # any thread may get it
    blocked = signal.pthread_sigmask(
        signal.SIG_BLOCK, {signal.SIGINT}
    )  # which new processes inherit
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        signal.signal(signal.SIGINT, handler)
        if heard:
            signal.raise_signal(signal.SIGINT)
