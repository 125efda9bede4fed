"""The settled-gate benchmark of faulty attitude actuators (Shojaei, arXiv 2606.25374), entered end to end.

Its plant is a body of diag(10, 8, 6) kg m^2 times f with a torque of 0.2 N m about each axis, held for 0.5 s:
clip(g a + b, -1, 1) of it where -1 <= a <= 1 was asked for. Gains g of either sign, biases b and f are
drawn outside of what training may know (repository A-SHOJAEI/paper-F-settled-gate-benchmark 16b47b7b,
`program/fault_taxonomy.py`; starts from `simulation/basilisk/attitude_env.py`). A flight counts if the angle
from the goal is at most 0.2 degrees at every one of its last 20 of 400 steps.

The benchmark's own oracles are here too: they settle as often as published, which shows that the plant, the
faults and the gate are those of the benchmark. `campaigns.settled_gate_entry` is ours.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any, Literal, NamedTuple

import numpy as np

from rans.flight import Controller, fly
from rans.model.actuators import Throttle
from rans.model.body import Body
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from rans.model.spacecraft import Spacecraft, Thruster
from rans.model.timing import Timing
from rans.scenario import Scenario
from rans.tasks import GoToPose

MOMENTS = 10.0, 8.0, 6.0  # kg m^2
TORQUE = 0.2  # N m
TIMING = Timing(0.5, episode_steps=400)
GATE = math.radians(0.2)
DWELL = 20
_HEAVY = 1e9  # kg: the nozzles that stand for wheels do not move it
_FAULTS_SEED = 7000
_FAULTS = 50
_SEEDS = 10
_LEAST_GAIN = 0.3  # that the benchmark's oracles divide by

Class = Literal["sign", "gain", "gain and bias", "axis lost"]
CLASSES: tuple[Class, ...] = ("sign", "gain", "gain and bias", "axis lost")


def body_of_three_axes() -> Spacecraft:
    """Nozzles 2k and 2k + 1 turn it about axis k, to the left and to the right."""
    e = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    nozzles = tuple(
        Thruster(
            e[(k + 1) % 3], (side * e[k - 1][0], side * e[k - 1][1], side * e[k - 1][2]), TORQUE
        )
        for k in range(3)
        for side in (1.0, -1.0)
    )
    x, y, z = MOMENTS
    with warnings.catch_warnings():  # that it cannot be pushed every way
        warnings.simplefilter("ignore", UserWarning)
        return Spacecraft(
            "three axes",
            3,
            _HEAVY,
            ((x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, z)),
            nozzles,
            actuators=Throttle(),
        )


class Faults(NamedTuple):
    """Of N bodies with n axes."""

    inertia: np.ndarray
    """(N,) factor."""
    gain: np.ndarray
    """(N, n)."""
    bias: np.ndarray
    """(N, n), shares of the torque."""


def held_out(kind: Class, count: int = _FAULTS) -> Faults:
    """The benchmark's test faults of a class, by its own random numbers."""
    rng = np.random.default_rng(_FAULTS_SEED)
    signs = [pattern for pattern in product((1.0, -1.0), repeat=3) if pattern.count(-1.0) >= 2]
    either = lambda *ranges: rng.uniform(*ranges[rng.integers(2)])  # noqa: E731
    rows = []
    for _ in range(count):
        inertia = either((0.7, 0.8), (2.0, 2.3))
        gain = np.array(signs[rng.integers(4)])
        if kind != "sign":
            gain = gain * [either((0.3, 0.5), (1.5, 2.0)) for _ in range(3)]
        bias = (
            [either((-0.3, -0.2), (0.2, 0.3)) for _ in range(3)]
            if kind == "gain and bias"
            else [0.0] * 3
        )
        if kind == "axis lost":
            gain[rng.integers(3)] = 0.0
        rows.append((inertia, gain, bias))
    return Faults(*(np.array(column) for column in zip(*rows, strict=True)))


