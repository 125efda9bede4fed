"""The torque of gravity's gradient on request; JEOD's runs and pairs of effects in Drake judge it."""

import numpy as np
import pytest
from rans_missions.orbits.elliptic import EllipticOrbit
from rans_missions.tasks import Dock, TargetOrbit

from rans import GoToAttitude, Timing
from rans.effectors.motion import held
from rans.model.body import Body
from tests.support.crafts import nasty_spatial, random_states


def test_missions_and_attitudes_have_it_on_request():
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


def test_a_gradient_that_changes_within_a_period_is_followed():
    """Towards the periapsis of an orbit of 209 s; half the substep has a sixteenth of the error, by its order."""
    craft = nasty_spatial()
    start = random_states(3, 4, 1, speed=0.1, spin=0.05)
    orbit = EllipticOrbit(0.03, 0.5, -0.6, gravity_gradient=True)
    shut = (np.zeros(4),) * len(craft.thrusters)
    spins = [
        np.array(held(start, craft, Body.of(craft), shut, Timing(4.0, count), orbit).spin())
        for count in (1, 2, 64)
    ]
    whole, half = (np.abs(spin - spins[-1]).max() for spin in spins[:2])
    assert half < 0.1 * whole < 1e-6
