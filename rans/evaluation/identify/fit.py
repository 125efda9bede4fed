"""Least-squares fit of forces, inertia, disturbances and delays to a log, with intervals.

The log is divided into windows, each with a start of its own that is fitted too, so that what the model lacks
does not add up over the flight. The cost is that of Gaussian errors of the readings, whose standard deviations are
estimated from the residuals, and of a weak Gaussian prior round the data sheet, which decides what the log does not
determine. It is minimised by Gauss and Newton's method with Levenberg and Marquardt's damping; the posterior is the
Gaussian of the curvature at the optimum (Ljung, System Identification, 2nd edition, 7.2 and 9.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rans.errors import ConfigError
from rans.evaluation.identify.log import FlightLog, checked_log
from rans.evaluation.identify.motion import (
    Physics,
    Thrust,
    check_identifiable,
    predicted,
    quaternion_products,
    windows_of,
)
from rans.model.body import Body
from rans.model.dynamics import Wrench
from rans.model.fields import Vec2, Vec3
from rans.model.spacecraft import Spacecraft

WINDOW = 5.0
"""s: length of a window. Longer ones determine small forces better; errors of the model add up over them."""
CHANNELS = ("position", "attitude", "velocity", "spin", "wheel speed")
"""Measured quantities, in the order of the columns of a residual."""
_FACTOR_PRIOR = 0.3
"""Standard deviation of the prior of factors on force and inertia: data sheets err by a tenth to a quarter."""
_CENTRE_PRIOR = 0.03
"""m: standard deviation of the prior of the centre of mass."""
_LATENCY_PRIOR = 0.2
"""s: standard deviation of the prior of the latency."""
_RISE_PRIOR = 0.03
"""s: standard deviation of the prior of the rise time, about which readings say little beside the latency."""
_FORCE_PRIOR = 0.5
"""Standard deviation of the prior of a disturbance force, as a part of the strongest thruster's force."""
_ITERATIONS = 40
"""Most steps of the fit; it takes about ten."""
_MOST_DAMPING = 1e8
"""Damping at which a step is too small to matter."""
_SHORT = 1.0
"""s: length of the windows of the first fits."""
_FEW = 5
"""Steps after which the best of several beginnings goes on alone."""
_FIRST_LATENCIES = (0.02, 0.1, 0.25)
"""s: where the fit begins; the cost has one minimum within a pulse of the right latency."""
_DIFFERENCE = 1e-4
"""Step of finite differences, in standard deviations of the prior."""


@dataclass(frozen=True)
class Parameter:
    """A quantity that is identified."""

    name: str
    unit: str
    nominal: float
    """Value of the data sheet."""
    prior: float
    """Standard deviation of the prior."""
    least: float = -np.inf
    """Least possible value."""


@dataclass(frozen=True)
class Fit:
    """Result of `fit`."""

    craft: Spacecraft
    """Spacecraft as designed."""
    parameters: tuple[Parameter, ...]
    values: np.ndarray
    """(P,), most probable values."""
    covariance: np.ndarray
    """(P, P), of the posterior."""
    noise: dict[str, float]
    """Standard deviation of the readings' errors, in m, rad, m/s and rad/s, of what was measured."""
    residuals: tuple[np.ndarray, ...]
    """Readings minus prediction of each log, (M, 6 + W or 12 + W); in space the attitude's is a rotation vector."""
    nominal_residuals: tuple[np.ndarray, ...]
    """Readings minus the prediction of the data sheet, of each log, with windows' starts fitted."""
    logs: tuple[FlightLog, ...]

    @property
    def deviations(self) -> np.ndarray:
        """(P,), standard deviations of the posterior."""
        return np.sqrt(np.diag(self.covariance))

    def value(self, name: str) -> float:
        """Most probable value of a parameter."""
        return float(self.values[[parameter.name for parameter in self.parameters].index(name)])

    def is_identifiable(self) -> np.ndarray:
        """(P,), whether the log halves the prior's standard deviation at least."""
        return self.deviations < 0.5 * np.array([parameter.prior for parameter in self.parameters])


