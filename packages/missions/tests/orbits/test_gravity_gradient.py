"""The torque of gravity's gradient: engine against Drake, which adds up the accelerations of the craft's masses."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_missions.orbits.elliptic import EllipticOrbit
from rans_missions.tasks import Dock, TargetOrbit

from rans.effectors.motion import states_at_checks
from rans.model.body import Body
from rans.model.drift import ClohessyWiltshire, Drift
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.randomization.parameters import StepInputs
from rans.reference.flight import DrakeMover
from rans.tasks import GoToAttitude

FAST = 0.05
"""Mean motion, rad/s: an orbit of 126 s, in which gravity turns a craft in a minute."""
DRIFTS = {
    "circle": ClohessyWiltshire(FAST, gravity_gradient=True),
    "ellipse": EllipticOrbit(FAST, 0.3, 0.7, gravity_gradient=True),
}
STEPS = 20


def _start(craft: Any) -> SpatialState:
    stores = tuple(0.3 * store.high for store in craft.stores)
    q = Quat(0.8, 0.2, -0.4, 0.4).normalised()
    return SpatialState(
        Vec3(1.0, -2.0, 0.5), q, Vec3(0.01, 0.02, 0.0), Vec3(0.02, -0.01, 0.03), stores=stores
    )


def _craft(name: str) -> Any:
    """A craft with unequal moments of inertia; a CubeSat with wheels of a tenth of them."""
    craft = load_spacecraft(name)
    if not craft.wheels:
        return replace(craft, inertia=((0.1, 0.01, 0.0), (0.01, 0.15, 0.02), (0.0, 0.02, 0.2)))
    heavy = tuple(
        replace(wheel, inertia=0.1 * craft.inertia[0][0] * (1 + k))
        for k, wheel in enumerate(craft.wheels)
    )
    return replace(craft, wheels=heavy)


def _both(craft: Any, drift: Drift) -> tuple[Any, Any]:
    """State after 20 s without commands in the engine and in Drake."""
    timing = Timing(1.0, substeps=8, episode_steps=STEPS)
    state = judged = _start(craft)
    mover = DrakeMover(craft, timing, drift, 0.05)
    command = (0.0,) * craft.command_count
    body = Body.of(craft)
    moving = drift
    for _ in range(STEPS):
        (state,) = states_at_checks(state, craft, body, command, timing, moving)
        (judged,) = mover(judged, StepInputs(body, (command,), drift=moving))
        moving = moving.later(1.0)
    return state, judged


def _apart(state: Any, judged: Any) -> float:
    q, r = state.attitude, judged.attitude
    off = [abs(a - float(b)) for a, b in zip(state.w.columns(), judged.w.columns(), strict=True)]
    pairs = [(q.w, float(r.w)), (q.x, float(r.x)), (q.y, float(r.y)), (q.z, float(r.z))]
    sign = np.sign(sum(a * b for a, b in pairs))
    turns = [abs(a - sign * b) for a, b in pairs]
    return float(max(*off, *turns))


@pytest.mark.parametrize("name", ["free-flyer", pytest.param("cubesat-6u", marks=pytest.mark.slow)])
@pytest.mark.parametrize("drift", DRIFTS)
def test_engine_and_drake_turn_alike(name: str, drift: str) -> None:
    craft = _craft(name)
    state, judged = _both(craft, DRIFTS[drift])
    assert _apart(state, judged) < 1e-7
    # Without it a craft is elsewhere: what is compared is the torque.
    still, _ = _both(craft, replace(DRIFTS[drift], gravity_gradient=False))
    assert max(abs(a - b) for a, b in zip(state.w.columns(), still.w.columns(), strict=True)) > 1e-3


def test_missions_and_attitudes_have_it_on_request() -> None:
    assert GoToAttitude().drift.gradient() is None
    assert GoToAttitude(mean_motion=0.001).drift.gradient() == pytest.approx(1e-6)
    circle = Dock(orbit=TargetOrbit(gravity_gradient=True))
    assert circle.drift.gradient() == pytest.approx(circle.mean_motion**2)
    ellipse = Dock(
        orbit=TargetOrbit(
            gravity_gradient=True,
            eccentricity=0.3,
            semi_major_axis_km=9683.0,
            true_anomaly_degrees=(0.0, 0.0),
        )
    )
    # At the perigee, mu / r^3 by hand.
    perigee = 9683e3 * 0.7
    assert ellipse.drift.gradient() == pytest.approx(3.986004418e14 / perigee**3)
