"""The filter of positions and velocities near a target on a circular orbit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rans_missions.control.navigation_filter import STEADY_TIME, NavigationFilter

from rans.model.drift import ClohessyWiltshire
from rans.model.fields import Vec3

ORBIT = ClohessyWiltshire(0.001027)
PERIOD = 10.0
POSITION, VELOCITY = 0.05, 0.001


def flown(
    navigation: NavigationFilter,
    count: int,
    readings: int,
    share: float,
    push: float = 0.0,
    constant: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Errors (N, 6) and covariances after noisy readings, with one burn of whose size it knows up to a share.

    An acceleration (m/s^2) of this standard deviation changes as the filter expects; another one, the same along
    all axes, is constant.
    """
    random = np.random.default_rng(5)
    p, v = Vec3(*random.normal(0.0, 100.0, (3, count))), Vec3(*random.normal(0.0, 0.1, (3, count)))
    truth = mean = covariance = np.empty(0)
    drawn = push * random.normal(size=(count, 3))
    keeps = math.exp(-PERIOD / STEADY_TIME)
    for k in range(readings):
        truth = np.stack([*p.columns(), *v.columns()], axis=1)
        noise = random.normal(size=truth.shape) * np.repeat([POSITION, VELOCITY], 3)
        mean, covariance = navigation.read(truth + noise)
        burn = np.full((count, 3), 0.1 if k == readings // 2 else 0.0)
        navigation.burn(burn)
        given = burn * random.normal(1.0, share, burn.shape)
        given = given + PERIOD * (drawn + constant)
        drawn = keeps * drawn + math.sqrt(1.0 - keeps**2) * push * random.normal(size=burn.shape)
        p, v = ORBIT.carry(p, v, 0.5 * PERIOD)
        p, v = ORBIT.carry(p, v + Vec3(*given.T), 0.5 * PERIOD)
    return mean - truth, covariance


@pytest.mark.parametrize(("share", "push"), [(0.0, 0.0), (0.03, 0.0), (0.0, 3e-5)])
def test_errors_are_as_large_as_it_says(share, push):
    """The squared error, normalised by the covariance, has the mean 6: its number of components.

    Also of an acceleration that changes slowly.
    """
    navigation = NavigationFilter(ORBIT, 3, PERIOD, POSITION, VELOCITY, share, acceleration=push)
    error, covariance = flown(navigation, 400, 40, share, push=push)
    squared = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)
    # The mean of 400 chi-squared numbers with 6 degrees of freedom deviates by 0.17; five of those.
    assert abs(squared.mean() - 6.0) < 0.9


def test_a_constant_force_leads_it_astray_unless_it_expects_one():
    """1e-5 m/s^2 along each axis: in 200 readings, 20 m that a filter that trusts its equations denies."""
    squares = []
    for expected in (0.0, 1e-5):
        navigation = NavigationFilter(
            ORBIT, 3, PERIOD, POSITION, VELOCITY, 0.0, acceleration=expected
        )
        error, covariance = flown(navigation, 50, 200, 0.0, constant=1e-5)
        squared = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)
        squares.append(squared.mean())
    # Some deviations, since the force is not drawn anew; without it, hundreds.
    assert squares[1] < 6.0 * 3.0**2
    assert squares[0] > 6.0 * 30.0**2
