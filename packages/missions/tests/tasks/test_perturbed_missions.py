"""Missions near a target around the oblate Earth, with drag: settings, Drake."""

from dataclasses import replace

import pytest
from rans_missions.orbits.perturbed import PerturbedOrbit
from rans_missions.tasks import Dock
from rans_missions.tasks.hold import Hold
from rans_missions.tasks.orbital import TargetOrbit
from rans_missions.tasks.rendezvous import Rendezvous

from rans.model.drift import ClohessyWiltshire
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3

LOW = TargetOrbit(oblate=True, inclination_degrees=51.6, target_drag=4e-6, ballistic_ratio=0.5)
"""Ten times the drag at 500 km, so that it shows within a minute."""


def test_the_orbit_is_set_by_numbers_of_the_target():
    drift = Dock(orbit=LOW).drift
    assert isinstance(drift, PerturbedOrbit)
    # 1.5 J2 of the Earth (0.0016239), by the square of its radius over that of the orbit.
    assert drift.oblateness == pytest.approx(1.5 * 0.00108263 * (6378.137 / 7229.9) ** 2, rel=1e-4)
    # Half the ballistic coefficient is twice the drag: once more than that of the target.
    assert drift.drag == pytest.approx(4e-6)
    assert drift.inclination == pytest.approx(0.900589894)
    air = Dock(orbit=TargetOrbit(target_drag=4e-6, ballistic_ratio=2.0)).drift
    assert air == PerturbedOrbit(0.001027, 0.0, 0.0, -2e-6, 0.0)
    # Another ballistic coefficient without drag is no perturbation.
    assert isinstance(Hold(orbit=TargetOrbit(ballistic_ratio=0.5)).drift, ClohessyWiltshire)


@pytest.mark.parametrize("kind", [Dock, Hold, Rendezvous])
def test_goals_know_where_the_target_is(kind):
    task = kind(orbit=LOW)
    rest = SpatialState(
        Vec3(0.0, 0.0, 0.0), Quat(1.0, 0.0, 0.0, 0.0), Vec3(0.0, 0.0, 0.0), Vec3(0.0, 0.0, 0.0)
    )
    goal = replace(rest, notes=task.goal_notes(600.0, 600.0, 0.0, 1.5))
    assert task.drift_at(goal).angle == 1.5
    later = task.later(goal, 100.0)
    # The rate is that of the mean motion, and oblateness changes it by less than two thousandths of it.
    assert later.notes.angle - 1.5 == pytest.approx(100.0 * task.mean_motion, rel=2e-3)
    assert task.remember(later, rest).notes.angle == later.notes.angle
    assert task.coast_zone is None
