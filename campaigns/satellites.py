"""Hidden satellites with reaction wheels in orbit, and their identification.

Each satellite has inertia, wheels, magnetic dipole, drag and orbit of its own, and turns from goal to goal as
InnoCube did. Its telemetry has noise, gaps, a period, a delay of the speeds and time stamps of its own: of whole
seconds for half of them. The equations are written here, with the acceleration of the wheels as command, and share
nothing with the fit.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from rans_robot.identify.fit import fit
from rans_robot.identify.log import FlightLog
from rans_robot.identify.result import SPREAD

from rans.errors import ConfigError
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.processes import Workers, nothing
from rans.terminal import progress, stages

_STEP = 0.25
"""s: step of the integration (Runge and Kutta, fourth order)."""
_PERIOD = 1.0
"""s: period of attitude control."""
_MU, _EARTH = 3.986004418e14, 6.371e6
"""Gravitational parameter, m^3/s^2, and mean radius of the Earth, m."""
_FIELD = 3.0e-5
"""T: magnetic field of the Earth's dipole at its equator."""


@dataclass(frozen=True)
class Satellites:
    """Truth of K satellites; rows are satellites."""

    sheet: Spacecraft
    """Data sheet of all."""
    inertia: np.ndarray
    """(K, 3, 3), kg m^2, without the rotors about their axes."""
    rotors: np.ndarray
    """(K, W), kg m^2."""
    dipole: np.ndarray
    """(K, 3), A m^2, in the body."""
    lever: np.ndarray
    """(K, 3), m, centre of pressure in the body."""
    drag: np.ndarray
    """(K,), N."""
    logs: tuple[FlightLog, ...]
    """Telemetry."""


