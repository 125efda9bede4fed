"""Least-squares fit of forces, inertia, disturbances and delays to a log, with intervals.

The log is divided into windows, each with a start of its own that is fitted too, so that what the model lacks does
not add up over the flight; they are as long as the model explains the readings. The cost is that of Gaussian errors
of the readings, whose standard deviations are estimated from the residuals and their degrees of freedom, and of a
weak Gaussian prior round the data sheet, which decides what the log does not determine. It is minimised by Gauss
and Newton's method with Levenberg and Marquardt's damping; the posterior is the Gaussian of the curvature at the
optimum (Ljung, System Identification, 2nd edition, 7.2 and 9.3). Tests fit craft whose values are hidden, and count
how many intervals hold them: a change may not narrow intervals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from rans.extend import Body, ConfigError, Spacecraft, Vec2, Vec3, Wrench
from rans_robot.frames import quaternion_products, small_turns
from rans_robot.identify.log import FlightLog, checked_log
from rans_robot.identify.motion import (
    STEP,
    Physics,
    Thrust,
    check_identifiable,
    predicted,
    windows_of,
)

WINDOW = 5.0
"""s: length of the first windows, which are doubled while the model explains the readings."""
_LONGEST = 40.0
"""s: length from which windows are not doubled; windows of 60 s tell a tenth more than those of 30 s."""
UNLIKELY = 3.29
"""Standard deviations that a normal number exceeds in one of a thousand samples, in either direction."""
_FIRST_NOISE = {"position": 0.01, "attitude": 0.01, "velocity": 0.02, "spin": 0.02}
"""Noise with which the first fit begins: of a laboratory's order of magnitude."""
LEAST_NOISE = 1e-4
"""m, rad, m/s and rad/s: least noise, of the size of what the grid of predictions leaves of a perfect log."""
CHANNELS = ("position", "attitude", "velocity", "spin")
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
_FAINT = 10.0
"""Deviation of a faint prior of windows' starts, m, rad, m/s and rad/s: it decides what nothing measured and
nothing shows."""
_FEW = 5
"""Steps after which the best of several beginnings goes on alone."""
_FIRST_LATENCIES = (0.02, 0.1, 0.25)
"""s: where the fit begins; the cost has one minimum within a pulse of the right latency."""
_COARSE = 2.5
"""Factor on the longest step for derivatives, whose errors only direct the steps of the fit."""
_QUIET = 1e-3
"""Noise, m, rad, m/s or rad/s, below which the grid of predictions is `_FINER`."""
_FINER = 0.25
"""Factor on `STEP`: its error, which goes with the square, is then a tenth of `LEAST_NOISE`."""
_FARTHEST = 20.0
"""Standard deviations of the prior beyond which no value is sought."""
_APART = 60.0
"""s between two logs on one axis of time, in which every force has died away."""
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
    residuals: np.ndarray
    """Readings of all logs minus prediction, (M, 6 or 12); in space the attitude's is a rotation vector."""
    nominal_residuals: np.ndarray
    """Readings minus the prediction of the data sheet from the same starts of windows."""
    logs: tuple[FlightLog, ...]
    window: float
    """Length of the windows, s."""
    coasting: dict[str, float]
    """Standard deviation that each channel would have if nothing acted on the craft: round a straight line of each
    window for poses, and a constant for rates. Of channels whose windows have too few readings there is none."""

    @property
    def deviations(self) -> np.ndarray:
        """(P,), standard deviations of the posterior."""
        return np.sqrt(np.diag(self.covariance))

    def value(self, name: str) -> float:
        """Most probable value of a parameter."""
        return float(self.values[[parameter.name for parameter in self.parameters].index(name)])

    def correlation(self, channel: str) -> tuple[float, float]:
        """Correlation of successive residuals of a channel, and the bound that white ones exceed in 1 of 1,000.

        Intervals are widened by it, and a channel may fail by it (`Identification.channels`).
        """
        rows = self.residuals[:, channel_columns(self.craft)[channel]]
        first, second = rows[:-1], rows[1:]
        both = np.isfinite(first) & np.isfinite(second)
        power = float(np.mean(first[both] ** 2)) if both.any() else 0.0
        value = float(np.mean(first[both] * second[both]) / power) if power > 0.0 else 0.0
        return value, float(UNLIKELY / np.sqrt(max(int(both.sum()), 1)))

    def is_white(self) -> bool:
        """Whether the residuals of no channel are like the ones before them.

        What acts and is not modelled makes them alike. That starts of windows are fitted makes those of short
        windows unlike.
        """
        return all(value <= bound for value, bound in map(self.correlation, self.noise))

    def is_identifiable(self) -> np.ndarray:
        """(P,), whether the log halves the prior's standard deviation at least."""
        return self.deviations < 0.5 * np.array([parameter.prior for parameter in self.parameters])


