"""Bounds of missions on an orbit from both sides: flights of known impulse that win, in both engines."""

from __future__ import annotations

import json

import numpy as np
import pytest
from rans_missions.bounds.transfers import Row, TransferTable, judged_transfers
from rans_missions.tasks import Hold

from rans.model.spacecraft_file import load_spacecraft

CHASER = load_spacecraft("vbar-chaser")


@pytest.mark.slow
def test_the_upper_bound_of_a_hold_is_a_flight_that_holds() -> None:
    """It drifts through the tolerances for ten minutes, and goes around the ball, which the bound leaves out."""
    table = judged_transfers(CHASER, Hold(), {}, 600.0, 2023, 1)
    (optimum,) = table.rows
    assert optimum.docked.all()
    assert not optimum.violated.any()
    np.testing.assert_array_equal(table.upper, optimum.impulse)
    assert (table.lower < table.upper).all()
    # Of stopping, 43 N s for thrusters along the axes, nothing is needed; twice as much is for the way around.
    allowed = 2.0 * np.sqrt(3.0) * Hold().velocity_tolerance * CHASER.mass
    assert (table.upper - table.lower < allowed).all()


def test_ratios_are_of_those_who_won_and_a_start_without_a_flight_has_no_number() -> None:
    """Guidance wins from two of three starts with 3 of 2 and 8 of 4 N s; nobody wins from the last one."""
    impulse = np.array([3.0, 8.0, 50.0])
    won = np.array([True, True, False])
    nobody = np.zeros(3, bool)
    table = TransferTable(
        600.0,
        np.array([2.0, 4.0, 5.0]),
        np.array([2.5, 4.5, np.inf]),
        (Row("guidance", won, ~won, impulse), Row("LQR", nobody, nobody, impulse)),
    )
    guidance, lqr = table.cells()
    assert guidance == ("guidance", "66.7 %", "33.3 %", "1.750", "2.000", "5.5 N s")
    assert lqr[3:] == ("-", "-", "-")
    found = json.loads(json.dumps(table.to_json(), allow_nan=False))
    assert found["upper"] == [2.5, 4.5, None]
    assert found["rows"][0] == {
        "name": "guidance",
        "won": [True, True, False],
        "violated": [False, False, True],
        "impulse": [3.0, 8.0, 50.0],
    }