def satellites(count: int, seed: int, seconds: float = 900.0) -> Satellites:
    """Draw satellites, fly them and read their telemetry."""
    random = np.random.default_rng(seed)
    sheet = load_spacecraft("innocube")
    axes = np.array([wheel.axis for wheel in sheet.wheels]).T
    W = axes.shape[1]

    # Bodies: moments and wheels up to 25 % off the data sheet, products up to 4 % of the largest moment.
    nominal = np.array(sheet.inertia)
    inertia = np.zeros((count, 3, 3))
    for k in range(count):
        while True:
            moments = np.diag(nominal) * random.uniform(0.75, 1.25, 3)
            products = random.uniform(-0.04, 0.04, 3) * moments.max()
            x, y, z = products
            tensor = np.diag(moments) + np.array([[0, x, y], [x, 0, z], [y, z, 0]])
            principal = np.linalg.eigvalsh(tensor)
            if principal[0] > 0.0 and principal[2] <= principal[0] + principal[1]:
                break
        inertia[k] = tensor
    rotors = np.array([wheel.inertia for wheel in sheet.wheels])
    rotors = rotors * random.uniform(0.75, 1.25, (count, W))
    whole = inertia + np.einsum("iw,kw,jw->kij", axes, rotors, axes)
    inverse = np.linalg.inv(whole)

    # Orbits: circular, with a dipole field tilted by 10 degrees.
    radius = _EARTH + random.uniform(4e5, 7e5, count)
    rate = np.sqrt(_MU / radius**3)
    first = _units(random, count)
    normal = np.cross(first, _units(random, count))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    second = np.cross(normal, first)
    pole = np.array([np.sin(np.radians(10.0)), 0.0, -np.cos(np.radians(10.0))])
    dipole = _units(random, count) * 10.0 ** random.uniform(-3.0, -1.3, (count, 1))
    lever = random.uniform(-0.03, 0.03, (count, 3))
    drag = 10.0 ** random.uniform(-6.5, -5.0, count)

    def torque(t: float, q: np.ndarray) -> np.ndarray:
        """Gravity gradient, dipole and drag in the body."""
        angle = (rate * t)[:, None]
        up = np.cos(angle) * first + np.sin(angle) * second
        along = np.cos(angle) * second - np.sin(angle) * first
        field = 3.0 * (up @ pole)[:, None] * up - pole
        field *= (_FIELD * (_EARTH / radius) ** 3)[:, None]
        to_body = q * [1.0, -1.0, -1.0, -1.0]
        up, field, along = (_rotated(to_body, v) for v in (up, field, along))
        gradient = np.cross(up, np.einsum("kij,kj->ki", inertia, up))
        result = 3.0 * (rate**2)[:, None] * gradient + np.cross(dipole, field)
        return result + np.cross(lever, -drag[:, None] * along)

    def derivative(t: float, state: np.ndarray, command: np.ndarray) -> np.ndarray:
        q, w, s = state[:, :4], state[:, 4:7], state[:, 7:]
        momentum = np.einsum("kij,kj->ki", whole, w) + (rotors * s) @ axes.T
        right = torque(t, q) - (rotors * command) @ axes.T - np.cross(w, momentum)
        spun = 0.5 * _product(q, np.concatenate([np.zeros((count, 1)), w], axis=1))
        return np.concatenate([spun, np.einsum("kij,kj->ki", inverse, right), command], axis=1)

    # Flights: a law of proportion and rate to random goals, with accelerations up to 100 rpm/s.
    state = np.concatenate(
        [_quaternions(random, count), random.normal(0.0, 0.02, (count, 3)), np.zeros((count, W))],
        axis=1,
    )
    goal = _quaternions(random, count)
    change = random.uniform(60.0, 160.0, count)
    stiffness = random.uniform(30.0, 75.0, (count, 1)) * np.diag(nominal) / np.diag(nominal).max()
    damping = random.uniform(150.0, 400.0, (count, 1)) * np.diag(nominal) / np.diag(nominal).max()
    steps = round(seconds / _STEP)
    path = np.empty((steps + 1, *state.shape))
    path[0] = state
    command = np.zeros((count, W))
    for k in range(steps):
        t = k * _STEP
        if abs(t / _PERIOD - round(t / _PERIOD)) < 1e-9:
            new = t >= change
            goal[new] = _quaternions(random, int(new.sum()))
            change[new] += random.uniform(60.0, 160.0, int(new.sum()))
            error = _product(goal * [1.0, -1.0, -1.0, -1.0], state[:, :4])
            vector = error[:, 1:] * np.where(error[:, :1] < 0.0, -1.0, 1.0)
            wanted = stiffness * vector + damping * state[:, 4:7]
            command = np.clip(wanted @ axes, -10.5, 10.5)
        a = derivative(t, state, command)
        b = derivative(t + 0.5 * _STEP, state + 0.5 * _STEP * a, command)
        c = derivative(t + 0.5 * _STEP, state + 0.5 * _STEP * b, command)
        d = derivative(t + _STEP, state + _STEP * c, command)
        state = state + _STEP / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        state[:, :4] /= np.linalg.norm(state[:, :4], axis=1, keepdims=True)
        path[k + 1] = state
    logs = tuple(_telemetry(random, f"satellite {k}", path[:, k], seconds) for k in range(count))
    return Satellites(sheet, inertia, rotors, dipole, lever, drag, logs)


def _telemetry(
    random: np.random.Generator, name: str, path: np.ndarray, seconds: float
) -> FlightLog:
    """Readings of one flight (S + 1, 7 + W): noise, period, gaps, delay and stamps are drawn."""
    period = random.choice([1.0, 2.0, 3.0])
    times = np.arange(2.0, seconds - 2.0, period)
    times = times + random.uniform(0.0, 0.4, len(times)) * period
    times = times[random.random(len(times)) > 0.1]
    late = random.uniform(0.0, 0.4)
    jitter = random.choice([0.0, 0.1])
    speeds = path[:, 7:]
    q = _at(path, times + random.normal(0.0, jitter, len(times)))[:, :4]
    w = _at(path, times)[:, 4:7]
    s = _at(path, times - late + random.normal(0.0, jitter, len(times)))[:, 7:]
    tilt = random.normal(0.0, 10.0 ** random.uniform(-3.5, -2.0), (len(times), 3))
    q = _product(q, np.concatenate([np.ones((len(times), 1)), 0.5 * tilt], axis=1))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    w = w + random.normal(0.0, 10.0 ** random.uniform(-4.0, -2.7), w.shape)
    s = s + random.normal(0.0, 10.0 ** random.uniform(-1.5, 0.0), s.shape)
    whole = random.random() < 0.5
    stamps = np.floor(times) if whole else times
    once = np.concatenate([[True], np.diff(stamps) > 0.0])
    count = int(once.sum())
    nothing = np.full((count, 3), np.nan)
    commands = np.empty((0, speeds.shape[1]))
    return FlightLog(
        name, np.empty(0), commands, stamps[once], nothing, q[once], nothing, w[once], s[once]
    )


