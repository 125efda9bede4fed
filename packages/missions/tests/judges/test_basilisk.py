"""Flights against Basilisk's, of which basilisk.json has the states."""

from __future__ import annotations

from typing import Any

import pytest
from rans_missions.judges import basilisk
from rans_missions.judges.basilisk import BASILISK_STATES, Case, cases, rows

from rans.extend import read_json

CASES = [
    pytest.param(name, marks=[pytest.mark.slow] * (name in ("wheels", "gradient")))
    for name in cases()
]


@pytest.mark.parametrize("name", CASES)
def test_a_flight_is_that_of_basilisk(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """And commands in another order are another flight."""
    figures: dict[str, Any] = read_json(BASILISK_STATES)
    one = cases()[name]
    monkeypatch.setattr(basilisk, "cases", lambda: {name: one})
    (row,) = rows(figures)
    assert row.passed, row.differences()
    # Where nothing swings: a hundred times what Basilisk's own step of 2 ms leaves.
    assert one.craft.further_effectors or all(check.value < 1e-10 for check in row.checks)
    commands = one.commands()[::-1]
    monkeypatch.setattr(Case, "commands", lambda case: commands)
    (row,) = rows(figures)
    assert not row.passed
