from __future__ import annotations

import pytest

from rans.tasks import TASKS, GoToPosition
from tests.fast.engines import PLATFORM
from validation.speed.solving import solver_rate


def test_solves_per_second_are_those_of_their_milliseconds() -> None:
    each, rate = solver_rate(PLATFORM, GoToPosition(), starts=1)
    assert each.value is not None
    assert rate.value == pytest.approx(1e3 / each.value)  # with one start median and mean are the same
    assert "1 of 1 solved" in rate.note


def test_a_task_without_an_optimum_is_a_row_that_says_so() -> None:
    [row] = solver_rate(PLATFORM, TASKS["multi-task"](), starts=1)
    assert row.value is None
    assert row.note
