"""Bounds of missions on an orbit from both sides: flights of known impulse that win, in both engines."""

import numpy as np
import pytest
from rans_missions.bounds import transfers
from rans_missions.bounds.transfers import least_of_transfers
from rans_missions.tasks import Hold

from rans.episode.scenario import scenarios
from rans.model.spacecraft_file import load_spacecraft

CHASER = load_spacecraft("vbar-chaser")


@pytest.mark.slow
def test_the_upper_bound_of_a_hold_is_a_flight_that_holds():
    """It drifts through the tolerances for ten minutes, and goes around the ball, which the bound leaves out."""
    task = Hold(deadline=(600.0, 600.0))
    found = least_of_transfers(CHASER, task, scenarios(task, CHASER, 2023, 1))
    assert not found.flight.violated().any()
    assert (found.lower < found.upper).all()
    # Of stopping, 43 N s for thrusters along the axes, nothing is needed; twice as much is for the way around.
    allowed = 2.0 * np.sqrt(3.0) * Hold().velocity_tolerance * CHASER.mass
    assert (found.upper - found.lower < allowed).all()


def test_a_flight_that_one_engine_alone_wins_is_no_upper_bound(monkeypatch):
    both = np.array([True, True])
    for engine, wins in (("fly", both), ("fly_in_drake", np.array([True, False]))):
        monkeypatch.setattr(transfers, engine, lambda *_, wins=wins: wins)
    monkeypatch.setattr(transfers, "won", lambda wins: wins)
    monkeypatch.setattr(transfers, "impulses", lambda _: np.array([2.5, 4.5]))
    starts = scenarios(Hold(), CHASER, 1, 2)
    lower = iter((2.0, 4.0))
    found = transfers._flown(CHASER, Hold(), starts, lambda _: (next(lower), None), lambda _: None)
    assert found.to_json() == {"lower": [2.0, 4.0], "upper": [2.5, None]}
    assert found.table("").rows == [
        ("0", "2.5", "2", "1.250"),
        ("1", "-", "4", "no flight"),
    ]
