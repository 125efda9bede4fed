"""Rates that agree with attitudes, and accelerations of wheels, of motions in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rans_robot.identify import kinematics, momentum
from rans_robot.identify.kinematics import accelerations, smoothed
from rans_robot.identify.log import FlightLog
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.spatial.transform import Rotation

from rans.extend import Spacecraft, load_spacecraft

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
    assert off(smoothed(log)[0], rates) < 0.37 * NOISE
    clean = replace(log, spin=rates)
    assert off(smoothed(clean)[0], rates) < 0.001 * NOISE


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
    assert off(smoothed(wrong)[0], rates) < 0.45 * NOISE


def test_rows_of_two_goals_and_of_a_long_gap_are_not_linked() -> None:
    """Attitudes of the second half are relative to another goal, and 200 s have no row."""
    times = np.concatenate([np.arange(0.0, 150.0, 2.0), np.arange(350.0, 500.0, 2.0)])
    log, rates = swinging(times)
    goal = Rotation.from_euler("xyz", [1.0, -0.4, 2.0])
    turned = goal * Rotation.from_quat(log.attitude[40:, [1, 2, 3, 0]])
    attitude = np.concatenate([log.attitude[:40], turned.as_quat()[:, [3, 0, 1, 2]]])
    frames = (np.arange(len(times)) >= 40).astype(int)
    again = smoothed(replace(log, attitude=attitude, frames=frames))[0]
    assert off(again, rates) < 0.37 * NOISE


def test_readings_that_are_missing_stay_missing() -> None:
    log, rates = swinging(np.arange(0.0, 300.0, 2.0))
    spin = log.spin.copy()
    spin[::5] = np.nan
    again = smoothed(replace(log, spin=spin))[0]
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


def test_spreads_are_those_of_the_readings() -> None:
    """The first step of a search that is as long as its slope ends at bounds, where nothing can be solved."""
    log, _ = swinging(np.arange(0.0, 400.0), tilt=5e-4)
    spreads = smoothed(log)[1].spreads
    assert spreads[0] == pytest.approx(5e-4, rel=0.2)
    assert spreads[1] == pytest.approx(NOISE, rel=0.2)


def test_rows_far_apart_are_linked_by_the_course_of_the_spin() -> None:
    """Exact readings every 4 s: the rule of the trapezium alone is off by 0.8 mrad, and changes rates by more."""
    log, rates = swinging(np.arange(0.0, 300.0, 4.0), tilt=1e-6)
    assert off(smoothed(replace(log, spin=rates))[0], rates) < 1e-5


def test_intervals_of_torques_have_the_joint_covariance_of_rates_and_attitudes() -> None:
    """The middle of the sandwich is that of the dense covariance of all momenta."""
    craft = load_spacecraft("innocube")
    random = np.random.default_rng(6)
    log, _ = swinging(np.cumsum(random.uniform(1.0, 3.0, 14)), tilt=1e-3)
    speeds = 40.0 * np.sin(0.05 * log.times[:, None] + [0.0, 1.0, 2.0])
    nominal = np.append(momentum_values(craft), [0.05, 0.02])
    prior = np.maximum(0.3 * np.abs(nominal), 1e-3)
    model = momentum._Momentum(craft, [replace(log, wheel_speeds=speeds)], nominal, prior)
    (rows,) = model.rows
    values = model.nominal
    spread = {one.name: one.first for one in momentum._SPREADS}
    linear = momentum._Linear(model, values, spread, [model.derivatives(rows, values)])

    # Errors of the momenta by rotation vector and rate, by differences.
    read = model.momentum(rows, values)[0]
    by_readings = np.zeros((14, 3, 7))
    for k in range(3):
        turn = Rotation.from_rotvec(1e-6 * np.eye(3)[k])
        by_readings[:, :, k] = -(turn.apply(read) - read) / 1e-6
        by_readings[:, :, 3 + k] = model.tensor(values)[:, k]
    # All covariances dense: of the links, and of rows by themselves as the fit has them, of which wheels stay.
    blocks, beside, _, _, _ = rows.links.equations(rows.links.spreads)
    normal = block_diag(*blocks)
    for k, block in enumerate(beside):
        normal[7 * k + 7 : 7 * k + 14, 7 * k : 7 * k + 7] = block
        normal[7 * k : 7 * k + 7, 7 * k + 7 : 7 * k + 14] = block.T
    joint = np.linalg.inv(np.asarray(normal))
    alone = [
        block_diag(
            spread["attitude"] ** 2 * np.eye(3)
            + spread["jitter of attitudes"] ** 2 * np.outer(rate, rate),
            spread["spin"] ** 2 * np.eye(3),
            0.0,
        )
        for rate in rows.rates
    ]
    A = np.asarray(block_diag(*by_readings))
    whitening = np.asarray(block_diag(*(model.whitening(rows, values, spread)[0] @ rows.rotation)))
    covariance = np.linalg.inv(np.asarray(whitening.T @ whitening))
    covariance += A @ (joint - np.asarray(block_diag(*alone))) @ A.T
    _, D, X, _, _, _ = linear.parts[0]
    columns = np.concatenate([X, -D], axis=1)
    middle = columns.T @ whitening @ covariance @ whitening.T @ columns
    found = columns.T @ columns + momentum._joint(model, values, linear, 0)
    scale = np.sqrt(np.outer(np.diag(middle), np.diag(middle)))
    np.testing.assert_allclose(found / scale, middle / scale, rtol=0.0, atol=1e-5)
    # Errors that alternate: the sum of all is far smaller than that of independent ones.
    assert np.all(np.diag(middle)[:3] < 0.5 * np.diag(columns.T @ columns)[:3])


def momentum_values(craft: Spacecraft) -> np.ndarray:
    """Moments and products of inertia, and inertias of wheels."""
    inertia = np.array(craft.inertia)
    return np.append(
        inertia[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]], [wheel.inertia for wheel in craft.wheels]
    )
