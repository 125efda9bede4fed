"""Attitude in frames that turn unevenly, against SciPy's integrator in axes that do not turn."""

from __future__ import annotations

import numpy as np
import pytest
from rans_missions.orbits.elliptic import EllipticOrbit, mean_anomaly
from rans_missions.orbits.perturbed import PerturbedOrbit

from rans.effectors.motion import held
from rans.model.body import Body
from rans.model.drift import Drift
from rans.model.dynamics import SpatialState, Wrench, advance
from rans.model.fields import Quat, Vec3
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from tests.support.stars import (
    MASS,
    PUSH,
    START,
    TENSOR,
    WIND,
    N,
    in_inertial_axes,
    matrix,
    spatial,
    turns_by_its_rate,
)


@pytest.mark.parametrize("winds", [False, True], ids=["thrust", "thrust and wind"])
def test_a_craft_flies_and_turns_as_among_the_stars(winds: bool) -> None:
    """A tenth of an orbit; without the turn of W the attitude would be wrong by 0.6 rad."""
    e, time, anomaly = 0.5, 600.0, -0.7
    p, v, attitude, w = in_inertial_axes(e, anomaly, START, time, winds)
    drift = EllipticOrbit(N, e, mean_anomaly(anomaly, e))
    body = Body(MASS, tuple(map(float, TENSOR[np.triu_indices(3)])))
    thrust, wind = (Wrench(*(Vec3(*map(float, x)) for x in pair)) for pair in (PUSH, WIND))
    disturbance = wind if winds else None
    state = advance(spatial(START), thrust, body, time, 100, disturbance=disturbance, drift=drift)
    # Steps of 6 s turn the craft by 0.1 rad: halves of them are 64 times as near, as the order of six asks for.
    np.testing.assert_allclose(matrix(state.attitude.normalised()), attitude, rtol=0, atol=1e-9)
    np.testing.assert_allclose(state.w.columns(), w, rtol=0, atol=1e-11)
    np.testing.assert_allclose(state.p.columns(), p, rtol=0, atol=1e-7)
    np.testing.assert_allclose(state.v.columns(), v, rtol=0, atol=1e-9)


DRIFTS = {
    "ellipse": (EllipticOrbit(N, 0.74, 5.9), 0.0),
    "oblate": (PerturbedOrbit(N, 1.4e-3, 0.9, 0.0, 2.1), 1.4e-3),
}


@pytest.mark.parametrize("name", DRIFTS)
@pytest.mark.parametrize("time", [0.1, 10.0, 1500.0])
def test_w_turns_by_its_rate(name: str, time: float) -> None:
    """A quaternion that follows the rate; around an oblate planet up to the second order of what it turns."""
    drift, k = DRIFTS[name]
    turns_by_its_rate(drift, k, time)


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
