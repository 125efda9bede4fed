"""Work of many jobs on any `concurrent.futures.Executor`: Dask, submitit, MPI, or the user's own.

Jobs and answers are pickled by cloudpickle, so that what a worker gets may not hold files or sockets.
"""

from __future__ import annotations

import importlib
import os
import queue
import socket
import sys
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Executor, Future
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from pathlib import Path
from typing import Any, TypeVar

import cloudpickle

from rans.errors import ConfigError, RansError, brief, checked
from rans.files import first_line, package_version, read_text
from rans.registry import resolve_typed
from rans.structure import read_toml

Answer = TypeVar("Answer")

FORMS = "dask:ADDRESS, submitit:FILE, mpi, or MODULE:NAME of a function that makes an executor"
"""Texts that `run_on` and ``--executor`` accept, for messages and help."""

_ATTEMPTS = 4
"""Times that a job is submitted: a worker may be lost three times, as often as Dask allows by default."""
_PERIOD = 0.5
"""Time between two questions to submitit whether jobs have ended, s; SLURM itself is asked more seldom."""

_chosen: ContextVar[Executor | None] = ContextVar("executor", default=None)
_sent: list[int] = []
"""Numbers of jobs that executors have been asked for in this process."""


def jobs_sent() -> int:
    """Number of jobs that executors have been asked for in this process."""
    return sum(_sent)


def without_option(arguments: Sequence[str], name: str, forms: str) -> tuple[list[str], str | None]:
    """Arguments of a command line without an option and its text; the text is None without the option.

    Args:
        arguments: words of the command line.
        name: option, such as ``--executor``.
        forms: texts that it accepts, in words, for the message.

    Raises:
        ConfigError: the text is missing.
    """
    rest: list[str] = []
    text = None
    words = iter(arguments)
    for word in words:
        option, equals, value = word.partition("=")
        if option != name:
            rest.append(word)
            continue
        text = value if equals else next(words, "")
        if not text:
            raise ConfigError(f"{name} must be {forms}; nothing follows it.")
    return rest, text


