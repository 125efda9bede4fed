"""Work of many jobs on any `concurrent.futures.Executor`: of MPI, of Dask, or the user's own.

Jobs and answers are pickled by cloudpickle, so that what a worker gets may not hold files or sockets.
"""

from __future__ import annotations

import os
import queue
import socket
import sys
import threading
import traceback
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from typing import Any, TypeVar

import cloudpickle

from rans.base.errors import ConfigError, RansError, brief, checked
from rans.base.files import first_line, package_version
from rans.base.registry import resolve_typed

Answer = TypeVar("Answer")

FORMS = "MODULE:NAME of a function or a class that makes an executor (docs/cluster.md)"
"""Text that `run_on` and ``--executor`` accept, for messages and help."""

_ATTEMPTS = 4
"""Times that a job is submitted: a worker may be lost three times, as often as Dask allows by default."""

_chosen: ContextVar[Executor | None] = ContextVar("executor", default=None)
_sent: list[int] = []
"""Numbers of jobs that executors have been asked for in this process."""


def jobs_sent() -> int:
    """Number of jobs that executors have been asked for in this process."""
    return sum(_sent)


def without_executor(arguments: Sequence[str]) -> tuple[list[str], str | None]:
    """Words of a command line without ``--executor TEXT``, and its text; None without the option.

    Raises:
        ConfigError: the text is missing.
    """
    rest: list[str] = []
    text = None
    words = iter(arguments)
    for word in words:
        option, equals, value = word.partition("=")
        if option != "--executor":
            rest.append(word)
            continue
        text = value if equals else next(words, "")
        if not text:
            raise ConfigError(f"--executor must be {FORMS}; nothing follows it.")
    return rest, text


@contextmanager
def run_on(executor: Executor | str) -> Iterator[Executor]:
    """Context in which flights, bounds, trajectories and proofs run on an executor.

    Without it they run in processes of this machine, with the same results. A job whose worker is lost is
    submitted again.

    >>> from concurrent.futures import ThreadPoolExecutor
    >>> with ThreadPoolExecutor(2) as pool, rans.run_on(pool):
    ...     rans.evaluate("go-to-pose-2d", episodes=8)["solved"].value
    100.0

    Args:
        executor: a `concurrent.futures.Executor`, which the caller closes, or the text ``MODULE:NAME`` of a
            function or a class without arguments that makes one, such as ``mpi4py.futures:MPIPoolExecutor``, which
            is closed at the end.

    Raises:
        ConfigError: the text has no such form, or what it names makes no executor.
    """
    opened: AbstractContextManager[Executor] = (
        _opened(executor)
        if isinstance(executor, str)
        else nullcontext(checked("executor", executor, Executor))
    )
    with opened as chosen:
        token = _chosen.set(chosen)
        try:
            yield chosen
        finally:
            _chosen.reset(token)


def chosen_executor() -> Executor | None:
    """The executor of the innermost `run_on`; None: processes of this machine."""
    return _chosen.get()


