"""Hidden satellites with reaction wheels in orbit, and their identification.

Each satellite has inertia, wheels, magnetic dipole, drag and orbit of its own, and turns from goal to goal as
InnoCube did. Its telemetry has noise, gaps, a period, a delay of the speeds and time stamps of its own: of whole
seconds for half of them. The equations are written here, with the acceleration of the wheels as command, and share
nothing with the fit.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rans_robot.identify.fit import fit
from rans_robot.identify.log import FlightLog
from rans_robot.identify.momentum import Source
from rans_robot.identify.result import SPREAD

from campaigns.identification import identified, row_of
from rans.errors import ConfigError
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft

_STEP = 0.25
"""s: step of the integration (Runge and Kutta, fourth order)."""
_COURSE = 1.0
"""s: step of the courses of torques."""
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
    gained: np.ndarray
    """(K, T, 3 sources, 3), N m s: momentum in inertial axes until `_COURSE` * k, of gradient, dipole and air."""
    logs: tuple[FlightLog, ...]
    """Telemetry: attitude, rates and wheels."""
    with_orbit: tuple[FlightLog, ...]
    """Telemetry of the same flights that has positions and magnetic fields, too."""

    @property
    def scale(self) -> np.ndarray:
        """(K,), the data sheet's sum of the moments over the satellite's."""
        return np.trace(np.array(self.sheet.inertia)) / np.trace(self.inertia, axis1=1, axis2=2)


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
    first = directions(random, count)
    normal = np.cross(first, directions(random, count))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    second = np.cross(normal, first)
    pole = np.array([np.sin(np.radians(10.0)), 0.0, -np.cos(np.radians(10.0))])
    dipole = directions(random, count) * 10.0 ** random.uniform(-3.0, -1.3, (count, 1))
    lever = random.uniform(-0.03, 0.03, (count, 3))
    drag = 10.0 ** random.uniform(-6.5, -5.0, count)

    def around(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Directions from the Earth and of the velocity, and the field, T, in inertial axes."""
        angle = (rate * t)[:, None]
        up = np.cos(angle) * first + np.sin(angle) * second
        along = np.cos(angle) * second - np.sin(angle) * first
        field = 3.0 * (up @ pole)[:, None] * up - pole
        return up, along, field * (_FIELD * (_EARTH / radius) ** 3)[:, None]

    def parts(t: float, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Torques of gravity gradient, dipole and drag in the body."""
        up, along, field = (_rotated(q * [1.0, -1.0, -1.0, -1.0], v) for v in around(t))
        gradient = np.cross(up, np.einsum("kij,kj->ki", inertia, up))
        drags = np.cross(lever, -drag[:, None] * along)
        return 3.0 * (rate**2)[:, None] * gradient, np.cross(dipole, field), drags

    def derivative(t: float, state: np.ndarray, command: np.ndarray) -> np.ndarray:
        q, w, s = state[:, :4], state[:, 4:7], state[:, 7:]
        momentum = np.einsum("kij,kj->ki", whole, w) + (rotors * s) @ axes.T
        right = sum(parts(t, q)) - (rotors * command) @ axes.T - np.cross(w, momentum)
        spun = 0.5 * _product(q, np.concatenate([np.zeros((count, 1)), w], axis=1))
        return np.concatenate([spun, np.einsum("kij,kj->ki", inverse, right), command], axis=1)

    # Flights: a law of proportion and rate to random goals, with accelerations up to 100 rpm/s.
    state = np.concatenate(
        [directions(random, count, 4), random.normal(0.0, 0.02, (count, 3)), np.zeros((count, W))],
        axis=1,
    )
    goal = directions(random, count, 4)
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
            goal[new] = directions(random, int(new.sum()), 4)
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
    course = range(0, steps + 1, round(_COURSE / _STEP))
    acting = [
        np.stack([_rotated(path[k, :, :4], one) for one in parts(k * _STEP, path[k, :, :4])], 1)
        for k in course
    ]
    acting = np.stack(acting, axis=1)
    gained = np.zeros_like(acting)
    gained[:, 1:] = np.cumsum(0.5 * _COURSE * (acting[:, 1:] + acting[:, :-1]), axis=1)
    # Positions to 10 m and fields to 200 nT, at instants that the rows name; random numbers of their own.
    further = np.random.default_rng([seed, 1])
    measured = []
    for k, log in enumerate(logs):
        readings = [tuple(x[k] for x in around(t)) for t in log.times]
        up, _, field = (np.array(x) for x in zip(*readings, strict=True))
        body = _rotated(log.attitude * [1.0, -1.0, -1.0, -1.0], field)
        body = body + further.normal(0.0, 2e-7, body.shape)
        position = radius[k] * up + further.normal(0.0, 10.0, up.shape)
        measured.append(replace(log, position=position, field=body))
    return Satellites(sheet, inertia, rotors, dipole, lever, drag, gained, logs, tuple(measured))


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


def directions(random: np.random.Generator, count: int, size: int = 3) -> np.ndarray:
    """Uniform unit vectors (count, size); of size 4 they are attitudes."""
    vectors = random.normal(size=(count, size))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton product (N, 4), scalar first."""
    scalar = a[:, :1] * b[:, :1] - np.sum(a[:, 1:] * b[:, 1:], axis=1, keepdims=True)
    vector = a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])
    return np.concatenate([scalar, vector], axis=1)


