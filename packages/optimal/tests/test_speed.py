from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import rans_optimal.transcription as transcription
from rans_optimal.speed import solver_rate

from rans import TASKS, GoToPosition
from rans.tasks import Task
from tests.support.engines import PLATFORM
from validation.speed.measurement import Measurement


def measured(task: Task, starts: int) -> list[Measurement]:
    return [Measurement(*row) for row in solver_rate(PLATFORM, task, starts)]


class Solver:
    """Three solves of 1, 1 and 4 s, of which the last fails."""

    def __init__(self, *_: Any) -> None:
        self._answers = iter([(1.0, 10, True), (1.0, 20, True), (4.0, 50, False)])

    def solve(self, *_: Any) -> Any:
        seconds, iterations, solved = next(self._answers)
        return SimpleNamespace(seconds=seconds, iterations=iterations, solved=solved)


def test_a_median_solve_and_the_rate_of_all_together(monkeypatch):
    """3 in 6 s are 0.5 a second; the mean of 1, 1 and 1/4 would be 0.75, one over the median 1."""
    monkeypatch.setattr(transcription, "Transcription", Solver)
    each, rate = measured(GoToPosition(), 3)
    who = "least time, floating-platform"
    assert (each.name, each.value, each.unit) == (f"{who}, median", 1000.0, "ms a solve")
    assert (rate.name, rate.value, rate.unit) == (f"{who}, all together", 0.5, "solves/s")
    assert each.note == rate.note
    assert rate.note.startswith("2 of 3 solved, 20 iterations")


def test_a_real_solve():
    each, rate = measured(GoToPosition(), 1)
    assert each.value is not None
    assert rate.value == pytest.approx(
        1e3 / each.value
    )  # with one start median and mean are the same
    assert "1 of 1 solved" in rate.note
    assert each.warm_up > 0.0


def test_a_task_without_an_optimum_is_a_row_that_says_so():
    [row] = measured(TASKS["multi-task"](), 1)
    assert row.value is None
    assert row.note
