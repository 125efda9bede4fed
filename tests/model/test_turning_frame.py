"""Attitude in a world frame that turns, against SciPy's integrator in axes that do not."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from rans.model.body import Body
from rans.model.drift import ClohessyWiltshire, Drift
from rans.model.dynamics import Wrench, advance
from rans.model.fields import Vec3
from tests.support.stars import (
    MASS,
    PUSH,
    START,
    TENSOR,
    WIND,
    N,
    in_inertial_axes,
    matrix,
    moved_once,
    spatial,
    turns_by_its_rate,
)


@pytest.mark.parametrize("winds", [False, True], ids=["thrust", "thrust and wind"])
def test_a_craft_flies_and_turns_as_among_the_stars(winds: bool) -> None:
    """A tenth of an orbit; without the turn of W the attitude would be wrong by 0.6 rad."""
    e, time, anomaly = 0.0, 600.0, -0.7
    p, v, attitude, w = in_inertial_axes(e, anomaly, START, time, winds)
    drift: Drift = ClohessyWiltshire(N)
    body = Body(MASS, tuple(map(float, TENSOR[np.triu_indices(3)])))
    thrust, wind = (Wrench(*(Vec3(*map(float, x)) for x in pair)) for pair in (PUSH, WIND))
    disturbance = wind if winds else None
    state = advance(spatial(START), thrust, body, time, 100, disturbance=disturbance, drift=drift)
    # Steps of 6 s turn the craft by 0.1 rad: halves of them are 64 times as near, as the order of six asks for.
    np.testing.assert_allclose(matrix(state.attitude.normalised()), attitude, rtol=0, atol=1e-9)
    np.testing.assert_allclose(state.w.columns(), w, rtol=0, atol=1e-11)
    np.testing.assert_allclose(state.p.columns(), p, rtol=0, atol=1e-7)
    np.testing.assert_allclose(state.v.columns(), v, rtol=0, atol=1e-9)


@pytest.mark.parametrize("time", [0.1, 10.0, 1500.0])
def test_w_turns_by_its_rate(time: float) -> None:
    turns_by_its_rate(ClohessyWiltshire(N), 0.0, time)


def test_single_precision_keeps_its_digits_and_its_type() -> None:
    drift = ClohessyWiltshire(N)
    single, double = (moved_once(drift, dtype) for dtype in (torch.float32, torch.float64))
    # Rotations of 0.01 rad, and eight digits.
    assert float((single - double).abs().max()) < 2e-7