def parameters_of(craft: Spacecraft) -> tuple[Parameter, ...]:
    """Quantities that are identified of a spacecraft; its mass is weighed, since motion determines ratios only.

    Their order is that of all vectors of values and of the covariance; `physics_of` reads it one by one.
    """
    check_identifiable(craft)
    forces = [thruster.force for thruster in craft.thrusters]
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
    # Centre, disturbance and delays.
    strongest = max(forces)
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
    return tuple(result)


def physics_of(craft: Spacecraft, values: np.ndarray) -> Physics:
    """Physics of K sets of values (K, P) in the order of `parameters_of`."""
    d = craft.dimension
    turns = 1 if d == 2 else 3
    sizes = (craft.thruster_count, 1 if d == 2 else 6, d, d, turns, 1, 1)
    forces, inertia, centre, push, torque, *delays = np.split(values, np.cumsum(sizes)[:-1], axis=1)
    gain = forces / [thruster.force for thruster in craft.thrusters]
    vector = Vec2 if d == 2 else Vec3
    return Physics(gain, inertia, centre, Wrench(vector(*push.T), torque), *delays)


def _one_behind_the_other(logs: Sequence[FlightLog]) -> list[FlightLog]:
    """Logs whose times follow one another, so that the windows of all of them lie on one axis of time."""
    result = []
    begin = 0.0
    for log in logs:
        times = {"times": log.times + begin, "command_times": log.command_times + begin}
        result.append(replace(log, **times))
        begin = float(max(array[-1] for array in times.values())) + 10.0 * log.period + _APART
    return result


def channel_columns(craft: Spacecraft) -> dict[str, slice]:
    """Columns of each measured quantity in a residual of 6 entries, or 12 in space."""
    ends = (0, 2, 3, 5, 6) if craft.dimension == 2 else (0, 3, 6, 9, 12)
    return {name: slice(a, b) for name, a, b in zip(CHANNELS, ends, ends[1:], strict=False)}


def fit(craft: Spacecraft, logs: Sequence[FlightLog], window: float | None = None) -> Fit:
    """Fit the parameters of a spacecraft to logs of its flights.

    Args:
        craft: spacecraft as designed; its mass must be right, since motion determines forces and inertia per mass.
        logs: flights of the same spacecraft.
        window: length of a window, s; None: the longest over which the model explains the readings (`_longest`).

    Raises:
        ConfigError: a log is not of this spacecraft (`checked_log`), or the craft cannot be identified
            (`check_identifiable`).
    """
    check_identifiable(craft)
    if not logs:
        raise ConfigError("at least one log is needed.")
    logs = [checked_log(log, craft) for log in logs]
    first = WINDOW if window is None else window
    for log in logs:
        if (period := float(np.median(np.diff(log.times)))) > first:
            raise ConfigError(
                f"the log {log.source} has a reading every {period:g} s, longer than a window, {first:g} s; "
                "are its times in seconds? window= sets longer ones."
            )
    nominal = np.array([parameter.nominal for parameter in parameters_of(craft)])
    latency = [parameter.name for parameter in parameters_of(craft)].index("latency")

    # Fits over short windows from several latencies; the best continues, at last over the windows asked for. Over
    # long ones the data sheet's heading may be wrong by whole turns, where the cost has other minima.
    solvers = []
    short = min(first, _SHORT)
    for beginning in _FIRST_LATENCIES:
        values = nominal.copy()
        values[latency] = beginning
        solver = _Solver(craft, logs, short, values)
        solver.solve(_FEW)
        solvers.append(solver)
    near = min(solvers, key=_Solver.evidence)
    near.solve()
    if near.values[latency] <= 0.0:
        _check_order(near)
    # The mean delay stays. Readings change with the square of the rise: a fit that comes to none stays there.
    near.values[latency : latency + 2] += -0.5 * _RISE_PRIOR, _RISE_PRIOR
    near.values[latency] = max(near.values[latency], 0.0)
    fitted = _Solver(craft, logs, first, near.values, near.noise).fit()
    return fitted if window is not None else _longest(fitted)


