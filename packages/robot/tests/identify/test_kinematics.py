"""Rates that agree with attitudes, and accelerations of wheels, of motions in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rans_robot.identify import kinematics, momentum
from rans_robot.identify.kinematics import accelerations, with_smooth_rates
from rans_robot.identify.log import FlightLog
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.transform import Rotation

AXIS = np.array([0.48, -0.6, 0.64])
NOISE = 2e-3
"""rad/s, of rates."""


def swinging(times: np.ndarray, tilt: float = 2e-4, seed: int = 4) -> tuple[FlightLog, np.ndarray]:
    """A log of a turn about one axis at up to 4 degrees/s, with attitudes better than rates, and its true rates."""
    random = np.random.default_rng(seed)
    angle = 0.03 * times - 0.8 * (np.cos(0.05 * times) - 1.0)
    rates = np.outer(0.03 + 0.04 * np.sin(0.05 * times), AXIS)
    read = Rotation.from_rotvec(np.outer(angle, AXIS))
    read = read * Rotation.from_rotvec(random.normal(0.0, tilt, rates.shape))
    nothing = np.full_like(rates, np.nan)
    log = FlightLog(
        "swinging",
        np.empty(0),
        np.empty((0, 3)),
        times,
        nothing,
        read.as_quat()[:, [3, 0, 1, 2]],
        nothing,
        rates + random.normal(0.0, NOISE, rates.shape),
        np.zeros_like(rates),
    )
    return log, rates


def off(log: FlightLog, rates: np.ndarray) -> float:
    return float(np.sqrt(np.mean((log.spin - rates) ** 2)))


def test_attitudes_make_rates_three_times_as_good() -> None:
    """Two attitudes 2 s apart say the mean rate to 1.4e-4 rad/s; errors of changing signs stay."""
    log, rates = swinging(np.arange(0.0, 300.0, 2.0))
    assert off(log, rates) == pytest.approx(NOISE, rel=0.1)
    assert off(with_smooth_rates(log), rates) < 0.37 * NOISE
    clean = replace(log, spin=rates)
    assert off(with_smooth_rates(clean), rates) < 0.001 * NOISE


@pytest.mark.parametrize("what", ["attitude", "rate"])
def test_a_wrong_row_does_not_spread(what: str) -> None:
    log, rates = swinging(np.arange(0.0, 300.0, 2.0))
    if what == "rate":
        spin = log.spin.copy()
        spin[70] += 0.1
        wrong = replace(log, spin=spin)
        rates = np.where(np.arange(len(rates))[:, None] == 70, rates + 0.1, rates)
    else:
        attitude = log.attitude.copy()
        attitude[70] = attitude[40]
        wrong = replace(log, attitude=attitude)
    assert off(with_smooth_rates(wrong), rates) < 0.45 * NOISE


def test_rows_of_two_goals_and_of_a_long_gap_are_not_linked() -> None:
    """Attitudes of the second half are relative to another goal, and 200 s have no row."""
    times = np.concatenate([np.arange(0.0, 150.0, 2.0), np.arange(350.0, 500.0, 2.0)])
    log, rates = swinging(times)
    goal = Rotation.from_euler("xyz", [1.0, -0.4, 2.0])
    turned = goal * Rotation.from_quat(log.attitude[40:, [1, 2, 3, 0]])
    attitude = np.concatenate([log.attitude[:40], turned.as_quat()[:, [3, 0, 1, 2]]])
    frames = (np.arange(len(times)) >= 40).astype(int)
    again = with_smooth_rates(replace(log, attitude=attitude, frames=frames))
    assert off(again, rates) < 0.37 * NOISE


def test_readings_that_are_missing_stay_missing() -> None:
    log, rates = swinging(np.arange(0.0, 300.0, 2.0))
    spin = log.spin.copy()
    spin[::5] = np.nan
    again = with_smooth_rates(replace(log, spin=spin))
    read = np.isfinite(again.spin).all(axis=1)
    assert read.tolist() == [k % 5 != 0 for k in range(len(rates))]
    assert np.sqrt(np.mean((again.spin - rates)[read] ** 2)) < 0.37 * NOISE


def test_the_likelihood_is_that_of_the_dense_covariance() -> None:
    """The covariance of a wheel's speeds is written out; a flat start is a large variance in both likelihoods."""
    random = np.random.default_rng(1)
    times = np.cumsum(random.uniform(0.5, 2.0, 12))
    speeds = np.cumsum(random.normal(0.0, 2.0, (12, 1)), axis=0)
    early, late = np.minimum.outer(times, times), np.maximum.outer(times, times)

    def dense(noise: float, change: float) -> float:
        # Twice integrated Brownian motion from time 0, with a start and a slope that are free.
        covariance = change**2 * early**2 * (3.0 * late - early) / 6.0
        covariance += 1e8 + kinematics._LARGEST_ACCELERATION**2 * np.outer(times, times)
        covariance += noise**2 * np.eye(12)
        factor = cho_factor(covariance)
        square = float((speeds.T @ cho_solve(factor, speeds))[0, 0])
        return square + 2.0 * float(np.log(np.diag(factor[0])).sum())

    pairs = [(0.3, 0.5), (1.0, 0.5), (0.3, 2.0)]
    own = [kinematics._spline(times, speeds, *pair)[0] for pair in pairs]
    expected = [dense(*pair) for pair in pairs]
    assert np.diff(own) == pytest.approx(np.diff(expected), abs=0.05)


def test_accelerations_are_those_under_the_noise() -> None:
    """Differences of speeds that err by 0.5 rad/s are off by 0.18 rad/s^2."""
    random = np.random.default_rng(0)
    times = np.arange(0.0, 300.0, 2.0)
    clean = np.stack([40.0 * np.sin(0.05 * times), 30.0 * np.cos(0.08 * times)], axis=1)
    true = np.stack([2.0 * np.cos(0.05 * times), -2.4 * np.sin(0.08 * times)], axis=1)
    noisy = clean + random.normal(0.0, 0.5, clean.shape)
    assert np.std(np.gradient(noisy, times, axis=0) - true) > 0.15
    assert np.std(accelerations(times, noisy) - true) < 0.13
    # Of exact speeds nothing is smoothed away.
    assert np.std(accelerations(times, clean) - true) < 0.01


def test_a_fit_computes_with_them() -> None:
    """What a fit takes for rates and accelerations, and for the noise of the rates."""
    times = np.arange(0.0, 300.0, 2.0)
    log, rates = swinging(times)
    random = np.random.default_rng(2)
    speeds = 40.0 * np.sin(0.05 * times)[:, None] + random.normal(0.0, 0.5, (len(times), 3))
    true = np.tile(2.0 * np.cos(0.05 * times)[:, None], (1, 3))
    rows = momentum._Rows(replace(log, wheel_speeds=speeds), 1.0)
    assert np.sqrt(np.mean((rows.rates - rates) ** 2)) < 0.37 * NOISE
    assert rows.rates + rows.smoothed == pytest.approx(log.spin)
    assert np.std(rows.acceleration - true) < 0.6 * np.std(
        np.gradient(speeds, times, axis=0) - true
    )
