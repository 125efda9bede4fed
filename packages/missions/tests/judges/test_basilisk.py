"""Flights against Basilisk's, of which basilisk.json has the states."""

import pytest
from rans_missions.judges.basilisk import Case, cases, rows

CASES = [pytest.param(name, marks=[pytest.mark.slow] * (name != "thrusters")) for name in cases()]
"""What else flies there flies beside SciPy or Drake in the default run."""


@pytest.mark.parametrize("name", CASES)
def test_a_flight_is_that_of_basilisk(name):
    one = cases()[name]
    (row,) = rows({name: one})
    assert row.passed, row.differences()
    # Where nothing swings: a hundred times what Basilisk's own step of 2 ms leaves.
    assert one.craft.further_effectors or all(check.value < 1e-10 for check in row.checks)


def test_commands_in_another_order_are_another_flight(monkeypatch):
    one = cases()["thrusters"]
    commands = one.commands()[::-1]
    monkeypatch.setattr(Case, "commands", lambda case: commands)
    (row,) = rows({"thrusters": one})
    assert not row.passed
