"""The filter of positions and velocities near a target on a circular orbit."""

from __future__ import annotations

import numpy as np
import pytest

from rans.model.drift import ClohessyWiltshire
from rans.model.fields import Vec3
from rans.optimal.control.navigation_filter import NavigationFilter

ORBIT = ClohessyWiltshire(0.001027)
PERIOD = 10.0
POSITION, VELOCITY = 0.05, 0.001


def flown(
    navigation: NavigationFilter, count: int, readings: int, share: float, growth: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Errors (N, 6) and covariances after noisy readings, with one burn of whose size it knows up to a share.

    The noise of readings grows by a share of itself with every metre of distance.
    """
    random = np.random.default_rng(5)
    p, v = Vec3(*random.normal(0.0, 100.0, (3, count))), Vec3(*random.normal(0.0, 0.1, (3, count)))
    truth = mean = covariance = np.empty(0)
    for k in range(readings):
        truth = np.stack([*p.columns(), *v.columns()], axis=1)
        far = 1.0 + growth * np.linalg.norm(truth[:, :3], axis=1, keepdims=True)
        noise = random.normal(size=truth.shape) * np.repeat([POSITION, VELOCITY], 3) * far
        mean, covariance = navigation.read(truth + noise)
        burn = np.full((count, 3), 0.1 if k == readings // 2 else 0.0)
        navigation.burn(burn)
        given = burn * random.normal(1.0, share, burn.shape)
        p, v = ORBIT.carry(p, v, 0.5 * PERIOD)
        p, v = ORBIT.carry(p, v + Vec3(*given.T), 0.5 * PERIOD)
    return mean - truth, covariance


@pytest.mark.parametrize(("share", "growth"), [(0.0, 0.0), (0.03, 0.0), (0.0, 0.05)])
def test_errors_are_as_large_as_it_says(share: float, growth: float) -> None:
    """The squared error, normalised by the covariance, has the mean 6: its number of components."""
    grows = POSITION * growth, VELOCITY * growth
    navigation = NavigationFilter(ORBIT, 3, PERIOD, POSITION, VELOCITY, share, *grows)
    error, covariance = flown(navigation, 400, 40, share, growth)
    squared = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)
    # The mean of 400 chi-squared numbers with 6 degrees of freedom deviates by 0.17; five of those.
    assert abs(squared.mean() - 6.0) < 0.9


def test_readings_add_up() -> None:
    """Without burns 40 readings are worth many times one."""
    navigation = NavigationFilter(ORBIT, 3, PERIOD, POSITION, VELOCITY, 0.0)
    error, _ = flown(navigation, 400, 40, 0.0)
    assert error[:, 3:].std() < 0.2 * VELOCITY
    assert error[:, :3].std() < 0.5 * POSITION
