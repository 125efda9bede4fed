"""Staying at a goal: a craft that follows the law stays within its tolerances, and coasts between returns."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rans_missions.guidance.staying import circling, staying_velocity
from rans_missions.orbits.perturbed import PerturbedOrbit

from rans.model.drift import ClohessyWiltshire
from rans.model.fields import Vec3
from tests.support.clohessy_wiltshire import transition

DRIFT = ClohessyWiltshire(0.0011)
PERIOD = 10.0
POSITION = 5.0
VELOCITY = 0.05


def vector(*columns: Any) -> Vec3:
    return Vec3(*(np.atleast_1d(np.asarray(x, float)) for x in columns))


def flown(p: Vec3, v: Vec3, goal: Any, periods: int) -> tuple[Any, ...]:
    """Last state, largest distance and speed after each period, and the velocity change in all, by impulses."""
    distances, speeds, spent = [], [], 0.0
    for _ in range(periods):
        state: Any = SimpleNamespace(p=p, v=v)
        new = staying_velocity(DRIFT, state, goal, PERIOD, POSITION, VELOCITY)
        spent += float((new - v).norm().max())
        p, v = DRIFT.carry(p, new, PERIOD)
        distances.append(float((p - goal.p).norm().max()))
        speeds.append(float(v.norm().max()))
    return p, v, np.array(distances), np.array(speeds), spent


@pytest.mark.parametrize("behind", [pytest.param(0.0, marks=pytest.mark.slow), 100.0])
def test_after_a_return_it_circles_for_ever_without_burns(behind):
    """At the target and behind it a craft stays, from any state; after two orbits nothing is burnt."""
    goal = SimpleNamespace(p=vector(0.0, -behind, 0.0), v=vector(0.0, 0.0, 0.0))
    p = vector([2.0, -2.0], [1.0 - behind, -1.0 - behind], [0.0, 1.0])
    v = vector([0.02, -0.03], [0.0, 0.01], 0.01)
    orbit = round(2.0 * np.pi / DRIFT.mean_motion / PERIOD)
    for orbits, burns in ((2, True), (1, False)):
        p, v, distances, speeds, spent = flown(p, v, goal, orbits * orbit)
        assert distances.max() < POSITION
        assert speeds.max() < VELOCITY
        assert (spent > 0.0) == burns


@pytest.mark.parametrize("quarter", [0.25, 0.5, 1.0])
def test_a_closed_ellipse_is_twice_as_long_as_wide_and_closes(quarter):
    """From (a, 0) it passes (0, -2 a) after a quarter of an orbit, and comes back after a whole one."""
    n = DRIFT.mean_motion
    v = circling(n, vector(30.0, 0.0, 0.0)).columns()
    start = np.array([30.0, 0.0, 0.0, *(x[0] for x in v)])
    end = transition(n, 2.0 * np.pi / n * quarter)[:6, :6] @ start
    expected = {0.25: (0.0, -60.0), 0.5: (-30.0, 0.0), 1.0: (30.0, 0.0)}[quarter]
    np.testing.assert_allclose(end[:2], expected, atol=1e-9)


@dataclass(frozen=True)
class Moving:
    """Position and velocity of a craft."""

    p: Vec3
    v: Vec3


@pytest.mark.parametrize("push", [pytest.param(2e-6, marks=pytest.mark.slow), -8e-6])
def test_what_balances_a_force_is_its_mean_along_the_orbit(push):
    """After two orbits nothing is spent but the product of force and time, the least of any flight that stays.

    Across the orbit 2.9 m are an equilibrium of 3.5e-6 m/s^2, and 2.5 m away 4.75e-7 of these are left. Radially
    the equilibrium is 1.38 m away.
    """
    n = DRIFT.mean_motion
    goal = SimpleNamespace(p=vector(0.0, -100.0, 0.0), v=vector(0.0, 0.0, 0.0))
    acceleration = vector(-5e-6, push, 3.5e-6)
    # Radially and across it an acceleration moves W's origin, and along the orbit it is a drag.
    moved = vector(5e-6 / (3.0 * n**2), 0.0, 3.5e-6 / n**2)
    truth = PerturbedOrbit(n, 0.0, 0.0, -push, 0.0)
    p, v = vector(1.0, -100.0, 0.0), vector(0.0, 0.01, 0.01)
    orbit = round(2.0 * np.pi / n / PERIOD)
    spent = []
    for _ in range(3 * orbit):
        new = staying_velocity(DRIFT, Moving(p, v), goal, PERIOD, POSITION, VELOCITY, acceleration)
        change = new - v
        spent.append([float(abs(x)[0]) for x in change.columns()])
        # A burn in the middle of the period: in the mean as thrust all through it.
        p, v = truth.carry(p - moved, v, 0.5 * PERIOD)
        p, v = truth.carry(p, v + change, 0.5 * PERIOD)
        p = p + moved
        assert float((p - goal.p).norm()[0]) < POSITION
    last = np.sum(spent[2 * orbit :], axis=0)
    seconds = orbit * PERIOD
    assert last == pytest.approx([0.0, abs(push) * seconds, 4.75e-7 * seconds], rel=1e-6, abs=1e-9)
