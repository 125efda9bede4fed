"""Flights against Basilisk's, of which basilisk.json has the states."""

from __future__ import annotations

from typing import Any

import pytest
from rans_missions.judges import basilisk
from rans_missions.judges.basilisk import rows

from rans.extend import read_json


@pytest.fixture(scope="module")
def figures() -> dict[str, Any]:
    return read_json(basilisk._FIGURES)


def test_every_flight_is_that_of_basilisk(figures: dict[str, Any]) -> None:
    for row in rows(figures):
        assert row.passed, (row.case, row.differences())
        # Ten times what Basilisk's own step of 2 ms leaves, where nothing swings.
        rigid = "slosh" not in row.case
        assert not rigid or all(check.value < 1e-9 for check in row.checks), row.differences()


@pytest.mark.parametrize("case", basilisk.cases())
def test_another_flight_is_noticed(
    monkeypatch: pytest.MonkeyPatch, figures: dict[str, Any], case: str
) -> None:
    """Commands of another seed are another flight, in every case."""
    one = basilisk.cases()[case]
    monkeypatch.setattr(basilisk, "cases", lambda: {case: one})
    monkeypatch.setattr(type(one), "commands", lambda self: COMMANDS(self)[::-1])
    (row,) = rows(figures)
    assert not row.passed


COMMANDS = basilisk.Case.commands