def _rotated(q: np.ndarray, vector: np.ndarray) -> np.ndarray:
    across = 2.0 * np.cross(q[:, 1:], vector)
    return vector + q[:, :1] * across + np.cross(q[:, 1:], across)


@dataclass(frozen=True)
class _Found:
    """Result of one log."""

    values: np.ndarray
    """(9,): moments of inertia, products and rotors, kg m^2."""
    deviations: np.ndarray
    sources: tuple[Source, ...]
    seconds: float
    """Time of the fit."""


def _identified(_: None, sheet: Spacecraft, log: FlightLog) -> _Found | None:
    """What is identified from a log; None: refused."""
    began = time.process_time()
    try:
        found = fit(sheet, [log]).momentum
    except ConfigError:
        return None
    assert found is not None  # its craft has wheels alone
    deviations = np.sqrt(np.diag(found.covariance))
    spent = time.process_time() - began
    return _Found(found.values[:9], deviations[:9], found.sources, spent)


@dataclass(frozen=True)
class HiddenSatellites:
    """Identify hidden satellites from their attitudes, rates and wheel speeds, and with positions and fields."""

    count: int = 384
    """Number of hidden satellites."""
    seconds: float = 900.0
    """Length of each flight, s."""
    seed: int = 2031
    """Seed of the satellites and of their readings."""

    def measured(self) -> dict[str, Any]:
        """Fly, identify and compare."""
        hidden = satellites(self.count, self.seed, self.seconds)
        found = identified(_identified, hidden.sheet, (*hidden.logs, *hidden.with_orbit))
        alone, with_orbit = found[: self.count], found[self.count :]
        return {
            "rows": [
                *self._rows(hidden, alone, ""),
                *self._rows(hidden, with_orbit, ", with orbit"),
                *self._torques(hidden, with_orbit),
            ],
            "count": self.count,
            "refused": found.count(None),
            "median seconds of a fit": float(np.median([one.seconds for one in found if one])),
        }

    def _rows(
        self, hidden: Satellites, found: list[_Found | None], title: str
    ) -> Iterator[list[str]]:
        """Rows of inertia and wheels. Readings do not say the scale: the sum of the moments is the sheet's."""
        taken = [k for k, one in enumerate(found) if one]
        values = np.array([one.values for one in found if one])
        deviations = np.array([one.deviations for one in found if one])
        inertia = hidden.inertia[taken]
        upper = inertia[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
        truth = np.concatenate([upper, hidden.rotors[taken]], axis=1)
        truth = truth * hidden.scale[taken, None]
        errors = values - truth
        held = np.abs(errors) <= SPREAD * deviations
        largest = truth[:, [0, 3, 5]].max(axis=1, keepdims=True)
        groups = {
            "moment of inertia": ([0, 3, 5], truth[:, [0, 3, 5]]),
            "product of inertia, of the largest moment": ([1, 2, 4], largest),
            "inertia of a wheel": ([6, 7, 8], truth[:, 6:]),
        }
        for name, (columns, of) in groups.items():
            percent = 100.0 * np.abs(errors[:, columns] / of)
            yield row_of(f"{name}{title}", percent, "%", held[:, columns])

    def _torques(self, hidden: Satellites, found: list[_Found | None]) -> Iterator[list[str]]:
        """Rows of what the torques come from: the means over stretches of each, and what is fixed in the body."""
        taken = [k for k, one in enumerate(found) if one]
        arms = (None, hidden.dipole, hidden.drag[:, None] * hidden.lever)
        units = (0.0, 1e3, 1e9), ("", "mA m^2", "nN m")
        for part, title in enumerate(("gravity gradient", "magnetic dipole", "air")):
            errors, held, fixed, fixed_held = [], [], [], []
            for k in taken:
                one = found[k]
                assert one is not None
                source = one.sources[part]
                times = np.arange(hidden.gained.shape[1]) * _COURSE
                columns = hidden.gained[k, :, part].T
                at = np.stack([np.interp(source.torque.times, times, x) for x in columns], axis=1)
                truth = np.diff(at, axis=0) / np.diff(source.torque.times)[:, None]
                off = source.torque.torque - hidden.scale[k] * truth
                errors.append(1e9 * np.abs(off).ravel())
                held.append((np.abs(off) <= SPREAD * source.torque.deviation).ravel())
                arm = arms[part]
                if arm is not None:
                    off = source.values - hidden.scale[k] * arm[k]
                    fixed.append(np.abs(off))
                    fixed_held.append(np.abs(off) <= SPREAD * np.sqrt(np.diag(source.covariance)))
            whole = np.concatenate(held)
            yield row_of(f"torque of the {title}", np.concatenate(errors), "nN m", whole)
            if fixed:
                name = "magnetic dipole" if part == 1 else "lever times force of the air"
                off = units[0][part] * np.concatenate(fixed)
                yield row_of(name, off, units[1][part], np.concatenate(fixed_held))
