"""Docking with a target on an elliptic orbit: its notes, guidance, Drake, two-body gravity, and who refuses it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from rans_missions.orbits.earth import EARTH
from rans_missions.tasks import Dock
from rans_missions.tasks.orbital import TargetOrbit

from rans.episode.scenario import scenarios
from rans.model.drift import ClohessyWiltshire
from rans.model.fields import leaves
from rans.model.spacecraft_file import load_spacecraft

DEPUTY = load_spacecraft("afrl-deputy")
TRANSFER = TargetOrbit(eccentricity=0.5, semi_major_axis_km=13_556.0)
"""Perigee at an altitude of 400 km."""
TASK = Dock(deadline=(600.0, 600.0), orbit=TRANSFER)


def test_the_orbit_is_set_in_kilometres_and_degrees():
    assert TASK.mean_motion == pytest.approx(math.sqrt(EARTH / 13_556e3**3), rel=1e-12)
    assert isinstance(Dock().drift, ClohessyWiltshire)
    assert Dock().mean_motion == 0.001027
    assert leaves(TASK.drift) == (TASK.mean_motion, 0.5, 0.0, False)
    # At the perigee and at the apogee the mean anomaly is the true one.
    for degrees in (0.0, 180.0):
        task = Dock(orbit=replace(TRANSFER, true_anomaly_degrees=(degrees, degrees)))
        goal = scenarios(task, DEPUTY, 1, 2).goal
        np.testing.assert_allclose(
            np.cos(goal.notes.angle), math.cos(math.radians(degrees)), atol=1e-12
        )
        later = task.later(goal, 100.0).notes.angle - goal.notes.angle
        np.testing.assert_allclose(later, 100.0 * task.mean_motion, rtol=1e-9)


def test_an_observation_says_where_the_target_is():
    starts = scenarios(TASK, DEPUTY, 5, 2)
    names = [term.name for term in TASK.observation_terms(starts.start, starts.goal)]
    assert names[-2:] == ["cosine of the anomaly", "sine of the anomaly"]
    assert len(names) == 2 + len(
        Dock().observation_terms(
            starts.start, replace(starts.goal, notes=replace(starts.goal.notes, angle=None))
        )
    )