def without_executor(arguments: Sequence[str]) -> tuple[list[str], str | None]:
    """Arguments of a command line without ``--executor TEXT``, and its text; see `without_option`."""
    return without_option(arguments, "--executor", FORMS)


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
        executor: a `concurrent.futures.Executor`, which the caller closes, or a text: ``dask:ADDRESS`` of a
            scheduler (or the path of its JSON file), ``submitit:FILE`` with a TOML file, ``mpi``, or
            ``MODULE:NAME`` of a function without arguments that returns an executor; an executor of a text is
            closed at the end.

    Raises:
        ConfigError: the text has no such form, or its executor cannot be made; a missing package is named with the
            command that installs it.
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
            elif attempts[number] < _ATTEMPTS:
                submit(number)
            elif dead is not None:
                yield number, dead(*jobs[number])
            else:
                raise RansError(
                    f"a worker that {work} was lost {_ATTEMPTS} times with the same job: {type(error).__name__}: "
                    f"{first_line(error)}; usual causes are too little memory, a time limit, and workers without "
                    "the packages of this machine."
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


def _opened(text: str) -> AbstractContextManager[Executor]:
    """The executor of a text, as a context that shuts it down; see `run_on`."""
    kind, _, rest = text.partition(":")
    if text == "mpi":
        return _package("mpi4py.futures", "mpi4py").MPIPoolExecutor()
    if kind == "dask" and rest:
        return _dask(rest)
    if kind == "submitit" and rest:
        return _Submitit(Path(rest))
    if not (kind and rest):
        raise ConfigError(f"--executor must be {FORMS}; got {brief(text)}.")
    executor = resolve_typed(text)()
    if not isinstance(executor, Executor):
        raise ConfigError(
            f"--executor {text} must return a concurrent.futures.Executor, got {brief(executor)}."
        )
    return executor


def _package(module: str, package: str) -> Any:
    """A module of a package that RANS does not install, or a `ConfigError` that says how to get it."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"this executor needs the package {package}, which is not installed: pip install {package}"
        ) from error
    except (ImportError, RuntimeError) as error:  # mpi4py finds no library of MPI
        raise ConfigError(
            f"the package {package} cannot be imported: {first_line(error)}."
        ) from error


@contextmanager
def _dask(address: str) -> Iterator[Executor]:
    """Context with the executor of a Dask scheduler at an address, or described by a file that it has written."""
    distributed = _package("distributed", "distributed")
    where = {"scheduler_file": address} if address.endswith(".json") else {"address": address}
    try:
        client = distributed.Client(**where, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"no Dask scheduler answers at {address}: {first_line(error)}; start one by `dask scheduler`."
        ) from error
    with client:
        yield _Dask(client)


class _Dask(Executor):
    """Executor of a Dask client that sends the state of jobs once to each worker instead of once with each job.

    Args:
        client: client of the scheduler.
    """

    def __init__(self, client: Any) -> None:
        self._client = client
        self._pool = client.get_executor()
        self._states: dict[bytes, Any] = {}

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Future[Any]:  # type: ignore[override]
        """Submit a call; see `_job` for its arguments."""
        version, state, content = arguments
        # A result of a task, unlike scattered data, is computed again if its worker is lost.
        if state not in self._states:
            self._states = {state: self._client.submit(bytes, state)}
        return self._pool.submit(function, version, self._states[state], content)


class _Submitit(Executor):
    """Executor of submitit: jobs of SLURM, or processes of this machine with ``cluster = "local"``.

    What is submitted within a moment is one job array.

    Args:
        file: TOML file with ``folder``, which all machines see, optionally ``cluster``, and parameters of
            ``submitit.AutoExecutor.update_parameters``, such as ``timeout_min`` and ``slurm_partition``.
    """

    def __init__(self, file: Path) -> None:
        submitit = _package("submitit", "submitit")
        parameters = read_toml(read_text(file))
        try:
            folder = parameters.pop("folder", "runs/submitit")
            self._jobs = submitit.AutoExecutor(folder, cluster=parameters.pop("cluster", None))
            self._jobs.update_parameters(**parameters)
        except Exception as error:
            raise ConfigError(f"submitit refuses {file}: {first_line(error)}.") from error
        self._new: queue.SimpleQueue[tuple[Future[Any], tuple[Any, ...]]] = queue.SimpleQueue()
        self._begun: dict[Any, Future[Any]] = {}
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Future[Any]:  # type: ignore[override]
        """Submit a call."""
        future: Future[Any] = Future()
        self._new.put((future, (function, *arguments)))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Cancel all jobs that have not ended: none is awaited any more."""
        self._closed.set()
        self._thread.join()
        for job in self._begun:
            job.cancel()

    def _watch(self) -> None:
        """Submit new calls as arrays, and hand over the results of jobs that have ended.

        It runs in a thread of its own, alone with ``_begun``.
        """
        while not self._closed.is_set():
            new = [self._new.get() for _ in range(self._new.qsize())]
            # A future that was cancelled before it began is left out.
            new = [(future, call) for future, call in new if future.set_running_or_notify_cancel()]
            if new:
                self._begin(new)
            for job in [job for job in self._begun if job.done()]:
                future = self._begun.pop(job)
                try:
                    future.set_result(job.result())
                except Exception as error:
                    future.set_exception(error)
            time.sleep(_PERIOD)

    def _begin(self, new: Sequence[tuple[Future[Any], tuple[Any, ...]]]) -> None:
        """Submit calls as one array of jobs; if that fails, each future has the exception."""
        try:
            with self._jobs.batch():
                jobs = [self._jobs.submit(*call) for _, call in new]
        except Exception as error:  # sbatch fails in many ways
            for future, _ in new:
                future.set_exception(error)
        else:
            self._begun.update(zip(jobs, (future for future, _ in new), strict=True))