def _check_order(near: _Solver) -> None:
    """Refuse (`ConfigError`) a solved fit without latency whose logs fit better with commands a period earlier.

    No force acts before its command: such logs have each command one control period late.
    """
    logs = near.logs
    early = [replace(log, command_times=log.command_times - log.period) for log in logs]
    solver = _Solver(near.craft, early, near.window, near.values)
    solver.solve()
    if near.evidence() - solver.evidence() > UNLIKELY**2:
        raise ConfigError(
            f"the log {logs[0].source} explains its readings better if every command was given one control period, "
            f"{logs[0].period:.4g} s, before its time: nothing is identified. The usual cause is a column of "
            "what was applied until this row: write each command in the row from which on it holds."
        )


def _longest(fitted: Fit) -> Fit:
    """The fit over the longest windows, by doubling, that the model explains.

    Every window begins with unknown velocities, so information about forces grows with its length. But over a long
    one errors of the model add up. They show in correlated residuals, or in values that differ from those over
    windows of half the length by more than the deviations of these (Hausman, Econometrica 46, 1978).
    """
    longest = max(log.duration for log in fitted.logs)
    while (window := fitted.window) < min(longest, _LONGEST) and fitted.is_white():
        start = fitted.values, fitted.noise
        longer = _Solver(fitted.craft, fitted.logs, 2.0 * window, *start).fit()
        moved = np.abs(longer.values - fitted.values) / fitted.deviations
        if moved.max() > UNLIKELY or not longer.is_white():
            break
        fitted = longer
    return fitted


