"""Worker processes that start fresh, keep quiet when interrupted and never outlive their parent."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from typing import Any, TypeVar

Answer = TypeVar("Answer")


@contextlib.contextmanager
def submitted(function: Callable[..., Answer], jobs: Iterable[tuple[Any, ...]], workers: int | None,
              prepare: Callable[..., object], arguments: tuple[Any, ...]) -> Iterator[list[Future[Answer]]]:
    """Jobs at work in other processes, as futures in their order.

    The processes are started afresh, not forked: the parent may hold threads (torch, Drake) that a fork
    would copy half alive. With the default start method of a script that means its top level must be
    guarded by ``if __name__ == "__main__"``. An interrupt waits for the jobs in work, drops the rest and
    is raised again.

    Every process, by default one per processor, calls ``prepare(*arguments)`` before its first job. This and
    the function, called with one tuple a job, are of a module's top level.
    """
    with ProcessPoolExecutor(workers or os.cpu_count() or 1, multiprocessing.get_context("spawn"),
                             _begin, (prepare, arguments)) as pool:
        try:
            with _interrupts_ignored():  # by the workers that start now, for as long as they live
                futures = [pool.submit(function, *job) for job in jobs]
            yield futures
        except BaseException:
            pool.shutdown(cancel_futures=True)  # waits for the few in work
            raise


@contextlib.contextmanager
def beside(function: Callable[..., object], *arguments: Any) -> Iterator[None]:
    """Another process that does something until this block ends; whatever becomes of it, the block goes on.

    It starts afresh, as those of `submitted` do, ignores Ctrl-C, and ends with this process even when that
    is killed. The function is of a module's top level.
    """
    process = multiprocessing.get_context("spawn").Process(
        target=_begin, args=(function, arguments), daemon=True)
    with _interrupts_ignored():
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
