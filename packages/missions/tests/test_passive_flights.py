"""Passive safety of flights, with hand-worked ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rans_missions.passive_flights import passive_safety
from rans_missions.passive_safety import CoastZone
from rans_missions.script import Script

import rans
from rans import ConfigError, Timing
from rans.episode.flight import Flight, fly
from rans.episode.scenario import scenarios
from rans.evaluation.measure.aggregate import measure
from rans.model.fields import Vec3
from rans.model.spacecraft_file import load_spacecraft

N = rans.Hold().mean_motion


def flown(p: np.ndarray, v: np.ndarray, commands: np.ndarray, period: float = 10.0) -> Flight:
    """Flights of hold's craft from starts (N, 3) under commands (T, 6), with a control period, s."""
    craft, task = load_spacecraft("vbar-chaser"), rans.Hold()
    starts = scenarios(task, craft, 1, len(p))
    start = replace(starts.start, p=Vec3(*p.T), v=Vec3(*v.T))
    timing = Timing(control_period=period, episode_steps=len(commands))
    script = Script(np.repeat(commands[:, None], len(p), axis=1))
    return fly(craft, task, script, replace(starts, start=start), timing)


P = np.array([[0.0, -200.0, 0.0], [0.0, -200.0, 0.0], [100.0, 0.0, 0.0]])
V = np.array([[0.0, 0.0, 0.0], [-50.0 * N, 0.0, 0.0], [0.0, -200.0 * N, 0.0]])
"""At rest on the orbit; an ellipse that ends at the target; the closed ellipse of 100 m."""


def test_coasting_flights():
    safety = passive_safety(flown(P, V, np.zeros((5, 6))))
    assert safety.distance == pytest.approx([200.0, 0.0, 100.0], abs=0.03)
    assert safety.unsafe.tolist() == safety.unsafe_start.tolist() == [False, True, False]
    # Half an orbit leads to the target, a quarter does not.
    assert passive_safety(flown(P, V, np.zeros((5, 6))), 1400.0).unsafe.tolist() == [False] * 3


def test_a_burn_is_unsafe_in_its_midst():
    # Radial burns of 10 s change the velocity by up to 0.2 m/s. From 200 m behind, an ellipse of half width u / n
    # is 200 - 4 u / n from the target at its end: shut after 2.8 s of 10 it ends there; the whole burn passes it.
    craft = load_spacecraft("vbar-chaser")
    inward = int(np.argmin([thruster.direction[0] for thruster in craft.thrusters]))
    command = np.zeros((1, 6))
    command[0, inward] = 1.0
    safety = passive_safety(flown(P[:1], V[:1], command))
    assert safety.distance[0] < 0.1
    assert not safety.unsafe_start[0]
    after = passive_safety(flown(P[:1], V[:1] - np.array([0.2, 0.0, 0.0]), np.zeros((1, 6))))
    assert after.distance[0] > 100.0


def test_an_unsafe_start_is_counted_after_the_first_period():
    craft = load_spacecraft("vbar-chaser")
    outward = int(np.argmax([thruster.direction[0] for thruster in craft.thrusters]))
    command = np.zeros((1, 6))
    # Stops what would lead to the target.
    command[0, outward] = 50.0 * N / 0.2
    safety = passive_safety(flown(P[1:2], V[1:2], command))
    assert safety.unsafe_start[0]
    assert not safety.unsafe[0]
    assert safety.distance[0] == pytest.approx(200.0, abs=5.0)


def test_instants_within_the_approach_do_not_count():
    flight = flown(P[1:2], V[1:2], np.zeros((7, 6)), 300.0)
    near = np.asarray(flight.states.p.norm())[:, 0]
    crossed = int(np.argmax(near < 150.0))
    assert crossed > 1
    # The last coast that counts begins at the end of the last period outside 150 m, and lasts for one period.
    safety = passive_safety(flight, 300.0, CoastZone(20.0, 150.0))
    assert safety.distance[0] == pytest.approx(near[crossed + 1], abs=0.1)
    assert passive_safety(flight, 300.0, CoastZone(20.0, 10.0)).distance[0] < near[-1]


def test_metrics_have_it_and_other_tasks_do_not():
    metrics = measure(flown(P, V, np.zeros((5, 6))))
    assert metrics["unsafe coasts"].value == pytest.approx(100.0 / 3.0)
    assert metrics["coast distance"].value == pytest.approx(0.0, abs=0.02)
    craft, task = load_spacecraft("floating-platform"), rans.Avoid()
    starts, timing = scenarios(task, craft, 1, 1), replace(task.timing, episode_steps=1)
    flight = fly(craft, task, Script(np.zeros((1, 1, 8))), starts, timing)
    with pytest.raises(ConfigError, match="Avoid"):
        passive_safety(flight)
