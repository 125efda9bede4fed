"""The torque of gravity's gradient on request; JEOD's runs and pairs of effects in Drake judge it."""

import pytest
from rans_missions.tasks import Dock, TargetOrbit

from rans import GoToAttitude


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
