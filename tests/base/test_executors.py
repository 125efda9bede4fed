"""Jobs on executors: the same answers as on one machine, whatever executor, and when workers are lost."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import pytest

import rans
from rans import ConfigError, RansError, run_on
from rans.base.processes import Workers, nothing
from tests.support.processes import wait_until


class Silent(Executor):
    """Says of every call that it is done, and never makes it."""

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **_: Any) -> Future[Any]:
        """Answer None."""
        future = Future[Any]()
        future.set_result(None)
        return future


def test_an_executor_that_answers_something_else_is_named():
    with Silent() as pool, run_on(pool), pytest.raises(RansError, match=r"answers None in place"):
        rans.evaluate("lqr:go-to-pose-2d", episodes=65, engine="drake")


class Serial(Executor):
    """Runs a call at once, in this process; loses some calls as a worker does that is killed.

    Args:
        lost: number of the first submissions that are lost.
    """

    def __init__(self, lost: int = 0) -> None:
        self.lost = lost
        self.submitted = 0

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **_: Any) -> Future[Any]:
        """Answer, or lose the call."""
        self.submitted += 1
        future = Future[Any]()
        if self.submitted <= self.lost:
            future.set_exception(ConnectionError("the worker is gone"))
        else:
            future.set_result(function(*arguments))
        return future


def twice(state: list[int], number: int) -> tuple[int, int]:
    """Twice the number, and how often this state was used."""
    state[0] += 1
    return 2 * number, state[0]


def state() -> list[int]:
    return [0]


def refuses(_: None, number: int) -> int:
    raise ConfigError(f"job {number} is wrong.")


JOBS = [(k,) for k in range(5)]


def test_answers_are_in_order_and_the_state_is_made_once():
    with run_on(Serial()):
        answers = list(Workers(state, (), 2).ordered(twice, JOBS))
    assert answers == [(2 * k, k + 1) for k in range(5)]


@pytest.mark.parametrize("lost", [1, 3, 7])
def test_a_lost_job_is_submitted_again(lost):
    executor = Serial(lost)
    with run_on(executor):
        found = dict(Workers(state).finished(twice, JOBS))
    assert {k: double for k, (double, _) in found.items()} == {k: 2 * k for k in range(5)}
    assert executor.submitted == len(JOBS) + lost


def test_a_job_that_is_always_lost_is_a_sentence_or_an_answer():
    with run_on(Serial(100)) as executor:
        workers = Workers(state, (), None, "counted")
        with pytest.raises(
            RansError, match=r"that counted was lost 4 times .* ConnectionError: the worker is gone"
        ):
            list(workers.ordered(twice, JOBS[:1]))
        assert isinstance(executor, Serial)
        assert executor.submitted == 4
        assert dict(workers.finished(twice, JOBS, lambda k: (-k, 0))) == {
            k: (-k, 0) for k in range(5)
        }


def test_what_a_job_raises_is_raised_here_and_not_repeated():
    with run_on(Serial()) as executor, pytest.raises(ConfigError) as raised:
        list(Workers(nothing).ordered(refuses, [(0,)]))
    assert str(raised.value) == "job 0 is wrong."
    assert "in refuses" in raised.value.__notes__[0]  # where it was raised on the worker
    assert isinstance(executor, Serial)
    assert executor.submitted == 1


def waits(_: None, folder: Path, number: int) -> int:
    (folder / f"begun {number}").touch()
    if number:
        wait_until((folder / "go on").exists)
    return number


def test_an_early_end_cancels_what_has_not_begun(tmp_path):
    with ThreadPoolExecutor(1) as pool, run_on(pool):
        answers = Workers(nothing).finished(waits, [(tmp_path, k) for k in range(9)])
        assert next(answers) == (0, 0)
        answers.close()
        (tmp_path / "go on").touch()
    assert len(list(tmp_path.glob("begun *"))) <= 2


def test_a_broken_pool_is_a_sentence():
    class Broken(Serial):
        def submit(self, *_: Any, **__: Any) -> Future[Any]:
            raise BrokenProcessPool("a process died")

    with run_on(Broken()), pytest.raises(RansError, match=r"takes no more jobs: .*a process died"):
        list(Workers(nothing).ordered(refuses, JOBS))


def test_a_worker_of_another_version_is_a_sentence(monkeypatch):
    versions = iter(["0.2.0", "0.1.0"])
    monkeypatch.setattr("rans.base.executors.package_version", lambda _: next(versions))
    with run_on(Serial()), pytest.raises(RansError, match=r"has RANS 0\.1\.0, and this machine"):
        list(Workers(nothing).ordered(refuses, JOBS[:1]))


def killed_once(_: None, folder: Path, number: int) -> tuple[int, int]:
    """The first process that takes the second job is killed in it, as by a system without memory."""
    mark = folder / "killed"
    if number == 1 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number**2, os.getpid()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # Dask's own, of ports in use and of the killed worker
def test_a_killed_worker_of_dask_costs_no_job(tmp_path, monkeypatch):
    """One of two workers is killed; its jobs go to the other."""
    distributed = pytest.importorskip("distributed")
    monkeypatch.setenv("PYTHONHASHSEED", "0")  # which Dask sets for its workers
    with (
        distributed.LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            dashboard_address=None,
            silence_logs=50,
        ) as cluster,
        distributed.Client(cluster) as client,
        run_on(client.get_executor()),
    ):
        found = dict(Workers(nothing).finished(killed_once, [(tmp_path, k) for k in range(8)]))
    assert {k: square for k, (square, _) in found.items()} == {k: k**2 for k in range(8)}
    assert (tmp_path / "killed").exists()
    assert os.getpid() not in {process for _, process in found.values()}


def of_this_file() -> Executor:
    return Serial()
