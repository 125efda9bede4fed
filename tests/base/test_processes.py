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
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from rans import RansError
from rans.base.processes import Processes, Workers, nothing
from tests.support.processes import wait_until


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


@pytest.mark.slow
def test_torch_has_one_thread_also_where_a_job_imports_it(monkeypatch):
    """Two threads of a small network cost 5 s of processor time beside a first training, which waited for them."""
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    assert list(Workers(nothing, count=2).ordered(threads_of, [(), ()])) == ["1", "1"]
    assert os.environ["OMP_NUM_THREADS"] == "3"


def test_a_script_needs_no_guard_and_its_own_classes_travel(tmp_path):
    """By Python's default each worker runs it from the top again, and starts workers, or prints once more."""
    script = tmp_path / "script.py"
    script.write_text("""
from dataclasses import dataclass
from rans.base.processes import Workers

@dataclass
class Pair:
    first: int
    second: int

def added(state, pair):
    return pair.first + pair.second + base[0]

base = [100]
print("once")
print([*Workers(dict, (), 2).ordered(added, [(Pair(1, 2),), (Pair(3, 4),)])])
""")
    ended = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    assert (ended.stdout, ended.stderr) == ("once\n[103, 107]\n", "")


def test_an_interrupt_ends_the_jobs_at_work(tmp_path):
    """None of which would end by itself, nor would the processes."""
    with pytest.raises(KeyboardInterrupt), Processes(1) as pool:  # noqa: PT012
        for number in range(12):
            pool.submit(waits, tmp_path, number)
        wait_until((tmp_path / "begun 0").exists)
        raise KeyboardInterrupt
    assert not multiprocessing.active_children()
    assert 1 <= len(list(tmp_path.glob("begun *"))) <= 3


def test_an_interrupt_in_the_middle_of_an_answer(tmp_path):
    """Whoever reads it must not wait for its other half; if that fails, this test never ends."""
    with pytest.raises(KeyboardInterrupt), Processes(1) as pool:  # noqa: PT012
        pool.submit(half_answers, tmp_path)
        wait_until((tmp_path / "half").exists)
        raise KeyboardInterrupt
    assert not multiprocessing.active_children()


@pytest.mark.parametrize("other_thread", [False, True])
def test_an_interrupt_while_a_process_starts_is_heard_when_it_has(other_thread, monkeypatch):
    """Neither lost nor in between, whichever thread the system tells."""
    now = threading.Event()
    teller = threading.Thread(target=lambda: now.wait() and signal.raise_signal(signal.SIGINT))
    teller.start()  # before the signal is blocked, which threads inherit
    started = []

    def start(pool, *job):
        now.set() if other_thread else signal.raise_signal(signal.SIGINT)
        teller.join() if other_thread else None
        started.append(job)

    monkeypatch.setattr(ProcessPoolExecutor, "submit", start)
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)  # pytest may run without one
    try:
        with pytest.raises(KeyboardInterrupt), Processes(1) as pool:
            pool.submit(abs, -1)
    finally:
        now.set()
        with contextlib.suppress(KeyboardInterrupt):
            teller.join()
        signal.signal(signal.SIGINT, handler)
    assert started == [(abs, -1)]


WORKS = """
import sys
from pathlib import Path
from rans.base.processes import Processes
from tests.base.test_processes import beats
with Processes(1) as pool:
    pool.submit(beats, Path(sys.argv[1])).result()
"""


def test_a_worker_in_its_job_ends_with_a_parent_that_is_killed(tmp_path):
    """No signal can be caught then: without its guard the worker would beat for ever."""
    env = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    with subprocess.Popen([sys.executable, "-c", WORKS, tmp_path], env=env) as parent:
        wait_until((tmp_path / "beat").exists)
        parent.kill()

    def is_still():
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
def test_workers_make_their_state_once_and_answer_every_job():
    workers = Workers(counted_from, (10,), 2)
    jobs = [(k,) for k in range(6)]
    answers = [*workers.ordered(counts, jobs)]
    assert [number for _, number in answers] == list(range(6))
    # Each process counts on from 10: six answers of one, or more of some and fewer of others.
    assert sorted(value for value, _ in answers)[0] == 11
    assert max(value for value, _ in answers) <= 16
    ended = dict(workers.finished(counts, jobs))
    assert {k: number for k, (_, number) in ended.items()} == {k: k for k in range(6)}


def test_one_worker_is_this_process():
    [(number, pid)] = Workers(counted_from, (0,), 1).finished(lambda *_: os.getpid(), [(5,)])
    assert (number, pid) == (0, os.getpid())


@pytest.mark.slow
def test_a_worker_that_dies_is_an_error_or_an_answer():
    workers = Workers(counted_from, (0,), 2, "counted")
    with pytest.raises(RansError, match="a worker that counted was lost: BrokenProcessPool"):
        list(workers.ordered(dies, [(0,), (1,)]))
    found = dict(workers.finished(dies, [(1,), (1,)], lambda number: -number))
    assert found == {0: -1, 1: -1}
