"""Jobs in other processes: their order, and what becomes of them when their parent changes its mind."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from rans.errors import RansError
from rans.executors import use_one_thread
from rans.processes import Workers, nothing, submitted
from tests.support.processes import wait_until

_made: list[str] = []


def made_ready(word: str) -> None:
    _made.append(word)


def said(number: int) -> tuple[int, list[str], int]:
    """What a worker knows: its job, what it was prepared with, and who it is."""
    return number, list(_made), os.getpid()


def waits(folder: Path, number: int) -> None:
    """Say that the job is at work, and end it when it may go on."""
    (folder / f"begun {number}").touch()
    wait_until((folder / "go on").exists)


def threads_of(_: None) -> str | None:
    """What torch reads when it is imported."""
    return os.environ.get("OMP_NUM_THREADS")


def half_answers(folder: Path) -> bytes:
    """An answer of which another process gets the length only."""

    def send(self: Connection, content: bytes) -> None:
        os.write(self.fileno(), content)
        (folder / "half").touch()
        threading.Event().wait()

    Connection._send = send  # type: ignore[attr-defined]  # here, in a process of its own
    return bytes(2**20)


def beats(folder: Path) -> None:
    while True:
        (folder / "beat").write_text(str(time.time_ns()))
        time.sleep(0.01)


def test_answers_come_in_the_order_of_the_jobs() -> None:
    """Every worker is prepared once, before its first job, and is another process."""
    with submitted(said, [(k,) for k in range(4)], 1, made_ready, ("once",)) as futures:
        answers = [future.result() for future in futures]
    assert [number for number, *_ in answers] == [0, 1, 2, 3]
    assert {tuple(words) for _, words, _ in answers} == {("once",)}
    assert os.getpid() not in {process for *_, process in answers}
    assert len({process for *_, process in answers}) == 1


@pytest.mark.slow
def test_torch_has_one_thread_also_where_a_job_imports_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two threads of a small network cost 5 s of processor time beside a first training, which waited for them."""
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    with submitted(threads_of, [(None,)], 1, use_one_thread, ()) as (threads,):
        assert threads.result() == "1"
    assert list(Workers(nothing, count=2).ordered(threads_of, [(), ()])) == ["1", "1"]
    assert os.environ["OMP_NUM_THREADS"] == "3"


def test_a_script_needs_no_guard_and_its_own_classes_travel(tmp_path: Path) -> None:
    """By Python's default each worker runs it from the top again, and starts workers, or prints once more."""
    script = tmp_path / "script.py"
    script.write_text("""
from dataclasses import dataclass
from rans.processes import submitted

@dataclass
class Pair:
    first: int
    second: int

def added(pair):
    return pair.first + pair.second + base[0]

base = [100]
print("once")
with submitted(added, [(Pair(1, 2),), (Pair(3, 4),)], 2, dict, ()) as futures:
    print([future.result() for future in futures])
""")
    ended = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    assert (ended.stdout, ended.stderr) == ("once\n[103, 107]\n", "")


def test_an_interrupt_ends_the_jobs_at_work(tmp_path: Path) -> None:
    """None of which would end by itself, nor would the processes."""
    with (  # noqa: PT012
        pytest.raises(KeyboardInterrupt),
        submitted(waits, [(tmp_path, k) for k in range(12)], 1, made_ready, ("",)),
    ):
        wait_until((tmp_path / "begun 0").exists)
        raise KeyboardInterrupt
    assert not multiprocessing.active_children()
    assert 1 <= len(list(tmp_path.glob("begun *"))) <= 3


def test_an_interrupt_in_the_middle_of_an_answer(tmp_path: Path) -> None:
    """Whoever reads it must not wait for its other half; if that fails, this test never ends."""
    with (  # noqa: PT012
        pytest.raises(KeyboardInterrupt),
        submitted(half_answers, [(tmp_path,)], 1, made_ready, ("",)),
    ):
        wait_until((tmp_path / "half").exists)
        raise KeyboardInterrupt
    assert not multiprocessing.active_children()


@pytest.mark.parametrize("other_thread", [False, True])
def test_an_interrupt_while_processes_start_is_heard_when_they_have(other_thread: bool) -> None:
    """Neither lost nor in between, whichever thread the system tells."""
    now = threading.Event()
    asked = list[int]()
    teller = threading.Thread(target=lambda: now.wait() and signal.raise_signal(signal.SIGINT))
    teller.start()  # before the signal is blocked, which threads inherit

    def jobs() -> Iterator[tuple[int]]:
        for number in range(3):
            if number == 1:
                now.set() if other_thread else signal.raise_signal(signal.SIGINT)
                teller.join() if other_thread else None
            asked.append(number)
            yield (number,)

    handler = signal.signal(signal.SIGINT, signal.default_int_handler)  # pytest may run without one
    try:
        with pytest.raises(KeyboardInterrupt), submitted(said, jobs(), 1, made_ready, ("",)):
            raise AssertionError("the interrupt was lost")
    finally:
        now.set()
        with contextlib.suppress(KeyboardInterrupt):
            teller.join()
        signal.signal(signal.SIGINT, handler)
    assert asked == [0, 1, 2]


WORKS = """
import sys
from pathlib import Path
from rans.processes import submitted
from tests.test_processes import beats
with submitted(beats, [(Path(sys.argv[1]),)], 1, dict, ()) as futures:
    futures[0].result()
"""


def test_a_worker_in_its_job_ends_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    """No signal can be caught then: without its guard the worker would beat for ever."""
    env = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    with subprocess.Popen([sys.executable, "-c", WORKS, tmp_path], env=env) as parent:
        wait_until((tmp_path / "beat").exists)
        parent.kill()

    def is_still() -> bool:
        before = (tmp_path / "beat").stat().st_mtime_ns  # it may end in the middle of a beat
        time.sleep(0.3)  # thirty beats
        return (tmp_path / "beat").stat().st_mtime_ns == before

    wait_until(is_still)


def counted_from(start: int) -> list[int]:
    return [start]


def counts(state: list[int], number: int) -> tuple[int, int]:
    """The next number of this process, and the job's."""
    state[0] += 1
    return state[0], number


def dies(_: list[int], number: int) -> int:
    if number == 1:
        os._exit(9)
    time.sleep(0.2)
    return number


@pytest.mark.slow
def test_workers_make_their_state_once_and_answer_every_job() -> None:
    workers = Workers(counted_from, (10,), 2)
    jobs = [(k,) for k in range(6)]
    answers = [*workers.ordered(counts, jobs)]
    assert [number for _, number in answers] == list(range(6))
    # Each process counts on from 10: six answers of one, or more of some and fewer of others.
    assert sorted(value for value, _ in answers)[0] == 11
    assert max(value for value, _ in answers) <= 16
    ended = dict(workers.finished(counts, jobs))
    assert {k: number for k, (_, number) in ended.items()} == {k: k for k in range(6)}


def test_one_worker_is_this_process() -> None:
    [(number, pid)] = Workers(counted_from, (0,), 1).finished(lambda *_: os.getpid(), [(5,)])
    assert (number, pid) == (0, os.getpid())


@pytest.mark.slow
def test_a_worker_that_dies_is_an_error_or_an_answer() -> None:
    workers = Workers(counted_from, (0,), 2, "counted")
    with pytest.raises(RansError, match="a process that counted died"):
        list(workers.ordered(dies, [(0,), (1,)]))
    found = dict(workers.finished(dies, [(1,), (1,)], lambda number: -number))
    assert found == {0: -1, 1: -1}
