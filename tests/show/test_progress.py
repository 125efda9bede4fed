"""What a training tells where there is no terminal."""

from __future__ import annotations

import sys
from typing import Any
from unittest.mock import Mock, call

import pytest

from rans.show.progress import (
    _BAR,
    NowAndThen,
    TrainingProgress,
    describe,
    watched,
    watched_training,
)
from rans.terminal import doing


def row(steps: int) -> dict[str, Any]:
    return {"steps": steps, "success": 0.5, "steps_per_s": 1e6, "return/thrust": -3.2}


def test_a_line_fits_eighty_columns():
    """Of the largest training that somebody watches, and the highest rate measured."""
    longest = {"steps": 987_654_321, "success": 1.0, "steps_per_s": 67.2e6, "return/a": -1234.0}
    assert len(describe(longest, 10**10)) + _BAR + 1 <= 80


def test_the_last_row_is_told_however_soon_it_comes(capsys, monkeypatch):
    """Rows in between only now and then; the last is that of the whole budget, or of more."""
    monkeypatch.setattr("rans.show.progress.time.monotonic", lambda: 1.0)
    for last in (3_000_000, 3_100_000):
        progress = TrainingProgress(3_000_000)
        for steps in (1_000_000, 2_000_000, last):
            progress.show(row(steps))
        assert capsys.readouterr().err.splitlines() == [
            f"training: {steps / 1e6:.2f} M steps, solved 50.0%, return -3, 1.00 M/s, 0:00:0{left} left"
            for steps, left in ((1_000_000, 2), (last, 0))
        ]


def test_a_notebook_counts_the_work_of_a_stage_up_and_keeps_nothing_of_it(monkeypatch):
    line = Mock()
    monkeypatch.setattr("rans.show.progress.in_notebook", lambda: True)
    monkeypatch.setattr("rans.show.progress.NotebookLine", lambda: line)
    with watched() as stage:
        step = stage("flying", 4)
        step(1)
        step(2)
    first, *later, last = line.mock_calls
    assert first == call.show("flying", 0.0, surely=True)
    assert later == [call.show("flying: 1 of 4", 0.25), call.show("flying: 3 of 4", 0.75)]
    assert last == call.clear()


class Logged:
    """What a logger puts in place of a stream."""

    def __init__(self) -> None:
        self.text = ""

    def write(self, text: str) -> None:
        self.text += text

    def flush(self) -> None:
        pass


@pytest.mark.parametrize("stream", [None, Logged()])
def test_a_program_without_a_console_trains(stream, monkeypatch, capsys):
    monkeypatch.setattr(sys, "stderr", stream)
    with watched_training(10, None) as shown, watched() as stage:
        shown({"steps": 10})
        stage("flying", 2)(1)
    with doing("flying"):
        NowAndThen().say("half")
    assert capsys.readouterr().out == ""
    assert stream is None or "half\n" in stream.text