def starts(seeds: Sequence[int]) -> Scenario:
    """The benchmark's, of these seeds: modified Rodrigues parameters up to 0.3 long, 0.05 rad/s an axis."""
    rows = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        axis = rng.normal(size=3)
        sigma = axis / np.linalg.norm(axis) * rng.uniform(0.0, 0.3)
        square = float(sigma @ sigma)
        rows.append(
            ((1 - square) / (1 + square), *(2 * sigma / (1 + square)), *rng.uniform(-0.05, 0.05, 3))
        )
    columns = np.array(rows).T
    still = np.zeros(len(rows))
    at_rest = Vec3(still, still, still)
    return Scenario(
        SpatialState(at_rest, Quat(*columns[:4]), at_rest, Vec3(*columns[4:])),
        SpatialState(at_rest, Quat(still + 1.0, still, still, still), at_rest, at_rest),
    )


def applied(told: np.ndarray, gain: np.ndarray, bias: np.ndarray) -> np.ndarray:
    """What nozzles (N, 2 n) do when told so much, with gains and biases (N, n)."""
    asked = told[:, 0::2] - told[:, 1::2]
    return nozzles((gain * asked + bias).clip(-1.0, 1.0))


def nozzles(asked: np.ndarray) -> np.ndarray:
    """What (N, 2 n) turns n axes by shares (N, n) of their torque."""
    return np.stack((asked, -asked), axis=2).reshape(len(asked), -1).clip(min=0.0)


class Faulty:
    """A controller whose torques are faulty; what flies is told what these make of its commands."""

    def __init__(self, controller: Controller, faults: Faults) -> None:
        self.name = controller.name
        self._controller = controller
        self._faults = faults

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._controller.reset(count)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`."""
        told = np.asarray(self._controller.act(state, goal, observation), dtype=np.float64)
        return applied(told, self._faults.gain, self._faults.bias)


def turns(state: Any, goal: Any) -> np.ndarray:
    """(3, N) rotation vectors from the goal to the attitude, rad."""
    q = goal.attitude.to(state.attitude)
    vector = np.array([q.x, q.y, q.z]) * np.where(q.w < 0, -1.0, 1.0)
    w = np.abs(q.w)
    size = np.linalg.norm(vector, axis=0)
    return vector * (2.0 * np.arctan2(size, w) / np.maximum(size, 1e-12))


class Oracle:
    """The benchmark's proportional-derivative law (0.2, 1.5), told f, gains and, if it may, biases."""

    def __init__(self, faults: Faults, name: str, knows_bias: bool = False) -> None:
        self.name = name
        self._faults = faults
        self._gain = np.where(faults.gain < 0, -1.0, 1.0) * np.maximum(
            np.abs(faults.gain), _LEAST_GAIN
        )
        self._bias = faults.bias * knows_bias

    def reset(self, count: int) -> None:
        """It remembers nothing."""

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`."""
        turned = turns(state, goal)
        angle = np.maximum(np.linalg.norm(turned, axis=0), 1e-12)
        sigma = turned / angle * np.tan(angle / 4)  # modified Rodrigues parameters
        wanted = -self._faults.inertia * (0.2 * sigma + 1.5 * np.array(state.w.columns())) / TORQUE
        return nozzles(np.clip((wanted.T - self._bias) / self._gain, -1.0, 1.0))


def settled(controller: Controller, faults: Faults, begun: Scenario, move: Any = fly) -> np.ndarray:
    """(N,) whether each flight ends behind the gate."""
    craft = body_of_three_axes()
    nominal = Body.of(craft)
    body = replace(nominal, inertia=tuple(x * faults.inertia for x in nominal.inertia))
    with (
        warnings.catch_warnings()
    ):  # that who is misled spins faster than the motion is accurate for
        warnings.simplefilter("ignore", UserWarning)
        flight = move(craft, GoToPose(), Faulty(controller, faults), begun, TIMING, body=body)
    return (flight.errors()["attitude"][-DWELL:] <= GATE).all(axis=0)


def battery(kind: Class, faults: int = _FAULTS, seeds: int = _SEEDS) -> tuple[Faults, Scenario]:
    """Every fault of a class with every start."""
    each = held_out(kind, faults)
    return (Faults(*(np.repeat(x, seeds, axis=0) for x in each)), starts([*range(seeds)] * faults))