def answers(
    executor: Executor,
    make: Callable[..., Any],
    arguments: tuple[Any, ...],
    function: Callable[..., Answer],
    jobs: Sequence[tuple[Any, ...]],
    dead: Callable[..., Answer] | None = None,
    work: str = "worked",
) -> Generator[tuple[int, Answer]]:
    """Yield number and answer of every job, in the order in which they end.

    Whatever a job raises is raised here. Any other failure of its future means that the worker was lost, and the
    job is submitted again. An early end of the loop cancels the jobs that have not begun.

    Args:
        executor: where the jobs run.
        make: creates the state of a worker, once for consecutive jobs with the same state.
        arguments: arguments of ``make``.
        function: called with the state and the arguments of a job.
        jobs: arguments of each job.
        dead: called with the arguments of a job that was lost too often, for its answer; None: raise an error.
        work: description of the work in the past tense for the error.

    Raises:
        RansError: a job was lost too often, or the executor takes no more jobs.
    """
    _sent.append(len(jobs))
    state = cloudpickle.dumps((make, arguments))
    version = package_version("rans")
    # Futures report here, in the order in which they end.
    ended: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
    numbers: dict[Future[Any], int] = {}
    attempts = [0] * len(jobs)

    def submit(number: int) -> None:
        """Submit the job with this number, once more if its worker was lost.

        It changes ``numbers`` and ``attempts``; pickling happens here, once for each attempt.
        """
        content = cloudpickle.dumps((function, jobs[number]))
        try:
            future = executor.submit(_job, version, state, content)
        except (
            RuntimeError
        ) as error:  # BrokenExecutor is one, and so is that of an executor that was shut down
            raise RansError(
                f"the executor takes no more jobs: {first_line(error)}; the usual cause is too little memory on "
                f"a worker that {work}."
            ) from error
        numbers[future] = number
        attempts[number] += 1
        future.add_done_callback(ended.put)

    try:
        # All jobs at once, then one answer after the other.
        for number in range(len(jobs)):
            submit(number)
        while numbers:
            future = ended.get()
            number = numbers.pop(future)
            error = _failure(future)
            if error is None:
                result = future.result()
                if not isinstance(result, tuple) or len(result) != 2:
                    raise RansError(
                        f"the executor answers {brief(result)} in place of what the job returned: its futures must "
                        "hold the result of the function that is submitted."
                    )
                answer, raised = result
                if raised is not None:
                    raise raised
                yield number, answer
            elif attempts[number] < _ATTEMPTS and not isinstance(error, BrokenExecutor):
                submit(number)
            elif dead is not None:
                yield number, dead(*jobs[number])
            else:
                times = f" {attempts[number]} times with the same job" * (attempts[number] > 1)
                raise RansError(
                    f"a worker that {work} was lost{times}: {type(error).__name__}: {first_line(error)}; usual "
                    "causes are too little memory, a time limit, and workers without the packages of this machine."
                ) from error
    finally:
        for future in numbers:
            future.cancel()


def _failure(future: Future[Any]) -> BaseException | None:
    """Why an ended future has no answer; a cancelled one raises its error instead of returning it."""
    try:
        return future.exception()
    except Exception as error:
        return error


class _Latest(threading.local):
    """The last state of this thread of a worker: threads share nothing that a job may change."""

    content = b""
    value: Any = None


_latest = _Latest()


def _job(version: str, state: bytes, content: bytes) -> tuple[Any, Exception | None]:
    """Answer of a job on a worker, and what it raised.

    Args:
        version: version of RANS of the machine that asks.
        state: pickle of a function and its arguments, which make the state.
        content: pickle of the function of the job, and of its arguments after the state.
    """
    torch = sys.modules.get("torch")
    threads = torch.get_num_threads() if torch else 0
    variable = os.environ.get(_THREADS)
    try:
        use_one_thread()
        own = package_version("rans")
        if own != version:
            raise RansError(
                f"the worker {socket.gethostname()} has RANS {own or 'from a folder'}, and this machine has "
                f"{version or 'one from a folder'}; install the same."
            )
        if state != _latest.content:
            _latest.content = b""
            make, arguments = _unpickled(state)
            _latest.value = make(*arguments)
            _latest.content = state
        function, arguments = _unpickled(content)
        return function(_latest.value, *arguments), None
    except Exception as error:
        error.add_note(f"on the worker {socket.gethostname()}:\n{traceback.format_exc()}")
        return None, error
    finally:  # an executor may run jobs in the process of the user
        if torch:
            torch.set_num_threads(threads)
        if variable is None:
            os.environ.pop(_THREADS, None)
        else:
            os.environ[_THREADS] = variable


def _unpickled(content: bytes) -> Any:
    """An object that came from another machine; a module that is missing here ends in a sentence."""
    try:
        return cloudpickle.loads(content)
    except ModuleNotFoundError as error:
        raise RansError(
            f"the worker {socket.gethostname()} cannot import {error.name}: install it there, or start the worker "
            "in the folder that has it."
        ) from error


_THREADS = "OMP_NUM_THREADS"
"""Environment variable that torch reads once, when it is imported."""


def use_one_thread() -> None:
    """Limit torch to one thread, also where it is imported later, as there is a process for every processor."""
    os.environ[_THREADS] = "1"
    if torch := sys.modules.get("torch"):
        torch.set_num_threads(1)


def _opened(text: str) -> Executor:
    """The executor of a text; see `run_on`."""
    try:
        executor = resolve_typed(text)()
    except ConfigError as error:
        raise ConfigError(f"--executor must be {FORMS}; got {brief(text)}: {error}") from error
    if not isinstance(executor, Executor):
        raise ConfigError(
            f"--executor {text} must return a concurrent.futures.Executor, got {brief(executor)}."
        )
    return executor
