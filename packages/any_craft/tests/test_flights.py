"""Flights by the agents for any craft have these figures, however columns and allocation are computed."""

from __future__ import annotations

import pytest

from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.measure.aggregate import measure


@pytest.mark.parametrize(
    ("name", "time", "impulse"),
    [
        # On/off thrusters that hold the pose by pulses, or fly as fast as they can along each way.
        ("any-craft-2d#1@floating-platform", 13.3, 4.55),
        ("any-craft-2d#0@floating-platform", 5.3, 19.33),
        ("any-craft-2d#0.4@floating-platform-shared", 9.6, 10.22),
        # Pulsed and throttled ones, wheels, and finer tolerances.
        ("any-craft-2d#0.9@pingu", 15.8, 14.49),
        ("any-craft-2d#0.6,2cm@freeflyer2", 31.3, 5.842),
        ("any-craft-3d#0@spheres", 15.0, 7.05),
        ("any-craft-3d#0.8@free-flyer", 6.6, 16.48),
        pytest.param("any-craft-3d#0.3@cubesat-6u", 41.0, 7.309, marks=pytest.mark.slow),
    ],
)
def test_all_settle_in_a_time_with_an_impulse(name, time, impulse):
    """Median settling time, s, and mean impulse, N s, of 24 flights; the on/off ones amplify roundings."""
    run = contestant(name)
    flight = fly_episodes(run.controller, run.judged, 11, 24, workers=1)
    rows = {row.name: row.value for row in measure(flight).rows}
    assert rows["solved"] == 100.0
    assert rows["settling time"] == pytest.approx(time, rel=0.01)
    assert rows["impulse"] == pytest.approx(impulse, rel=0.01)
