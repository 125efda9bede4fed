"""Flights on orbits against NASA's JEOD (`rans_missions/judges/jeod.toml` has the figures and their source)."""

from __future__ import annotations

from dataclasses import replace

import pytest
from rans_missions.judges.jeod import RUNS, Run, rows

SHORT = {
    "8A": 14400,
    "8B": 14400,
    "9A": 2160,
    "9B": 2160,
    "9D": 2400,
    "10C": 480,
}
"""Times, s, at which the default tests end."""


@pytest.mark.parametrize("name", SHORT)
def test_the_start_of_a_run_is_that_of_jeod(name):
    (row,) = rows({name: _cut(RUNS[name], SHORT[name])})
    assert row.passed, row.differences()
    # The fields that a run has: sixteen digits of 17 rad, and the log has as many.
    found = {check.name: check.value for check in row.checks}
    assert found["attitude"] < 1e-9
    assert found["spin"] < 1e-13


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_eight_hours_are_those_of_jeod(name):
    (row,) = rows({name: RUNS[name]})
    assert row.passed, row.differences()


def _cut(run: Run, until: int) -> Run:
    """A run without figures after a time, s."""
    return replace(
        run,
        motion={time: x for time, x in run.motion.items() if time <= until},
        turning={time: x for time, x in run.turning.items() if time <= until},
    )
