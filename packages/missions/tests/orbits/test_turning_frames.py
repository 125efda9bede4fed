"""Frames that turn unevenly: their rate, and craft that nothing turns; Drake flies the others."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rans_missions.orbits.elliptic import EllipticOrbit
from rans_missions.orbits.perturbed import PerturbedOrbit
from scipy.integrate import solve_ivp

from rans.effectors.motion import held
from rans.model.body import Body
from rans.model.drift import Drift
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing

N = 0.001027
"""rad/s, a low orbit."""


def solved(rates: Any, start: Any, time: float) -> np.ndarray:
    """End of an integration."""
    return solve_ivp(rates, (0.0, time), start, "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]


DRIFTS = {
    "ellipse": (EllipticOrbit(N, 0.74, 5.9), 0.0),
    "oblate": (PerturbedOrbit(N, 1.4e-3, 0.9, 0.0, 2.1), 1.4e-3),
}


@pytest.mark.parametrize("name", DRIFTS)
@pytest.mark.parametrize("time", [0.1, 10.0, 1500.0])
def test_w_turns_by_its_rate(name: str, time: float) -> None:
    """A quaternion that follows the rate; around an oblate planet up to the second order of what it turns."""
    drift, k = DRIFTS[name]

    def rates(t: float, q: np.ndarray) -> np.ndarray:
        rate: Any = drift.later(t).rate()
        w = np.array(rate.columns())
        return np.array([-0.5 * (q[1:] @ w), *(0.5 * (q[0] * w + np.cross(q[1:], w)))])

    turn: Any = drift.turn(time)
    found = [turn.w, turn.x, turn.y, turn.z]
    atol = 1e-11 + (k * N * time) ** 2
    np.testing.assert_allclose(found, solved(rates, [1.0, 0.0, 0.0, 0.0], time), atol=atol)
    # Two parts make the whole.
    first, second = drift.turn(0.4 * time), drift.later(0.4 * time).turn(0.6 * time)
    assert first is not None
    assert second is not None
    both = first.times(second)
    np.testing.assert_allclose([both.w, both.x, both.y, both.z], found, atol=1e-13 + atol)


def test_a_craft_that_nothing_turns_is_held_in_w_where_it_stands() -> None:
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
        now: Drift = drift
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
