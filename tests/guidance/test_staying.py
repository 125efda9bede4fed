"""Staying at a goal: a craft that follows the law stays within its tolerances, and coasts between returns."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rans.guidance.staying import staying_velocity
from rans.model.drift import ClohessyWiltshire
from rans.model.fields import Vec3

DRIFT = ClohessyWiltshire(0.0011)
PERIOD = 10.0
POSITION = 5.0
VELOCITY = 0.05


def vector(*columns: Any) -> Vec3:
    return Vec3(*(np.atleast_1d(np.asarray(x, float)) for x in columns))


def flown(p: Vec3, v: Vec3, goal: Any, periods: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Largest distance and speed after each period, and the velocity change in all, by impulses at their start."""
    distances, speeds, spent = [], [], 0.0
    for _ in range(periods):
        state: Any = SimpleNamespace(p=p, v=v)
        new = staying_velocity(DRIFT, state, goal, PERIOD, POSITION, VELOCITY)
        spent += float((new - v).norm().max())
        p, v = DRIFT.carry(p, new, PERIOD)
        distances.append(float((p - goal.p).norm().max()))
        speeds.append(float(v.norm().max()))
    return np.array(distances), np.array(speeds), spent


@pytest.mark.parametrize("behind", [pytest.param(0.0, marks=pytest.mark.slow), 100.0])
def test_a_craft_stays_for_three_hours(behind: float) -> None:
    """At the target and behind it, from three states; every radial error drifts away along the track."""
    goal: Any = SimpleNamespace(p=vector(0.0, -behind, 0.0), v=vector(0.0, 0.0, 0.0))
    starts = np.array([[2.0, -2.0, 0.0], [1.0, 2.0, -3.0], [0.5, 0.0, 1.0]])
    p = vector(starts[0], starts[1] - behind, starts[2])
    v = vector([0.02, -0.03, 0.0], [0.0, 0.01, 0.03], [0.01, 0.0, 0.0])
    distances, speeds, _ = flown(p, v, goal, 1080)
    assert distances.max() < POSITION
    assert speeds.max() < VELOCITY


def test_after_a_return_it_circles_for_ever_without_burns() -> None:
    """In three orbits after the first two nothing is burnt, from any state, also with a motion along z."""
    goal: Any = SimpleNamespace(p=vector(0.0, -100.0, 0.0), v=vector(0.0, 0.0, 0.0))
    p, v = (
        vector([2.0, -2.0], [-99.0, -101.0], [0.0, 1.0]),
        vector([0.02, -0.03], [0.0, 0.01], 0.01),
    )
    orbit = round(2.0 * np.pi / DRIFT.mean_motion / PERIOD)
    for _ in range(2 * orbit):
        state: Any = SimpleNamespace(p=p, v=v)
        p, v = DRIFT.carry(
            p, staying_velocity(DRIFT, state, goal, PERIOD, POSITION, VELOCITY), PERIOD
        )
    distances, _, spent = flown(p, v, goal, 3 * orbit)
    assert distances.max() < POSITION
    assert spent == 0.0


def test_at_an_equilibrium_it_burns_nothing() -> None:
    goal: Any = SimpleNamespace(p=vector(0.0, -100.0, 0.0), v=vector(0.0, 0.0, 0.0))
    _, _, spent = flown(vector(0.0, -101.0, 0.0), vector(0.0, 0.0, 0.0), goal, 100)
    assert spent == 0.0