def _at(path: np.ndarray, times: np.ndarray) -> np.ndarray:
    """States between steps: rates and speeds on a line, attitudes turned at the rate."""
    index = np.clip((times / _STEP).astype(int), 0, len(path) - 2)
    part = times - _STEP * index
    before, after = path[index], path[index + 1]
    result = before + (part / _STEP)[:, None] * (after - before)
    half = 0.25 * part[:, None] * (before[:, 4:7] + result[:, 4:7])
    q = _product(before[:, :4], np.concatenate([np.ones((len(times), 1)), half], axis=1))
    result[:, :4] = q / np.linalg.norm(q, axis=1, keepdims=True)
    return result


def _units(random: np.random.Generator, count: int) -> np.ndarray:
    vectors = random.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _quaternions(random: np.random.Generator, count: int) -> np.ndarray:
    vectors = random.normal(size=(count, 4))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton product (N, 4), scalar first."""
    scalar = a[:, :1] * b[:, :1] - np.sum(a[:, 1:] * b[:, 1:], axis=1, keepdims=True)
    vector = a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])
    return np.concatenate([scalar, vector], axis=1)


def _rotated(q: np.ndarray, vector: np.ndarray) -> np.ndarray:
    across = 2.0 * np.cross(q[:, 1:], vector)
    return vector + q[:, :1] * across + np.cross(q[:, 1:], across)


def _identified(
    _: None, sheet: Spacecraft, log: FlightLog
) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Moments of inertia, products and rotors (9,), their deviations, and the time of the fit, s; None: refused."""
    began = time.process_time()
    try:
        found = fit(sheet, [log]).momentum
    except ConfigError:
        return None
    assert found is not None  # its craft has wheels alone
    deviations = np.sqrt(np.diag(found.covariance))
    return found.values[:9], deviations[:9], time.process_time() - began


@dataclass(frozen=True)
class HiddenSatellites:
    """Identify hidden satellites from their attitudes, rates and wheel speeds."""

    count: int = 64
    """Number of hidden satellites."""
    seconds: float = 900.0
    """Length of each flight, s."""
    seed: int = 2028
    """Seed of the satellites and of their readings."""

    def measured(self) -> dict[str, Any]:
        """Fly, identify and compare."""
        hidden = satellites(self.count, self.seed, self.seconds)
        found = []
        with progress() as bars:
            stage = stages(bars)(f"{self.count} hidden satellites", self.count)
            jobs = [(hidden.sheet, log) for log in hidden.logs]
            for one in Workers(nothing, work="identified satellites").ordered(_identified, jobs):
                found.append(one)
                stage(1)
        taken = [k for k, one in enumerate(found) if one is not None]
        values, deviations, spent = map(np.array, zip(*filter(None, found), strict=True))
        return {
            "rows": [*self._rows(hidden, taken, values, deviations)],
            "count": self.count,
            "refused": self.count - len(taken),
            "median seconds of a fit": float(np.median(spent)),
        }

    def _rows(
        self, hidden: Satellites, taken: list[int], values: np.ndarray, deviations: np.ndarray
    ) -> Iterator[list[str]]:
        """Rows of the table. Readings say the scale of nothing, so the sum of the moments is the sheet's."""
        inertia = hidden.inertia[taken]
        scale = np.trace(np.array(hidden.sheet.inertia)) / np.trace(inertia, axis1=1, axis2=2)
        upper = inertia[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
        truth = np.concatenate([upper, hidden.rotors[taken]], axis=1) * scale[:, None]
        errors = values - truth
        held = np.abs(errors) <= SPREAD * deviations
        largest = truth[:, [0, 3, 5]].max(axis=1, keepdims=True)
        groups = {
            "moment of inertia": ([0, 3, 5], truth[:, [0, 3, 5]]),
            "product of inertia, of the largest moment": ([1, 2, 4], largest),
            "inertia of a wheel": ([6, 7, 8], truth[:, 6:]),
        }
        for title, (columns, of) in groups.items():
            percent = 100.0 * np.abs(errors[:, columns] / of)
            yield [
                title,
                f"{np.median(percent):.2g} %",
                f"{np.quantile(percent, 0.95):.2g} %",
                f"{100.0 * held[:, columns].mean():.1f} %",
            ]
