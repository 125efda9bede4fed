"""Jobs in other processes: their order, and what becomes of them when their parent changes its mind."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import pytest

from rans.processes import beside, submitted
from tests.processes import wait_until

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


def test_a_changed_mind_drops_the_jobs_that_have_not_begun(tmp_path: Path) -> None:
    """One worker is at work and two jobs are on their way to it; the others never begin."""
    go_on = (tmp_path / "go on").touch
    otherwise = threading.Timer(30.0, go_on)  # if the last job is never dropped, all of them begin
    jobs = [(tmp_path, k) for k in range(12)]
    with pytest.raises(KeyError), submitted(waits, jobs, 1, made_ready, ("",)) as futures:  # noqa: PT012
        wait_until((tmp_path / "begun 0").exists)
        futures[-1].add_done_callback(lambda _: go_on())
        otherwise.start()
        raise KeyError
    otherwise.cancel()
    assert 1 <= len(list(tmp_path.glob("begun *"))) <= 3


def test_something_runs_beside_a_block_and_no_longer(tmp_path: Path) -> None:
    with beside(beats, tmp_path):
        wait_until((tmp_path / "beat").exists)
        first = (tmp_path / "beat").read_text()
        wait_until(lambda: (tmp_path / "beat").read_text() not in ("", first))
    last = (tmp_path / "beat").read_text()
    time.sleep(0.1)  # ten beats
    assert (tmp_path / "beat").read_text() == last
