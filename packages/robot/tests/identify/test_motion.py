"""Predicted motion against hand-worked integrals and against the engine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rans_robot.identify.fit import WINDOW, fit, parameters_of, physics_of
from rans_robot.identify.log import FlightLog
from rans_robot.identify.motion import Thrust, predicted
from rans_robot.identify.result import Identification
from scipy.integrate import solve_ivp

from campaigns.identification import hidden_flights
from rans import SensorsConditions
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


def log_of(commands: np.ndarray, period: float = 0.5) -> FlightLog:
    times = np.arange(len(commands)) * period
    still = np.zeros((len(commands), 2))
    return FlightLog("log", times, commands, times, still, still[:, 0], still, still[:, 0])


def test_a_delayed_ramp_delivers_what_is_worked_by_hand():
    """Open from 0.5 s on, 0.1 s late, with a rise of 0.2 s: half of the rise is lost, then every second counts."""
    commands = np.zeros((6, 8))
    commands[1:, 3] = 1.0
    thrust = Thrust.of(PLATFORM, [log_of(commands)])
    late = np.array([[0.1]])
    ramp = np.array([[0.2]])
    at = thrust.delivered(np.array([[0.55, 0.6, 0.7, 0.8, 2.0]]), late, ramp)[0, :, 3]
    assert at == pytest.approx([0.0, 0.0, 0.025, 0.1, 1.3], abs=1e-12)
    assert thrust.delivered(np.array([[2.0]]), late, ramp)[0, 0, 0] == 0.0


def test_a_pulse_is_part_of_its_period():
    craft = load_spacecraft("atmos")
    commands = np.zeros((5, len(craft.commands)))
    commands[1, 0] = 0.3
    thrust = Thrust.of(craft, [log_of(commands, 0.1)])
    none = np.zeros((1, 1))
    # 0.3 of a period of 0.1 s, in a pulse at its beginning.
    delivered = thrust.delivered(np.array([[0.1, 0.115, 0.13, 0.4]]), none, none)[0, :, 0]
    assert delivered == pytest.approx([0.0, 0.015, 0.03, 0.03], abs=1e-9)


@pytest.mark.parametrize("name", ["floating-platform", "free-flyer"])
def test_the_prediction_is_the_engine_s_motion(name):
    """The engine has other equations of valves and of motion; its readings have noise of 5 mm and 0.5 degrees."""
    craft = load_spacecraft(name)
    logs, truth = hidden_flights(craft, 2, 6.0, 0.2, seed=3)
    width = 6 if craft.dimension == 2 else 13
    for log, values in zip(logs, truth, strict=True):
        columns = np.column_stack([log.position, log.attitude, log.velocity, log.spin])
        path = predicted(
            craft,
            Thrust.of(craft, [log]),
            physics_of(craft, values[None]),
            columns[:1],
            log.times[None],
        )[0]
        assert path.shape == (30, width)
        # Six seconds multiply the start's error of 1 cm/s to 6 cm, and 0.5 deg/s to 3 degrees, three times of each.
        assert np.abs(path[:, : craft.dimension] - log.position).max() < 0.2
        spin = path[:, -1 if craft.dimension == 2 else slice(-3, None)]
        assert np.abs(spin - log.spin).max() < 0.1


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
    """Of 21 spins each, 16 numbers of the craft take a third. 252 of them tell the noise to 6 %."""
    logs, _ = hidden_flights(PLATFORM, 12, 4.2, 0.2, seed=5)
    variances = [fit(PLATFORM, [log], window=4.2).noise["spin"] ** 2 for log in logs]
    assert np.sqrt(np.mean(variances)) == pytest.approx(0.00873, rel=0.12)


@pytest.mark.slow
def test_windows_grow_while_the_model_is_right():
    """A planted error: the log is of a craft whose first two thrusters are exchanged."""
    (log,), (values,) = hidden_flights(PLATFORM, 1, 20.0, 0.2, seed=5)
    found = fit(PLATFORM, [log])
    assert found.window == 20.0
    short = fit(PLATFORM, [log], window=5.0)
    assert np.median(found.deviations[:8] / short.deviations[:8]) < 0.8
    error = found.values - values
    # Errors weighed by their covariance: 16 squares, below 39.3 in 999 of 1,000 samples.
    assert float(error @ np.linalg.solve(found.covariance, error)) < 39.3
    assert "too narrow" not in " ".join(Identification(found).notes())
    # The readings' noise is 0.0087 rad; a torque of 0.3 N m of the wrong sign turns by more in a window.
    wrong = fit(PLATFORM, [replace(log, commands=log.commands[:, [1, 0, *range(2, 8)]])])
    assert wrong.noise["attitude"] > 0.03
    assert wrong.window == WINDOW


def test_readings_between_kinks_are_exact():
    """A thruster that opens at once in every second period: velocities have kinks at readings."""
    commands = np.zeros((9, 8))
    forward = np.flatnonzero(np.array(PLATFORM.wrench_map)[:, 0] > 0.0)[:1]
    commands[::2, forward] = 1.0
    log = log_of(commands, 0.125)
    physics = physics_of(PLATFORM, np.array([one.nominal for one in parameters_of(PLATFORM)])[None])
    path = predicted(
        PLATFORM, Thrust.of(PLATFORM, [log]), physics, np.zeros((1, 6)), log.times[None]
    )
    turned = PLATFORM.wrench_map[int(forward[0])][2] / PLATFORM.inertia[2][2] * 0.125
    assert path[0, :, 5] == pytest.approx(
        turned * (np.arange(10) // 2 + np.arange(10) % 2)[:9], abs=1e-9
    )


def test_intervals_of_a_log_without_noise_hold_the_truth():
    """Errors of the prediction are 1e-4 of its numbers. A fit that came to no rise stayed there, 30 ms off."""
    lab = load_conditions("lab")
    perfect = replace(lab, body=replace(lab.body, mass=1.0), sensors=SensorsConditions())
    (log,), (values,) = hidden_flights(PLATFORM, 1, 15.0, 0.2, seed=11, conditions=perfect)
    found = fit(PLATFORM, [log])
    error = found.values - values
    # Errors weighed by their covariance: 16 squares, below 39.3 in 999 of 1,000 samples.
    assert float(error @ np.linalg.solve(found.covariance, error)) < 39.3
    assert np.abs(error[-2:]).max() < 5e-3


@pytest.mark.parametrize("spin", [0.0, 1.0])
def test_a_turning_craft_is_pushed_as_scipy_says(spin):
    """One thruster for a second, and a torque of 0.1 N m: the error is of third order in the turn of a step."""
    commands = np.zeros((3, 8))
    commands[:2, 0] = 1.0
    nominal = physics_of(PLATFORM, np.array([one.nominal for one in parameters_of(PLATFORM)])[None])
    twist = replace(nominal.disturbance, torque=np.full((1, 1), 0.1))
    start = np.array([[0.0, 0.0, 0.3, 0.0, 0.0, spin]])
    log = log_of(commands)
    path = predicted(
        PLATFORM,
        Thrust.of(PLATFORM, [log]),
        replace(nominal, disturbance=twist),
        start,
        log.times[None],
    )
    fx, fy, torque = PLATFORM.wrench_map[0]

    def rates(_: float, y: np.ndarray) -> list[float]:
        _, _, angle, vx, vy, w = y
        c, s = np.cos(angle), np.sin(angle)
        push = (c * fx - s * fy) / PLATFORM.mass, (s * fx + c * fy) / PLATFORM.mass
        return [vx, vy, w, *push, (torque + 0.1) / PLATFORM.inertia[2][2]]

    end = solve_ivp(rates, (0.0, 1.0), start[0], rtol=1e-10, atol=1e-12).y[:, -1]
    # Steps of 0.02 rad: 2e-5 of the thrust.
    np.testing.assert_allclose(path[0, 2], end, rtol=0, atol=1e-5)
