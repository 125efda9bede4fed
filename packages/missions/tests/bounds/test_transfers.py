"""Bounds of missions on an orbit from both sides: flights of known impulse that win, in both engines."""

from __future__ import annotations

import json

import numpy as np
import pytest
from rans_missions.bounds import transfers
from rans_missions.bounds.transfers import Row, judged_transfers
from rans_missions.tasks import Hold

from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import scenarios

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
    table = transfers._table(
        600.0,
        [2.0, 4.0, 5.0],
        [Row("guidance", won, ~won, impulse), Row("LQR", nobody, nobody, impulse)],
        Row("optimum", won, nobody, np.array([2.5, 4.5, 9.0])),
    )
    guidance, lqr, _ = table.cells()
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


def test_a_flight_that_one_engine_alone_wins_is_no_upper_bound(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    nobody = np.zeros(2, bool)
    fast, drake = (Row("", np.array(won), nobody, np.ones(2)) for won in ([1, 1], [1, 0]))
    rows = iter((fast, drake))
    monkeypatch.setattr(transfers, "row_of", lambda *_: next(rows))
    for engine in ("fly", "fly_in_drake"):
        monkeypatch.setattr(transfers, engine, lambda *_: None)
    starts = scenarios(Hold(), CHASER, 1, 2)
    found = transfers._flown("", CHASER, Hold(), starts, [None, None])
    assert found.docked.tolist() == [1, 0]
