"""Missions near a target around the oblate Earth, with drag: settings, Drake."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.orbits.perturbed import PerturbedOrbit
from rans_missions.tasks import Dock
from rans_missions.tasks.hold import Hold
from rans_missions.tasks.orbital import TargetOrbit
from rans_missions.tasks.rendezvous import Rendezvous

from rans.flight import fly
from rans.model.drift import ClohessyWiltshire
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from rans.model.spacecraft_file import load_spacecraft
from rans.reference.flight import DrakeMover
from rans.scenario import scenarios

LOW = TargetOrbit(oblate=True, inclination_degrees=51.6, target_drag=4e-6, ballistic_ratio=0.5)
"""Ten times the drag at 500 km, so that it shows within a minute."""


def gap(flight: Any, other: Any) -> float:
    """Largest distance between two flights, m."""
    return float(np.abs(np.stack((flight.states.p - other.states.p).columns())).max())


def test_the_orbit_is_set_by_numbers_of_the_target() -> None:
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
def test_goals_know_where_the_target_is(kind: Any) -> None:
    task = kind(orbit=LOW)
    rest = SpatialState(
        Vec3(0.0, 0.0, 0.0), Quat(1.0, 0.0, 0.0, 0.0), Vec3(0.0, 0.0, 0.0), Vec3(0.0, 0.0, 0.0)
    )
    goal: Any = replace(rest, notes=task.goal_notes(600.0, 600.0, 0.0, 1.5))
    assert task.drift_at(goal).latitude == 1.5
    later = task.later(goal, 100.0)
    # The rate is that of the mean motion, and oblateness changes it by less than two thousandths of it.
    assert later.notes.angle - 1.5 == pytest.approx(100.0 * task.mean_motion, rel=2e-3)
    assert task.remember(later, rest).notes.angle == later.notes.angle
    assert task.coast_zone is None


@pytest.mark.slow
def test_arrivals_planned_without_oblateness_cost_as_much_as_those_with_it() -> None:
    task = Dock(orbit=LOW)
    drawn = scenarios(task, load_spacecraft("afrl-deputy"), 1, 64)
    guidance = task.guidance_at(drawn.goal)
    deadline, planned = drawn.goal.notes.deadline, drawn.goal.notes.arrival
    limits = task.guidance_limits(drawn.goal)
    best = guidance.arrival(drawn.start, drawn.goal, deadline, limits)
    prices = [
        guidance.price(drawn.start, drawn.goal, time, limits).mean() for time in (planned, best)
    ]
    assert np.mean(planned == best) > 0.9
    assert prices[0] == pytest.approx(prices[1], rel=1e-3)


@pytest.mark.slow
def test_drake_moves_as_the_mission_does() -> None:
    """Drake integrates the differential equations, from the derivative of the vector of J2."""
    task = Dock(orbit=LOW, deadline=(600.0, 600.0))
    craft = load_spacecraft("afrl-deputy")
    starts: Any = scenarios(task, craft, 5, 1)
    names = [term.name for term in task.observation_terms(starts.start, starts.goal)]
    assert names[-2:] == ["cosine of the argument of latitude", "sine of the argument of latitude"]
    timing = replace(task.timing, episode_steps=1)
    drake = DrakeMover(craft, timing, task.drift, 0.5)

    def at_the_node(state: Any, step_inputs: Any) -> Any:
        return drake(state, replace(step_inputs, drift=None))

    ours, judged, elsewhere = (
        fly(craft, task, MissionGuidance(craft, task), starts, timing, mover)
        for mover in (None, drake, at_the_node)
    )
    # Terms of the second order in k = 1.3e-3: (k n)^2 of 150 m, for 10 s, are 1e-8 m.
    assert gap(ours, judged) < 1e-7
    assert gap(ours, elsewhere) > 1e-6