def parameters_of(craft: Spacecraft) -> tuple[Parameter, ...]:
    """Quantities that are identified of a spacecraft; its mass is weighed, since motion determines ratios only."""
    check_identifiable(craft)
    forces = [thruster.force for thruster in craft.thrusters]
    strongest = max(forces)
    axes = "xyz"[: craft.dimension]
    result = [
        Parameter(f"force of thruster {k}", "N", force, _FACTOR_PRIOR * force, 1e-3 * force)
        for k, force in enumerate(forces)
    ]
    moments = Body.of(craft).inertia
    names = ("zz",) if craft.dimension == 2 else ("xx", "xy", "xz", "yy", "yz", "zz")
    size = max(moments)
    for name, moment in zip(names, moments, strict=True):
        is_product = name[0] != name[1]
        prior = 0.1 * size if is_product else _FACTOR_PRIOR * moment
        least = -np.inf if is_product else 1e-3 * moment
        result.append(Parameter(f"inertia {name}", "kg m^2", moment, prior, least))
    result += [Parameter(f"centre {axis}", "m", 0.0, _CENTRE_PRIOR) for axis in axes]
    result += [
        Parameter(f"disturbance {axis}", "N", 0.0, _FORCE_PRIOR * strongest) for axis in axes
    ]
    # Thrusters may all push through the centre of mass: then disturbances have the radius for a lever arm.
    lever = max(float(np.linalg.norm(t.position)) for t in craft.thrusters) or craft.radius
    turns = ("z",) if craft.dimension == 2 else axes
    result += [
        Parameter(f"torque {axis}", "N m", 0.0, _FORCE_PRIOR * strongest * lever) for axis in turns
    ]
    result.append(Parameter("latency", "s", 0.0, _LATENCY_PRIOR, 0.0))
    result.append(Parameter("rise", "s", 0.0, _RISE_PRIOR, 0.0))
    for k, wheel in enumerate(craft.wheels):
        full = wheel.max_torque
        about = wheel.inertia
        result += [
            Parameter(f"motor of wheel {k}", "N m", full, _FACTOR_PRIOR * full, 1e-3 * full),
            Parameter(f"rotor of wheel {k}", "kg m^2", about, _FACTOR_PRIOR * about, 1e-3 * about),
        ]
    return tuple(result)


def physics_of(craft: Spacecraft, values: np.ndarray) -> Physics:
    """Physics of K sets of values (K, P) in the order of `parameters_of`."""
    columns = iter(values.T)
    count = craft.thruster_count
    gain = tuple(next(columns) / thruster.force for thruster in craft.thrusters)
    inertia = tuple(next(columns) for _ in range(1 if craft.dimension == 2 else 6))
    centre = tuple(next(columns) for _ in range(craft.dimension))
    force = [next(columns) for _ in range(craft.dimension)]
    if craft.dimension == 2:
        push = Wrench(Vec2(*force), next(columns))
    else:
        push = Wrench(Vec3(*force), Vec3(*(next(columns) for _ in range(3))))
    body = Body(craft.mass, inertia, centre, gain, (0.0,) * count)
    latency, rise = next(columns), next(columns)
    wheels = [(next(columns), next(columns)) for _ in craft.wheels]
    torques = tuple(torque for torque, _ in wheels)
    return Physics(body, push, latency, rise, torques, tuple(about for _, about in wheels))


