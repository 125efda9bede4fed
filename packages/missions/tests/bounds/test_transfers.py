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
    """It brakes from 5 cm/s, 25 N s, which the bound of an instant leaves out, and corrects once or twice."""
    table = judged_transfers(CHASER, Hold(), {}, 600.0, 2023, 1)
    (optimum,) = table.rows
    assert optimum.docked.all()
    assert not optimum.violated.any()
    np.testing.assert_array_equal(table.upper, optimum.impulse)
    assert (table.lower < table.upper).all()
    # Thrusters along the axes stop 5 cm/s with 43 N s at most; as much is for corrections and the way around.
    allowed = 2.0 * np.sqrt(3.0) * Hold().velocity_tolerance * CHASER.mass
    assert (table.upper - table.lower < allowed).all()
