"""What a training tells where there is no terminal."""

from __future__ import annotations

import sys
from typing import Any

import pytest

from rans.base.terminal import doing
from rans.show.progress import (
    _BAR,
    NowAndThen,
    TrainingProgress,
    describe,
    watched,
    watched_training,
)


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


def test_a_training_in_a_notebook_is_told_in_lines(monkeypatch, capsys):
    for is_notebook in (False, True):
        monkeypatch.setattr("rans.show.progress.in_notebook", lambda said=is_notebook: said)
        with watched_training(3_000_000, None) as show:
            show(row(3_000_000))
        assert ("training: 3.00 M steps" in capsys.readouterr().err) == is_notebook


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
