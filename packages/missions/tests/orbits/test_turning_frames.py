"""Frames that turn unevenly: craft that nothing turns; Drake flies the others."""

import numpy as np
import pytest
from rans_missions.orbits.elliptic import EllipticOrbit

from rans import Timing
from rans.effectors.motion import held
from rans.model.body import Body
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from rans.model.spacecraft_file import load_spacecraft

N = 0.001027
"""rad/s, a low orbit."""


def test_a_craft_that_nothing_turns_is_held_in_w_where_it_stands():
    """On an ellipse W turns unevenly, and a point has no attitude of its own; with a spin it is a free body."""
    point, other = load_spacecraft("afrl-deputy"), load_spacecraft("free-flyer")
    zero = np.zeros(2)
    spins = np.array([0.0, 0.001])
    state = SpatialState(
        Vec3(zero, zero, zero),
        Quat(zero + 1.0, zero, zero, zero),
        Vec3(zero, zero, zero),
        Vec3(zero, zero, spins),
    )
    drift = EllipticOrbit(N, 0.5, 0.0)
    timing = Timing(control_period=10.0, substeps=1)
    angles = []
    for craft in (point, other):
        now = drift
        after = state
        for _ in range(60):
            shut = (zero,) * craft.command_count
            after = held(after, craft, Body.of(craft), shut, timing, now)
            now = now.later(10.0)
        angles.append(2.0 * np.arctan2(after.attitude.z, after.attitude.w))
    # From the perigee on the line to the target slows down, and a free body turns ahead.
    free = angles[1]
    assert angles[0] == pytest.approx([0.0, free[1]], abs=1e-12)
    assert free[0] > 0.1
    assert free[1] - free[0] == pytest.approx(0.6, abs=1e-12)
