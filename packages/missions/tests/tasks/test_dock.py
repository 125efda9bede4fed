"""Docking on an orbit: hand-worked motions, margins, contacts between commands, starts, and Drake."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_missions.orbits.reach import velocity_to_reach
from rans_missions.tasks import Dock
from rans_missions.tasks.orbital import Plan

from rans.episode.scenario import scenarios
from rans.episode.step import Setup, World, step
from rans.model.drift import ClohessyWiltshire
from rans.model.dynamics import SpatialState
from rans.model.fields import Vec2, Vec3, leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.reference.flight import DrakeMover
from tests.support.clohessy_wiltshire import transition
from tests.support.orbit_states import at

DEPUTY = load_spacecraft("afrl-deputy")
N = 0.001027
"""rad/s"""
TIMING = Dock.timing
SHUT = (0.0,) * 6


def notes(deadline: float) -> Plan:
    """Of a goal whose planned arrival is the deadline."""
    return Plan(np.array([deadline]), np.array([deadline]), np.zeros(1))


def world(task: Dock) -> World:
    return World(Setup(DEPUTY, task, TIMING))


def flown(task: Dock, state: SpatialState, deadline: float, mover: Any = None) -> Any:
    """What one period with shut thrusters gives."""
    goal = replace(at((0.0,) * 3, (0.0,) * 3), notes=notes(deadline))
    now = world(task).begin(state, goal)
    return step(world(task), now, SHUT, None, mover)


@pytest.mark.parametrize("time", [10.0, 600.0, 2000.0])
def test_the_velocity_to_reach_a_point_reaches_it(time):
    """By the matrix exponential, in space and in the plane."""
    rng = np.random.default_rng(1)
    here, there = rng.uniform(-100, 100, (2, 3))
    drift = ClohessyWiltshire(N)
    v = velocity_to_reach(drift, Vec3(*here), Vec3(*there), time)
    arrived = transition(N, time)[:6, :6] @ [*here, *leaves(v)]
    np.testing.assert_allclose(arrived[:3], there, atol=1e-9)
    flat = velocity_to_reach(drift, Vec2(*here[:2]), Vec2(*there[:2]), time)
    np.testing.assert_allclose(leaves(flat), leaves(v)[:2], rtol=1e-9)


def test_thrust_that_lowers_the_velocity_to_gain_costs_nothing_and_other_thrust_does():
    task = Dock(gain_weight=1.2, impulse_weight=0.1)
    here = at((0.0, -120.0, 30.0), (0.0,) * 3)
    goal = replace(at((0.0,) * 3, (0.0,) * 3), notes=notes(1000.0))
    gain = task.velocity_to_gain(here, goal, 1000.0)
    wanted = np.array(leaves(gain))[:, 0]
    now = world(task).begin(here, goal)
    # 1 N on 12 kg for 10 s gives 0.8333 m/s.
    command = np.concatenate([[max(x, 0.0), max(-x, 0.0)] for x in wanted]) / 0.8333333333333334
    good = step(world(task), now, tuple(command))
    spent = np.abs(wanted).sum()
    assert float(good.terms["impulse"]) == pytest.approx(-1.2 * spent, rel=1e-9)
    # The burn lasts 10 s of 1,000, so that half a hundredth of it is left to do.
    assert good.reward.item() == pytest.approx(0.0, abs=0.011 * 1.2 * spent)
    wrong = step(world(task), now, tuple(command[[1, 0, 3, 2, 5, 4]]))
    assert float(wrong.reward[0]) == pytest.approx(-2.4 * spent, rel=0.02)
    # Of more than 1 m/s no more is counted.
    fast = step(
        world(task), world(task).begin(at((0.0, -120.0, 30.0), (3.0,) * 3), goal), (0.0,) * 6
    )
    assert fast.terms["gain"].item() == 0.0


@pytest.mark.parametrize("mover", [None, "drake"])
def test_a_contact_between_two_commands_docks(mover):
    """From 1 m at 0.19 m/s it is within 0.5 m after 3 s, and 0.9 m beyond the target after 10 s."""
    move = None if mover is None else DrakeMover(DEPUTY, TIMING, drift=Dock().drift)
    outcome = flown(Dock(), at((0.0, -1.0, 0.0), (0.0, 0.19, 0.0)), 600.0, move)
    assert outcome.done.item()
    assert not outcome.failed.item()
    # 0.2 + 2 n (0.43 - 0.5) m/s are allowed at the third second.
    least = 0.2 + 0.002054 * (1.0 - 0.19 * 3 - 0.5) - 0.19
    assert outcome.margins["speed"].item() == pytest.approx(least, abs=2e-5)
    assert outcome.terms["done"].item() == 1.0


def test_who_is_late_has_failed():
    near = at((0.0, -1.0, 0.0), (0.0, 0.19, 0.0))
    assert flown(Dock(), near, 4.0).done.item()
    late = flown(Dock(), near, 2.0)
    assert not late.done.item()
    assert late.failed.item()
    far = at((0.0, -100.0, 0.0), (0.0, 0.0, 0.0))
    assert flown(Dock(), far, 10.0).failed.item()
    assert not flown(Dock(), far, 20.0).failed.item()
    assert flown(Dock(), at((0.0, -1001.0, 0.0), (0.0,) * 3), 900.0).failed.item()


def test_starts_are_as_documented_or_as_coded():
    """46.9 % of 64 starts of AFRL's own code were above the limit; here 4,096 are counted."""
    documented: Any = scenarios(Dock(), DEPUTY, 1, 4096)
    limits = Dock().constraints(documented.start, documented.goal)["speed"]
    assert limits.min() > 0.0
    p = np.array(leaves(documented.start.p))
    elevation = np.arcsin(p[2] / np.linalg.norm(p, axis=0))
    # Uniform from -90 to 90 degrees: a third is beyond 60 degrees, on a uniform sphere 13 % would be.
    assert np.mean(np.abs(elevation) > math.radians(60.0)) == pytest.approx(1 / 3, abs=0.03)
    assert np.mean(elevation < 0.0) == pytest.approx(0.5, abs=0.03)
    task = Dock(starts_as_coded=True)
    coded: Any = scenarios(task, DEPUTY, 1, 4096)
    assert coded.start.p.z.min() > -1e-9
    assert coded.start.v.z.min() > -1e-9
    above = np.mean(task.constraints(coded.start, coded.goal)["speed"] < 0.0)
    assert above == pytest.approx(0.469, abs=0.07)
    assert coded.goal.notes.deadline.min() >= 600.0
    assert coded.goal.notes.deadline.max() <= 2000.0