class _Problem:
    """Residuals of logs as a function of parameters and the windows' starts."""

    def __init__(self, craft: Spacecraft, logs: Sequence[FlightLog], window: float) -> None:
        self.craft = craft
        self.parameters = parameters_of(craft)
        self.planar = craft.dimension == 2
        self.width = (6 if self.planar else 12) + craft.wheel_count
        """Entries of a residual, and of the change of a start."""
        self.groups: list[_Group] = []
        for number, log in enumerate(logs):
            windows = windows_of(log, window)
            thrusts = Thrust.of(craft, log)
            for length in sorted({part.stop - part.start for part in windows}):
                alike = [part for part in windows if part.stop - part.start == length]
                self.groups.append(_Group(number, log, thrusts, alike))

    def residual(self, group: _Group, values: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """Readings minus prediction (K, M, width) of K = R W lanes for values (R, P) of R sets and W windows.

        Args:
            group: windows of equal numbers of readings.
            values: (R, P).
            starts: (R, W, columns).
        """
        sets, windows = starts.shape[:2]
        physics = physics_of(self.craft, np.repeat(values, windows, axis=0))
        flat = starts.reshape(sets * windows, -1)
        begin = np.tile(group.begin, sets)
        times = np.tile(group.times, (sets, 1))
        path = predicted(self.craft, group.thrusts, physics, flat, begin, times)
        return self._difference(np.tile(group.readings, (sets, 1, 1)), path)

    def _difference(self, readings: np.ndarray, path: np.ndarray) -> np.ndarray:
        if self.planar:
            result = readings - path
            result[..., 2] = np.mod(result[..., 2] + np.pi, 2.0 * np.pi) - np.pi
            return result
        turn = _rotation_vector(path[..., 3:7], readings[..., 3:7])
        return np.concatenate(
            [readings[..., :3] - path[..., :3], turn, readings[..., 7:] - path[..., 7:]], axis=-1
        )

    def moved(self, starts: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Starts (W, columns) changed by (W, width); attitudes in space turn by a rotation vector in B."""
        if self.planar:
            return starts + change
        half = 0.5 * change[:, 3:6]
        small = np.concatenate([np.ones_like(half[:, :1]), half], axis=1)
        attitude = quaternion_products(starts[:, 3:7], small)
        attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
        return np.concatenate(
            [starts[:, :3] + change[:, :3], attitude, starts[:, 7:] + change[:, 6:]], axis=1
        )


class _Group:
    """Windows of one log that have equally many readings."""

    def __init__(
        self, number: int, log: FlightLog, thrusts: Thrust, windows: Sequence[slice]
    ) -> None:
        self.number = number
        self.windows = windows
        self.thrusts = thrusts
        parts = [log.position, log.attitude, log.velocity, log.spin]
        if log.wheel_speeds is not None:
            parts.append(log.wheel_speeds)
        columns = np.column_stack(parts)
        self.times = np.stack([log.times[part] for part in windows])
        self.begin = self.times[:, 0]
        self.readings = np.stack([columns[part] for part in windows])
        starts = self.readings[:, 0].copy()
        # Where no velocity was measured, windows begin at rest; the fit moves them.
        starts[np.isnan(starts)] = 0.0
        self.starts = starts


def _rotation_vector(path: np.ndarray, readings: np.ndarray) -> np.ndarray:
    """Small rotation (..., 3), rad, in B from predicted to measured attitudes (..., 4)."""
    turn = quaternion_products(path * [1.0, -1.0, -1.0, -1.0], readings)
    return 2.0 * turn[..., 1:] * np.where(turn[..., :1] < 0.0, -1.0, 1.0)


def channel_columns(craft: Spacecraft) -> dict[str, slice]:
    """Columns of each measured quantity in a residual of 6 entries, or 12 in space, and one a wheel."""
    ends = (0, 2, 3, 5, 6) if craft.dimension == 2 else (0, 3, 6, 9, 12)
    if craft.wheels:
        ends = (*ends, ends[-1] + craft.wheel_count)
    return {name: slice(a, b) for name, a, b in zip(CHANNELS, ends, ends[1:], strict=False)}


def fit(craft: Spacecraft, logs: Sequence[FlightLog], window: float = WINDOW) -> Fit:
    """Fit the parameters of a spacecraft to logs of its flights.

    Args:
        craft: spacecraft as designed; its mass must be right, since motion determines forces and inertia per mass.
        logs: flights of the same spacecraft.
        window: length of a window, s.

    Raises:
        ConfigError: a log is not of this spacecraft (`checked_log`), or the craft cannot be identified
            (`check_identifiable`).
    """
    check_identifiable(craft)
    logs = [checked_log(log, craft) for log in logs]
    if not logs:
        raise ConfigError("at least one log is needed.")
    problem = _Problem(craft, logs, window)
    short = _Problem(craft, logs, min(window, _SHORT))
    nominal = np.array([parameter.nominal for parameter in problem.parameters])
    latency = [parameter.name for parameter in problem.parameters].index("latency")

    # The data sheet's own prediction, with the starts of windows fitted, to be compared with.
    nothing = _Solver(problem, nominal, frozen=True)
    nothing.solve()

    # Fits over short windows from several latencies; the best continues, at last over the windows asked for. Over
    # long ones the data sheet's heading may be wrong by whole turns, where the cost has other minima.
    solvers = []
    for first in _FIRST_LATENCIES:
        values = nominal.copy()
        values[latency] = first
        solver = _Solver(short, values)
        solver.solve(_FEW)
        solvers.append(solver)
    near = min(solvers, key=lambda solver: solver.evidence())
    near.solve()
    best = _Solver(problem, near.values)
    best.solve()
    return Fit(
        craft,
        problem.parameters,
        best.values,
        best.covariance(),
        best.noise,
        best.residuals(len(logs)),
        nothing.residuals(len(logs)),
        tuple(logs),
    )


class _Solver:
    """Iterations from one set of values."""

    def __init__(self, problem: _Problem, values: np.ndarray, frozen: bool = False) -> None:
        self.problem = problem
        self.values = values
        self.starts = [group.starts for group in problem.groups]
        self.frozen = frozen
        """Whether only starts and noise are fitted."""
        self.columns = channel_columns(problem.craft)
        self.noise = {"position": 0.01, "attitude": 0.01, "velocity": 0.02, "spin": 0.02}
        self.noise["wheel speed"] = 1.0
        """Standard deviations, at first of a laboratory's order of magnitude."""
        measured = set()
        for group in problem.groups:
            residual = problem.residual(group, values[None], group.starts[None])
            measured |= {
                name
                for name, part in self.columns.items()
                if np.isfinite(residual[..., part]).any()
            }
        self.noise = {name: x for name, x in self.noise.items() if name in measured}

    def solve(self, iterations: int = _ITERATIONS) -> None:
        """Minimise the cost in at most so many steps, and estimate the noise between them."""
        problem = self.problem
        prior = np.array([parameter.prior for parameter in problem.parameters])
        nominal = np.array([parameter.nominal for parameter in problem.parameters])
        least = np.array([parameter.least for parameter in problem.parameters])
        damping = 1e-3
        settled = 0
        for _ in range(iterations):
            matrix, vector, cost = self._normal()
            while damping < _MOST_DAMPING:
                damped = matrix + damping * np.diag(np.diag(matrix))
                change = np.linalg.solve(damped, vector)
                values = self.values + change[: len(prior)] * prior
                values = np.clip(values, least, nominal + 20.0 * prior)
                starts = self._moved(change[len(prior) :])
                after = self._cost(values, starts)
                if after <= cost:
                    self.values = values
                    self.starts = starts
                    damping = max(damping * 0.1, 1e-9)
                    changed = self._estimate_noise()
                    settled = settled + 1 if cost - after < 1e-2 and changed < 3e-3 else 0
                    break
                damping *= 10.0
            else:  # no step is an improvement
                break
            if settled >= 2:
                break

    def _moved(self, change: np.ndarray) -> list[np.ndarray]:
        """Starts of all groups, changed by their part of a step in units of 1 (m, rad, m/s, rad/s)."""
        result = []
        begin = 0
        for starts in self.starts:
            size = len(starts) * self.problem.width
            part = change[begin : begin + size].reshape(len(starts), -1)
            result.append(self.problem.moved(starts, part))
            begin += size
        return result

    def _weights(self) -> np.ndarray:
        """1 / standard deviation of each entry of a residual."""
        weights = np.zeros(self.problem.width)
        for name, noise in self.noise.items():
            weights[self.columns[name]] = 1.0 / noise
        return weights

    def _cost(self, values: np.ndarray, starts: Sequence[np.ndarray]) -> float:
        problem = self.problem
        weights = self._weights()
        total = 0.0
        for group, own in zip(problem.groups, starts, strict=True):
            residual = problem.residual(group, values[None], own[None])
            total += float(np.nansum((residual * weights) ** 2))
        return total + float(np.sum(self._from_prior(values) ** 2))

    def _from_prior(self, values: np.ndarray) -> np.ndarray:
        parameters = self.problem.parameters
        return np.array(
            [
                (v - parameter.nominal) / parameter.prior
                for v, parameter in zip(values, parameters, strict=True)
            ]
        )

    def _normal(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Matrix and right side of the normal equations for values in units of their prior, and the cost."""
        problem = self.problem
        prior = np.array([parameter.prior for parameter in problem.parameters])
        count = len(prior)
        size = count + sum(len(starts) * problem.width for starts in self.starts)
        matrix = np.zeros((size, size))
        vector = np.zeros(size)
        deviation = self._from_prior(self.values)
        matrix[:count, :count] = np.eye(count)
        vector[:count] = -deviation
        cost = float(np.sum(deviation**2))
        weights = self._weights()
        begin = count
        for group, starts in zip(problem.groups, self.starts, strict=True):
            # One set of values as they are, one for each parameter, and one for each entry of the starts.
            sets = 1 + count + problem.width
            values = np.repeat(self.values[None], sets, axis=0)
            values[1 : 1 + count] += np.diag(prior * _DIFFERENCE)
            lanes = np.repeat(starts[None], sets, axis=0)
            for j in range(problem.width):
                change = np.zeros((len(starts), problem.width))
                change[:, j] = _DIFFERENCE
                lanes[1 + count + j] = problem.moved(starts, change)
            all_residuals = problem.residual(group, values, lanes) * weights
            all_residuals = np.nan_to_num(all_residuals, nan=0.0)
            windows = len(starts)
            shaped = all_residuals.reshape(sets, windows, -1)
            residual = shaped[0]
            jacobian = (shaped[0] - shaped[1:]) / _DIFFERENCE
            of_values = jacobian[:count]
            if self.frozen:
                of_values = np.zeros_like(of_values)
            of_starts = jacobian[count:]
            cost += float(np.sum(residual**2))
            matrix[:count, :count] += np.einsum("pwm,qwm->pq", of_values, of_values)
            vector[:count] += np.einsum("pwm,wm->p", of_values, residual)
            for w in range(windows):
                own = slice(begin + w * problem.width, begin + (w + 1) * problem.width)
                matrix[:count, own] = of_values[:, w] @ of_starts[:, w].T
                matrix[own, :count] = matrix[:count, own].T
                # A start whose velocity nothing measured and nothing shows keeps a faint prior of 10 m, rad, m/s.
                matrix[own, own] = of_starts[:, w] @ of_starts[:, w].T + 1e-2 * np.eye(
                    problem.width
                )
                vector[own] = of_starts[:, w] @ residual[w]
            begin += windows * problem.width
        return matrix, vector, cost

    def _estimate_noise(self) -> float:
        """Set standard deviations to those of the residuals, and return the largest relative change."""
        problem = self.problem
        sums = dict.fromkeys(self.columns, 0.0)
        counts = dict.fromkeys(self.columns, 0)
        for group, starts in zip(problem.groups, self.starts, strict=True):
            residual = problem.residual(group, self.values[None], starts[None])
            for name, part in self.columns.items():
                channel = residual[..., part]
                sums[name] += float(np.nansum(channel**2))
                counts[name] += int(np.isfinite(channel).sum())
        total = sum(counts.values())
        fitted = sum(len(starts) * problem.width for starts in self.starts)
        fitted += 0 if self.frozen else len(problem.parameters)
        # What was fitted takes degrees of freedom, in proportion to the readings.
        factor = max(0.1, 1.0 - fitted / max(total, 1))
        change = 0.0
        for name, count in counts.items():
            if not count:
                continue
            new = max(float(np.sqrt(sums[name] / (count * factor))), 1e-6)
            change = max(change, abs(new / self.noise[name] - 1.0))
            self.noise[name] = new
        return change

    def evidence(self) -> float:
        """Minus twice the logarithm of the likelihood and the prior, up to a constant."""
        total = float(np.sum(self._from_prior(self.values) ** 2))
        for residual in self.residuals(1 + max(group.number for group in self.problem.groups)):
            for name in self.noise:
                channel = residual[:, self.columns[name]]
                count = int(np.isfinite(channel).sum())
                total += 2.0 * count * np.log(self.noise[name])
                total += float(np.nansum(channel**2)) / self.noise[name] ** 2
        return total

    def covariance(self) -> np.ndarray:
        """Covariance (P, P) of the parameters, the starts integrated out."""
        matrix, _, _ = self._normal()
        prior = np.array([parameter.prior for parameter in self.problem.parameters])
        return np.linalg.inv(matrix)[: len(prior), : len(prior)] * np.outer(prior, prior)

    def residuals(self, logs: int) -> tuple[np.ndarray, ...]:
        """Residuals of each log in the order of its readings."""
        problem = self.problem
        parts: list[list[tuple[int, np.ndarray]]] = [[] for _ in range(logs)]
        for group, starts in zip(problem.groups, self.starts, strict=True):
            residual = problem.residual(group, self.values[None], starts[None])
            for part, own in zip(group.windows, residual, strict=True):
                parts[group.number].append((part.start, own))
        return tuple(
            np.concatenate([own for _, own in sorted(section, key=lambda pair: pair[0])])
            for section in parts
        )
