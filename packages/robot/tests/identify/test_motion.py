"""Predicted motion against hand-worked integrals, and fits of hidden craft that the engine flew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rans_robot.identify.fit import LEAST_NOISE, fit, parameters_of
from rans_robot.identify.log import FlightLog
from rans_robot.identify.motion import changes_of, impulses, integrals_of
from rans_robot.identify.result import Identification
from scipy.stats import chi2

from campaigns.identification import hidden_flights
from rans import SensorsConditions, Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.randomization.conditions_file import load_conditions

PLATFORM = load_spacecraft("floating-platform")


@pytest.mark.parametrize("name", ["floating-platform", "free-flyer", "afrl-12kg"])
def test_every_quantity_has_a_prior(name):
    """Also where all thrusters push through the centre of mass, as those of afrl-12kg: 0.5 of 1 N at 0.2 m."""
    craft = replace(load_spacecraft(name), wheels=())
    parameters = {one.name: one for one in parameters_of(craft)}
    assert all(one.prior > 0.0 for one in parameters.values())
    if name == "afrl-12kg":
        assert parameters["torque x"].prior == pytest.approx(0.1)


def delivered(
    craft: Spacecraft,
    commands: np.ndarray,
    period: float,
    at: list[float],
    late: float,
    rise: float,
) -> np.ndarray:
    """Seconds of full force (T, n) that thrusters gave until times."""
    times = np.arange(len(commands)) * period
    still = np.zeros((len(commands), 2))
    log = FlightLog("log", times, commands, times, still, still[:, 0], still, still[:, 0])
    window = integrals_of(changes_of(craft, log), 0.0, times[-1])
    return impulses([window], np.array([at]), late, rise)[0, 0]


def test_a_delayed_ramp_delivers_what_is_worked_by_hand():
    """Open from 0.5 s on, 0.1 s late, with a rise of 0.2 s: half of the rise is lost, then every second counts."""
    commands = np.zeros((6, 8))
    commands[1:, 3] = 1.0
    by_then = delivered(PLATFORM, commands, 0.5, [0.55, 0.6, 0.7, 0.8, 2.0], 0.1, 0.2)
    assert by_then[:, 3] == pytest.approx([0.0, 0.0, 0.025, 0.1, 1.3], abs=1e-12)
    assert by_then[-1, 0] == 0.0
    # A rise of no time.
    assert delivered(PLATFORM, commands, 0.5, [0.7], 0.1, 0.0)[0, 3] == pytest.approx(0.1)


def test_a_pulse_is_part_of_its_period():
    """0.3 of a period of 0.1 s, in a pulse at its beginning."""
    craft = load_spacecraft("atmos")
    commands = np.zeros((5, len(craft.commands)))
    commands[1, 0] = 0.3
    by_then = delivered(craft, commands, 0.1, [0.1, 0.115, 0.13, 0.4], 0.0, 0.0)[:, 0]
    # A rise of no time counts as one of 1 ms, so that half a millisecond of the second time is in it.
    assert by_then == pytest.approx([0.0, 0.015, 0.03, 0.03], abs=2e-4)


def test_hidden_craft_are_found_within_their_intervals():
    """Errors weighed by their covariance: the sum of 32 squares, below 62.5 in 999 of 1,000 samples."""
    logs, truth = hidden_flights(PLATFORM, 2, 15.0, 0.2, seed=11)
    squares = 0.0
    for log, values in zip(logs, truth, strict=True):
        found = fit(PLATFORM, [log])
        error = found.values - values
        squares += float(error @ np.linalg.solve(found.covariance, error))
        forces = found.values[:8] / values[:8]
        assert np.abs(forces - 1.0).max() < 0.15
        assert found.noise["position"] == pytest.approx(0.005, rel=0.25)
    assert squares < 62.5


def test_windows_of_two_readings_leave_the_noise_of_each_channel_to_itself():
    """Starts then fit more of the positions than of the velocities. 100 readings tell the noise to 10 %.

    With degrees of freedom divided among the channels as the readings are, that of positions became 0.17 mm.
    """
    quiet = replace(load_conditions("lab"), sensors=load_conditions("real-space").sensors)
    quiet = replace(quiet, body=replace(quiet.body, mass=1.0))
    (log,), _ = hidden_flights(PLATFORM, 1, 20.0, 0.4, 7, quiet)
    noise = fit(PLATFORM, [log], window=0.8).noise
    assert noise["position"] == pytest.approx(0.001, rel=0.3)
    assert noise["velocity"] == pytest.approx(0.003, rel=0.3)


def test_what_is_fitted_takes_degrees_of_freedom_of_its_channel():
    """16 numbers of the craft explain a third of 21 spins; 252 spins estimate the noise to 6 %."""
    logs, _ = hidden_flights(PLATFORM, 12, 4.2, 0.2, seed=5)
    variances = [fit(PLATFORM, [log], window=4.2).noise["spin"] ** 2 for log in logs]
    assert np.sqrt(np.mean(variances)) == pytest.approx(0.00873, rel=0.12)


@pytest.mark.slow
def test_windows_grow_while_the_model_is_right():
    (log,), (values,) = hidden_flights(PLATFORM, 1, 20.0, 0.2, seed=5)
    found = fit(PLATFORM, [log])
    assert found.window == 20.0
    short = fit(PLATFORM, [log], window=5.0)
    assert np.median(found.deviations[:8] / short.deviations[:8]) < 0.8
    error = found.values - values
    # Errors weighed by their covariance: 16 squares, below 39.3 in 999 of 1,000 samples.
    assert float(error @ np.linalg.solve(found.covariance, error)) < 39.3
    assert "too narrow" not in " ".join(Identification(found).notes())


@pytest.mark.parametrize("name", ["floating-platform", "free-flyer"])
def test_intervals_of_a_log_without_noise_hold_the_truth(name):
    """The engine has other equations of valves, and steps of its own. A fit that came to no rise stayed there."""
    craft = load_spacecraft(name)
    lab = load_conditions("lab")
    perfect = replace(lab, body=replace(lab.body, mass=1.0), sensors=SensorsConditions())
    (log,), (values,) = hidden_flights(craft, 1, 12.0, 0.2, seed=11, conditions=perfect)
    found = fit(craft, [log], window=3.0)
    error = found.values - values
    # Errors weighed by their covariance: P squares of the normal distribution.
    assert chi2.sf(error @ np.linalg.solve(found.covariance, error), len(error)) > 1e-3
    assert np.abs(error[-2:]).max() < 5e-3
    # Predictions err by no more than what counts as noise in any case.
    assert np.abs(found.residuals).max() < 4.0 * LEAST_NOISE
