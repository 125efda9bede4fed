"""Approach inside a cone: transfers arrive, brake to the tolerance, and stay inside."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rans_missions.guidance.cone_approach import ConeApproach, unbraked

from rans.model.drift import ClohessyWiltshire
from rans.model.fields import Vec3

N = 7.2922e-5
DRIFT = ClohessyWiltshire(N)
SLOPE = math.tan(math.radians(29.0))


def approach(p: tuple[float, ...], v: tuple[float, ...], left: float) -> ConeApproach:
    zero = np.zeros(1)
    place, speed = (Vec3(*(zero + x for x in one)) for one in (p, v))
    goal = Vec3(zero, zero, zero)
    return ConeApproach(N, place, speed, goal, zero + left, 50.0, 0.05, SLOPE, 98.0, 2.0)


def flown(p: tuple[float, ...], left: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities after every period; a burn is an impulse in the middle of its period."""
    state = Vec3(*(np.array([x]) for x in p)), Vec3(*(np.zeros(1) for _ in p))
    places, speeds = [], []
    while left > 0.0:
        p, v = (tuple(float(x[0]) for x in one.columns()) for one in state)
        burn = approach(p, v, left).burn()
        place, speed = DRIFT.carry(*state, 25.0)
        state = DRIFT.carry(place, speed + burn, 25.0)
        left -= 50.0
        places.append([float(x[0]) for x in state[0].columns()])
        speeds.append([float(x[0]) for x in state[1].columns()])
    return np.array(places), np.array(speeds)


@pytest.mark.parametrize(
    ("start", "left"),
    [
        ((-465.0, -200.0, 60.0), 6000.0),
        ((-465.0, 200.0, 60.0), 6000.0),
        ((-896.7, 190.5, 352.8), 10000.0),
    ],
)
def test_it_arrives_inside_the_cone(start, left):
    """With 200 m beside the axis at 465 m the cheapest transfer comes from outside.

    The last start needs the earliest of `BURN_TIMES`.
    """
    places, speeds = flown(start, left)
    assert np.linalg.norm(places[-1]) < 0.5
    assert np.linalg.norm(speeds[-1]) <= 0.05 + 1e-6
    near = places[np.linalg.norm(places - [2.0, 0.0, 0.0], axis=1) < 100.0]
    assert len(near) > 5
    across = np.linalg.norm(near[:, 1:], axis=1)
    assert np.all(across < (2.0 - near[:, 0]) * math.tan(math.radians(30.0)))


def test_what_is_not_braked_is_the_best_of_a_grid():
    """A grid of velocities within the speed costs no less, with one, two and three components braked."""
    grid = np.linspace(0.0, 0.05, 21)
    ends = np.stack(np.meshgrid(grid, grid, grid), axis=-1).reshape(-1, 3)
    ends = ends[np.linalg.norm(ends, axis=1) <= 0.05]
    for velocity in ([0.1, 0.01, 0.005], [0.02, -0.1, 0.2], [0.3, 0.1, -0.2]):
        size = unbraked(Vec3(*(np.array([x]) for x in velocity)), 0.05)[0]
        left = np.minimum(np.abs(velocity), size)
        assert np.linalg.norm(left) == pytest.approx(0.05, abs=1e-9)
        best = np.abs(np.abs(velocity) - ends).sum(axis=1).min()
        ours = np.abs(np.abs(velocity) - left).sum()
        assert ours <= best + 1e-9
