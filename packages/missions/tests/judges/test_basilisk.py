"""Flights against Basilisk's, of which basilisk.json has the states."""

from dataclasses import replace

import pytest
from rans_missions.judges.basilisk import Case, cases, rows


@pytest.mark.slow
@pytest.mark.parametrize("name", cases())
def test_a_flight_is_that_of_basilisk(name):
    one = cases()[name]
    (row,) = rows({name: one})
    assert row.passed, row.differences()
    # Where nothing swings: a hundred times what Basilisk's own step of 2 ms leaves.
    assert one.craft.further_effectors or all(check.value < 1e-10 for check in row.checks)


def test_the_first_periods_of_a_craft_of_unequal_inertia(monkeypatch):
    """With equal moments of inertia nobody would see an error of gyroscopic torques."""
    one = cases()["tank"]
    commands = one.commands()
    monkeypatch.setattr(Case, "commands", lambda case: commands[: case.steps])
    (row,) = rows({"tank": replace(one, steps=10)})
    assert all(check.value < 1e-10 for check in row.checks)
