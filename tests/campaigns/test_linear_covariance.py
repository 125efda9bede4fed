"""Linear covariance agrees with flights of a simulation that is written here, and with those of the engine."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from campaigns.linear_covariance import linear_covariance, spread
from rans.model.drift import ClohessyWiltshire
from rans.model.spacecraft_file import load_spacecraft
from rans.randomization.conditions import (
    BodyConditions,
    Conditions,
    DisturbanceConditions,
    SensorConditions,
    SensorsConditions,
    ThrusterConditions,
)
from tests.support.clohessy_wiltshire import orbit_rates

N = 0.0011068
PERIOD, STEPS, FLIGHTS = 10.0, 30, 4000
MASS, THRUST = 500.0, 10.0
SIDES = np.concatenate([[axis, -axis] for axis in np.eye(3)])
"""Directions of the thrusters of vbar-chaser: x, -x, y, -y, z, -z."""
START = np.array([6.0, -9.0, 4.0, 0.0, 0.0, 0.0])
ERRORS = Conditions(
    body=BodyConditions(mass=(0.95, 1.05)),
    thrusters=ThrusterConditions(thrust=(0.95, 1.05), command_delay=(0.0, 2.0)),
    disturbances=DisturbanceConditions(force=(0.0, 0.02)),
    sensors=SensorsConditions(
        position=SensorConditions(noise=0.1, bias=(0.0, 0.2)),
        velocity=SensorConditions(noise=0.002, bias=(0.0, 0.001)),
    ),
)


def law(states: np.ndarray) -> np.ndarray:
    """Commands that pull to the origin with a damped period of some minutes."""
    push = -(2e-4 * states[:, :3] + 2.4e-2 * states[:, 3:]) * MASS / THRUST
    return np.maximum(push @ SIDES.T, 0.0)


def exponential(times: np.ndarray) -> np.ndarray:
    """Effect of a state and of a constant acceleration after times (K,), (K, 6, 9)."""
    return expm(orbit_rates(N) * times[:, None, None])[:, :6]


def simulated() -> np.ndarray:
    """Spread (T + 1, 2) of flights with all errors."""
    random = np.random.default_rng(1)
    gains = random.uniform(0.95, 1.05, (FLIGHTS, 6))
    mass = MASS * random.uniform(0.95, 1.05, (FLIGHTS, 1))
    late = random.uniform(0.0, 2.0, FLIGHTS)

    def anywhere(largest: float) -> np.ndarray:
        way = random.normal(size=(FLIGHTS, 3))
        size = random.uniform(0.0, largest, (FLIGHTS, 1))
        return size * way / np.linalg.norm(way, axis=1, keepdims=True)

    bias = np.concatenate([anywhere(0.2), anywhere(0.001)], axis=1)
    force = anywhere(0.02)
    before, after = exponential(late), exponential(PERIOD - late)
    x = np.tile(START, (FLIGHTS, 1))
    last = np.zeros((FLIGHTS, 3))
    states = [x]
    for _ in range(STEPS):
        noise = random.normal(size=(FLIGHTS, 6)) * np.repeat([0.1, 0.002], 3)
        push = (law(x + bias + noise) * gains * THRUST) @ SIDES
        for matrix, thrust in ((before, last), (after, push)):
            whole = np.concatenate([x, (thrust + force) / mass], axis=1)
            x = np.einsum("kij,kj->ki", matrix, whole)
        last = push
        states.append(x)
    apart = np.array(states) - np.mean(states, axis=1, keepdims=True)
    square = (apart**2).mean(axis=1)
    return np.sqrt(np.stack([square[:, :3].sum(axis=1), square[:, 3:].sum(axis=1)], axis=1))


def test_spreads_are_those_of_a_simulation() -> None:
    """4,000 flights know a spread to 1 %; products of two errors add up to some percent more."""
    craft = load_spacecraft("vbar-chaser")
    covariance = linear_covariance(craft, ClohessyWiltshire(N), law, START, PERIOD, STEPS, ERRORS)
    linear, flights = spread(covariance.all), simulated()
    assert linear[1:] == pytest.approx(flights[1:], rel=0.05)
    # The delay moves the first burn at once, and none of the errors is left out.
    assert all(spread(one)[-1].min() > 0.0 for one in covariance.sources.values())


def test_spreads_are_those_of_flights_of_the_engine() -> None:
    file = Path(__file__).parents[2] / "docs" / "validation" / "error-sources.json"
    rows: dict[str, Any] = json.loads(file.read_text("utf-8"))["linear"]["rows"]
    assert len(rows) == 7
    for row in rows.values():
        assert row["linear"] == pytest.approx(row["flights"], rel=0.05)