class _Linear:
    """Linear least squares of values (P,), in units of their prior, and of the starts of W windows.

    Each window has its own start, which QR eliminates from its rows: work grows with the number of windows only.

    Args:
        jacobian: (W, N, P + width), weighed derivatives by values and by the window's start.
        rest: (W, N), weighed residuals.
        prior: (P,), the nominal values minus the present ones.
    """

    def __init__(self, jacobian: np.ndarray, rest: np.ndarray, prior: np.ndarray) -> None:
        self.of_values, self.of_starts = np.split(jacobian, [len(prior)], axis=-1)
        self.rest = rest[..., None]
        self.prior = prior

    def _eliminated(self, damping: float) -> tuple[np.ndarray, ...]:
        """Rows of the starts as a product of q (W, N, width) and r, and normal equations (P, P + 1) of the values.

        A faint prior of starts stands below the rows of each window, and the diagonals grow by a factor.
        """
        size = self.of_starts.shape[-1]
        below = np.sqrt(1.0 / _FAINT**2 + damping * np.sum(self.of_starts**2, axis=1))
        whole = np.concatenate([self.of_starts, below[..., None] * np.eye(size)], axis=1)
        q, r = np.linalg.qr(whole)
        q = q[:, :-size]
        rows = np.concatenate([self.of_values, self.rest], axis=-1)
        across = q.mT @ rows
        normal = np.tensordot(rows, rows, ((0, 1), (0, 1)))
        normal[np.diag_indices(len(self.prior))] += 1.0
        normal[np.diag_indices(len(self.prior))] *= 1.0 + damping
        normal -= np.tensordot(across, across, ((0, 1), (0, 1)))
        normal[:-1, -1] += self.prior
        return q, r, normal[:-1]

    def step(
        self, damping: float, low: np.ndarray, high: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Changes of values within bounds (P,), and of starts (W, width), shortened by a damping."""
        q, r, normal = self._eliminated(damping)
        root = np.linalg.cholesky(normal[:, :-1])
        aim = np.linalg.solve(root, normal[:, -1])
        change = lsq_linear(root.T, aim, (low, high), method="bvls").x
        left = q.mT @ (self.rest - self.of_values @ change[:, None])
        return change, np.linalg.solve(r, left)[..., 0]

    def covariance(self) -> np.ndarray:
        """(P, P) of the values, the starts integrated out."""
        return np.linalg.inv(self._eliminated(0.0)[2][:, :-1])

    def leverages(self) -> np.ndarray:
        """(W, N), derivatives of predictions by their readings: 1 where a reading is fitted exactly."""
        q, _, normal = self._eliminated(0.0)
        own = self.of_values - q @ (q.mT @ self.of_values)
        return np.sum(q**2, axis=-1) + np.sum(own @ np.linalg.inv(normal[:, :-1]) * own, axis=-1)


class _Solver:
    """Gauss-Newton iterations from one set of values; `solve` changes values, starts, path and noise together.

    All windows (W) have as many readings (M) as the
    longest: shorter ones repeat their last instant, at which nothing is measured.
    """

    def __init__(
        self,
        craft: Spacecraft,
        logs: Sequence[FlightLog],
        window: float,
        values: np.ndarray,
        noise: dict[str, float] | None = None,
    ) -> None:
        self.craft = craft
        self.columns = channel_columns(craft)
        self.width = self.columns["spin"].stop
        """Entries of a residual, and of the change of a start."""
        self.parameters = parameters_of(craft)
        self.prior, self.nominal, self.least = np.array(
            [(one.prior, one.nominal, one.least) for one in self.parameters]
        ).T
        # The windows of all logs.
        self.logs = logs
        behind = _one_behind_the_other(logs)
        times = []
        readings = []
        for log in behind:
            states = np.column_stack([log.position, log.attitude, log.velocity, log.spin])
            for part in windows_of(log, window):
                times.append(log.times[part])
                readings.append(states[part])
        self.window = window
        self.counts = [len(part) for part in times]
        more = [max(self.counts) - count for count in self.counts]
        self.times = np.stack(
            [np.pad(x, (0, n), mode="edge") for x, n in zip(times, more, strict=True)]
        )
        self.readings = np.stack(
            [
                np.pad(x, ((0, n), (0, 0)), constant_values=np.nan)
                for x, n in zip(readings, more, strict=True)
            ]
        )
        self.thrusts = Thrust.of(craft, behind)
        noise = noise or _FIRST_NOISE
        self.step = STEP * (_FINER if min(noise.values()) < _QUIET else 1.0)
        """s: longest step of predictions."""
        # Where no velocity was measured, windows begin at rest; the fit moves them.
        self.starts = np.nan_to_num(self.readings[:, 0])
        self.values = values
        self.path = self._path(values, self.starts)
        """Predicted states (W, M, columns) for the present values and starts."""
        read = np.isfinite(self._residuals(self.path))
        self.noise = {name: x for name, x in noise.items() if read[..., self.columns[name]].any()}
        """Standard deviations of the errors of readings."""

    def solve(self, iterations: int = _ITERATIONS) -> None:
        """Minimise the cost in at most so many steps, and estimate the noise between them."""
        damping = 1e-3
        settled = False
        for _ in range(iterations):
            linear = self._linear()
            cost = self._cost(self.values, self.path)
            low = (self.least - self.values) / self.prior
            high = (self.nominal - self.values) / self.prior + _FARTHEST
            while damping < _MOST_DAMPING:
                change, moves = linear.step(damping, low, high)
                values = np.maximum(self.values + change * self.prior, self.least)
                starts = self._moved(self.starts, moves)
                path = self._path(values, starts)
                after = self._cost(values, path)
                if after <= cost:
                    self.values = values
                    self.starts = starts
                    self.path = path
                    damping = max(damping * 0.1, 1e-9)
                    changed = self._estimate_noise(linear)
                    # A last step of 0.3 deviations at most: what is left is of second order.
                    settled = cost - after < 0.1 and changed < 1e-2
                    break
                damping *= 10.0
            else:  # no step is an improvement
                break
            if settled:
                break

    def _path(self, values: np.ndarray, starts: np.ndarray) -> np.ndarray:
        physics = physics_of(self.craft, np.repeat(values[None], len(starts), axis=0))
        return predicted(self.craft, self.thrusts, physics, starts, self.times, self.step)

    def _sensitivities(self) -> np.ndarray:
        """Derivatives (W, M, width, P + width) of states by values, in units of prior, and by starts.

        They are finite differences over pieces of about `_SHORT`, all at once, and the chain rule from piece to
        piece, since over a long window a torque turns by more than what is linear. Of each piece there is one set
        as it is, and one for each value and entry of its start.
        """
        count = len(self.values)
        sets = 1 + count + self.width
        windows, readings = self.times.shape
        # Pieces share their ends; the last one repeats the last reading.
        rate = readings / max(float(np.ptp(self.times, axis=1).max()), 1e-6)
        length = max(1, int(_SHORT * rate))
        firsts = np.arange(0, max(readings - 1, 1), length)
        index = np.minimum(firsts[:, None] + np.arange(length + 1), readings - 1)
        times = self.times[:, index].reshape(-1, length + 1)
        values = np.repeat(self.values[None], sets, axis=0)
        values[1 : 1 + count] += np.diag(self.prior * _DIFFERENCE)
        changes = np.zeros((sets, len(times), self.width))
        changes[1 + count :] = _DIFFERENCE * np.eye(self.width)[:, None]
        starts = self.path[:, firsts].reshape(len(times), -1)
        starts = self._moved(np.repeat(starts[None], sets, axis=0), changes)
        ends = predicted(
            self.craft,
            self.thrusts,
            physics_of(self.craft, np.repeat(values, len(times), axis=0)),
            starts.reshape(sets * len(times), -1),
            np.tile(times, (sets, 1)),
            _COARSE * self.step,
        ).reshape(sets, windows, *index.shape, -1)
        slopes = np.moveaxis(self._difference(ends[1:], ends[:1]) / _DIFFERENCE, 0, -1)
        chain = np.zeros((windows, readings, self.width, sets - 1))
        chain[:, 0, :, count:] = np.eye(self.width)
        for k, at in enumerate(index):
            chain[:, at] = slopes[:, k, ..., count:] @ chain[:, at[:1]]
            chain[:, at, :, :count] += slopes[:, k, ..., :count]
        return chain

    def _residuals(self, path: np.ndarray) -> np.ndarray:
        """Readings minus predicted states, (W, M, width); NaN where nothing was measured."""
        return self._difference(self.readings, path)

    def _difference(self, to: np.ndarray, path: np.ndarray) -> np.ndarray:
        """States minus states, (..., width); in space the attitude's is a rotation vector.

        `_moved` is its counterpart: a start that is moved by a small difference differs by it.
        """
        if self.craft.dimension == 2:
            result = to - path
            result[..., 2] = np.mod(result[..., 2] + np.pi, 2.0 * np.pi) - np.pi
            return result
        turn = small_turns(path[..., 3:7], to[..., 3:7])
        return np.concatenate(
            [to[..., :3] - path[..., :3], turn, to[..., 7:] - path[..., 7:]], axis=-1
        )

    def _moved(self, starts: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Starts (..., columns) changed by (..., width); attitudes in space turn by a rotation vector in B.

        A start in space has one column more than its changes, the quaternion's.
        """
        if self.craft.dimension == 2:
            return starts + change
        half = 0.5 * change[..., 3:6]
        small = np.concatenate([np.ones_like(half[..., :1]), half], axis=-1)
        attitude = quaternion_products(starts[..., 3:7], small)
        attitude /= np.linalg.norm(attitude, axis=-1, keepdims=True)
        ends = starts[..., :3] + change[..., :3], attitude, starts[..., 7:] + change[..., 6:]
        return np.concatenate(ends, axis=-1)

    def _weights(self) -> np.ndarray:
        """1 / standard deviation of each entry of a residual; 0 of what was not measured."""
        weights = np.zeros(self.width)
        for name, noise in self.noise.items():
            weights[self.columns[name]] = 1.0 / noise
        return weights

    def _cost(self, values: np.ndarray, path: np.ndarray) -> float:
        off = (values - self.nominal) / self.prior
        weighed = self._residuals(path) * self._weights()
        return float(np.nansum(weighed**2) + np.sum(off**2))

    def _linear(self) -> _Linear:
        """Linear least squares about the present values, starts and path."""
        residual = self._residuals(self.path)
        windows = len(residual)
        weights = np.isfinite(residual) * self._weights()
        jacobian = self._sensitivities() * weights[..., None]
        return _Linear(
            jacobian.reshape(windows, -1, jacobian.shape[-1]),
            np.nan_to_num(residual * self._weights()).reshape(windows, -1),
            (self.nominal - self.values) / self.prior,
        )

    def _estimate_noise(self, linear: _Linear) -> float:
        """Set standard deviations to those of the residuals, and return the largest relative change.

        What was fitted takes degrees of freedom of each channel: the sum of its leverages (the fixed point of
        restricted maximum likelihood: Patterson and Thompson, Biometrika 58, 1971).
        """
        residual = self._residuals(self.path)
        free = np.isfinite(residual) - linear.leverages().reshape(residual.shape)
        change = 0.0
        for name, old in self.noise.items():
            part = self.columns[name]
            square = np.nansum(residual[..., part] ** 2) / max(np.sum(free[..., part]), 1.0)
            self.noise[name] = max(float(np.sqrt(square)), LEAST_NOISE)
            change = max(change, abs(self.noise[name] / old - 1.0))
        return change

    def evidence(self) -> float:
        """Minus twice the logarithm of the likelihood and the prior, up to a constant.

        It compares first latencies, at windows of one length: others would have other starts.
        """
        residual = self._residuals(self.path)
        total = self._cost(self.values, self.path)
        for name, noise in self.noise.items():
            count = np.isfinite(residual[..., self.columns[name]]).sum()
            total += 2.0 * float(count * np.log(noise))
        return total

    def coasting(self) -> dict[str, float]:
        """Standard deviation of each channel about coasts of the windows, which is `Fit.coasting`.

        `result.py` calls a channel explained where its noise is well below this.
        """
        squares = dict.fromkeys(self.noise, 0.0)
        free = dict.fromkeys(self.noise, 0)
        # In space an attitude is its rotation from the window's first.
        moved = self._difference(self.readings, self.readings[:, :1])
        for times, rows in zip(self.times, moved, strict=True):
            for name in self.noise:
                degree = 1 if name in ("position", "attitude") else 0
                for column in rows[:, self.columns[name]].T:
                    read = np.isfinite(column)
                    if read.sum() <= degree + 1:
                        continue
                    values = np.unwrap(column[read]) if name == "attitude" else column[read]
                    terms = np.vander(times[read] - times[0], degree + 1)
                    line = np.linalg.lstsq(terms, values, rcond=None)[0]
                    squares[name] += float(np.sum((values - terms @ line) ** 2))
                    free[name] += int(read.sum()) - degree - 1
        total = {name: np.isfinite(moved[..., self.columns[name]]).sum() for name in self.noise}
        return {
            name: float(np.sqrt(squares[name] / free[name]))
            for name in self.noise
            if free[name] > 0.3 * total[name]
        }

    def fit(self) -> Fit:
        """The result of `solve`."""
        self.solve()

        def in_order(path: np.ndarray) -> np.ndarray:
            rows = zip(self._residuals(path), self.counts, strict=True)
            return np.concatenate([own[:count] for own, count in rows])

        return Fit(
            self.craft,
            self.parameters,
            self.values,
            self._linear().covariance() * np.outer(self.prior, self.prior),
            self.noise,
            in_order(self.path),
            in_order(self._path(self.nominal, self.starts)),
            tuple(self.logs),
            self.window,
            self.coasting(),
        )
