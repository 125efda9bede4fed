"""The shipped ATMOS by hand: what its makers' allocation says of every thruster, and one pulse of it."""

from __future__ import annotations

import numpy as np
import pytest

from rans import Timing
from rans.effectors.motion import held
from rans.model.actuators import Pulsed
from rans.model.body import Body
from rans.model.dynamics import PlanarState
from rans.model.spacecraft_file import load_spacecraft
from rans.reference.plant import Plant
from tests.support.states import planar

ATMOS = load_spacecraft("atmos")
PERIOD = 0.1
"""s, of the valves' 10 Hz."""

BY_HAND = [
    # Signed pairs u0..u3 of thrusters (0, 1), (2, 3), (4, 5), (6, 7), x forward and y left:
    # F_x = u0 + u1, F_y = -u2 - u3, tau = 0.12 m (-u0 + u1 - u2 + u3), each of 1.5 N.
    (1.5, 0.0, -0.18),
    (-1.5, 0.0, 0.18),
    (1.5, 0.0, 0.18),
    (-1.5, 0.0, -0.18),
    (0.0, -1.5, -0.18),
    (0.0, 1.5, 0.18),
    (0.0, -1.5, 0.18),
    (0.0, 1.5, -0.18),
]


def test_every_thruster_pushes_where_its_makers_say():
    assert np.array(ATMOS.wrench_map) == pytest.approx(np.array(BY_HAND), abs=1e-15)
    assert Plant(ATMOS).thruster_wrenches() == pytest.approx(np.array(BY_HAND), abs=1e-15)


def test_a_short_pulse_comes_first_and_in_whole_counts():
    """Thrusters 0 and 2 for a duty of 0.25004 are open for 2,500 counts, 25 ms, then the craft coasts 75 ms:
    3 N / 17.8 kg for 25 ms give the speed, half that time and the rest at that speed the way."""
    after = pulsed([0.25004, 0.0, 0.25004, *[0.0] * 5])
    speed = 3.0 / 17.8 * 0.025
    assert after.v.x == pytest.approx(speed, abs=1e-16)
    assert after.p.x == pytest.approx(speed * (0.0125 + 0.075), abs=1e-16)


def pulsed(command: list[float]) -> PlanarState:
    assert ATMOS.actuators == Pulsed(10_000)
    rest = planar()
    return held(rest, ATMOS, Body.of(ATMOS), command, Timing(control_period=PERIOD))
