"""Docking with a target on an elliptic orbit: its notes, guidance, Drake, two-body gravity, and who refuses it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.orbits.earth import EARTH
from rans_missions.tasks import Dock
from rans_missions.tasks.orbital import TargetOrbit
from rans_missions.two_body import TwoBodyMover

from rans.errors import ConfigError
from rans.evaluation.measure.metrics import impulses, won
from rans.flight import fly
from rans.model.drift import ClohessyWiltshire
from rans.model.fields import leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.optimal.control.lqr import LQR
from rans.reference.flight import DrakeMover
from rans.scenario import scenarios

DEPUTY = load_spacecraft("afrl-deputy")
TRANSFER = TargetOrbit(eccentricity=0.5, semi_major_axis_km=13_556.0)
"""Perigee at an altitude of 400 km."""
TASK = Dock(deadline=(600.0, 600.0), orbit=TRANSFER)
TIMING = replace(TASK.timing, episode_steps=60)


def gaps(flight: Any, other: Any, steps: int) -> np.ndarray:
    """Distance between two flights in their first control periods, m, (episodes, steps)."""
    return np.stack((flight.states.p - other.states.p).columns())[:, :steps]


def test_the_orbit_is_set_in_kilometres_and_degrees() -> None:
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


def test_drake_agrees_and_knows_the_time() -> None:
    """Drake solves Kepler's equation and the differential equations by itself, in steps of half a second."""
    starts = scenarios(TASK, DEPUTY, 5, 2)
    short = replace(TIMING, episode_steps=4)
    ours, drake, frozen = (
        fly(DEPUTY, TASK, MissionGuidance(DEPUTY, TASK), starts, short, mover)
        for mover in (None, DrakeMover(DEPUTY, short, TASK.drift), _frozen(short))
    )
    assert np.abs(gaps(ours, drake, 4)).max() < 1e-9
    # The same commands lead elsewhere where the target's time stands still.
    assert np.abs(gaps(ours, frozen, 4)).max() > 1e-4


def _frozen(timing: Any) -> Any:
    """Drake with the target at the first anomaly of the orbit in every period."""
    mover = DrakeMover(DEPUTY, timing, TASK.drift)
    return lambda state, step_inputs: mover(state, replace(step_inputs, drift=None))


@pytest.mark.slow
def test_guidance_docks_also_in_two_body_gravity() -> None:
    starts = scenarios(TASK, DEPUTY, 5, 2)
    mover = TwoBodyMover(DEPUTY, TIMING, TASK.mean_motion, eccentricity=0.5)
    linear, true = (
        fly(DEPUTY, TASK, MissionGuidance(DEPUTY, TASK), starts, TIMING, move)
        for move in (None, mover)
    )
    for flight in (linear, true):
        assert won(flight).all()
    # Distance over radius is 2e-5, and other equations than ours move it a little.
    assert 1e-7 < np.abs(gaps(linear, true, 30)).max() < 0.05
    np.testing.assert_allclose(impulses(true), impulses(linear), rtol=1e-2)


def test_an_observation_says_where_the_target_is() -> None:
    starts = scenarios(TASK, DEPUTY, 5, 2)
    names = [term.name for term in TASK.observation_terms(starts.start, starts.goal)]
    assert names[-2:] == ["cosine of the anomaly", "sine of the anomaly"]
    assert len(names) == 2 + len(
        Dock().observation_terms(
            starts.start, replace(starts.goal, notes=replace(starts.goal.notes, angle=None))
        )
    )


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: LQR(DEPUTY, TASK),
            "LQR .* changes along the orbit; fly a circular orbit, or mission",
        ),
        (lambda: TargetOrbit(eccentricity=1.0), r"from 0 to 0\.9, got 1\.0"),
        (lambda: TargetOrbit(0.3, 7000.0), "4900 km from the Earth's centre, inside the Earth"),
        # The mission's mean motion of 0.001027 rad/s is that of 7,230 km.
        (lambda: Dock(orbit=TargetOrbit(0.3)), "50[56].*inside the Earth.*set semi_major_axis_km"),
        (lambda: TargetOrbit(0.3, -1.0), "semi_major_axis_km must be"),
        (lambda: TargetOrbit(true_anomaly_degrees=(90.0, 0.0)), "range .low, high."),
        # Around the perigee half a turn takes less than half a period.
        (lambda: Dock(deadline=(600.0, 3000.0), orbit=TRANSFER), r"deadline must be < 29\d\d s"),
    ],
)
def test_others_and_impossible_orbits_are_refused(make: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        make()
