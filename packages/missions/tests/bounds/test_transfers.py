"""Bounds of missions on an orbit from both sides: flights of known impulse that win, in both engines."""

from __future__ import annotations

import numpy as np
import pytest
from rans_missions.bounds.transfers import judged_transfers
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
