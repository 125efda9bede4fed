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

from rans.extend import Body, ConfigError, Spacecraft, Vec2, Vec3, Wrench
from rans_robot.frames import quaternion_products, small_turns
from rans_robot.identify.log import FlightLog, checked_log
from rans_robot.identify.motion import (
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
_COARSE = 0.05
"""s: longest step for derivatives, whose errors only direct the steps of the fit."""
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
    """Readings minus prediction of each log, (M, 6 or 12); in space the attitude's is a rotation vector."""
    nominal_residuals: tuple[np.ndarray, ...]
    """Readings minus the prediction of the data sheet, of each log, from the same starts of windows."""
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
        columns = channel_columns(self.craft)[channel]
        rows = [part[:, columns] for part in self.residuals]
        pairs = [(part[:-1].ravel(), part[1:].ravel()) for part in rows]
        first, second = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
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
    latency = next(columns)
    rise = next(columns)
    return Physics(body, push, latency, rise)


class _Problem:
    """Residuals of logs as a function of parameters and the windows' starts, in SI units, groups in order."""

    def __init__(self, craft: Spacecraft, logs: Sequence[FlightLog], window: float) -> None:
        self.craft = craft
        self.parameters = parameters_of(craft)
        self.planar = craft.dimension == 2
        self.width = 6 if self.planar else 12
        """Entries of a residual, and of the change of a start."""
        self.groups: list[_Group] = []
        for number, log in enumerate(logs):
            windows = windows_of(log, window)
            thrusts = Thrust.of(craft, log)
            for length in sorted({part.stop - part.start for part in windows}):
                alike = [part for part in windows if part.stop - part.start == length]
                self.groups.append(_Group(number, log, thrusts, alike))

    def paths(self, group: _Group, values: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """Predicted states (W, M, columns) of the W windows of a group, for values (P,) and starts (W, columns)."""
        physics = physics_of(self.craft, np.repeat(values[None], len(starts), axis=0))
        return predicted(self.craft, group.thrusts, physics, starts, group.begin, group.times)

    def sensitivities(self, group: _Group, values: np.ndarray, path: np.ndarray) -> np.ndarray:
        """Derivatives (W, M, width, P + width) of a group's states by values, in units of prior, and by starts.

        They are finite differences over pieces of about `_SHORT`, all at once, and the chain rule from piece to
        piece: the derivatives of a long window cost what those of short ones do.
        """
        prior = np.array([parameter.prior for parameter in self.parameters])
        count = len(prior)
        windows, readings = group.times.shape
        chain = np.zeros((windows, readings, self.width, count + self.width))
        chain[:, 0, :, count:] = np.eye(self.width)
        if readings == 1:
            return chain
        # Pieces begin at every so many readings; the last one repeats the last reading.
        length = max(1, int(_SHORT / max(np.median(np.diff(group.times)), 1e-6)))
        firsts = np.arange(0, readings - 1, length)
        index = np.minimum(firsts[:, None] + 1 + np.arange(length), readings - 1)
        begin = group.times[:, firsts].ravel()
        times = group.times[:, index].reshape(-1, length)
        start = path[:, firsts].reshape(len(begin), -1)
        # One set of values as they are, one for each parameter, and one for each entry of the starts.
        sets = 1 + count + self.width
        physics = np.repeat(values[None], sets, axis=0)
        physics[1 : 1 + count] += np.diag(prior * _DIFFERENCE)
        starts = np.repeat(start[None], sets, axis=0)
        for j in range(self.width):
            change = np.zeros((len(start), self.width))
            change[:, j] = _DIFFERENCE
            starts[1 + count + j] = self.moved(start, change)
        ends = predicted(
            self.craft,
            group.thrusts,
            physics_of(self.craft, np.repeat(physics, len(begin), axis=0)),
            starts.reshape(sets * len(begin), -1),
            np.tile(begin, sets),
            np.tile(times, (sets, 1)),
            _COARSE,
        ).reshape(sets, windows, len(firsts), length, -1)
        changes = self.difference(ends[1:], ends[:1]) / _DIFFERENCE
        of_values, of_starts = np.split(np.moveaxis(changes, 0, -1), [count], axis=-1)
        for k, first in enumerate(firsts):
            at = index[k]
            chain[:, at] = of_starts[:, k] @ chain[:, first, None]
            chain[:, at, :, :count] += of_values[:, k]
        return chain

    def difference(self, to: np.ndarray, path: np.ndarray) -> np.ndarray:
        """States or readings minus predicted states, (..., width); in space the attitude's is a rotation vector.

        `moved` is its counterpart: a start that is moved by a small difference differs by it.
        """
        if self.planar:
            result = to - path
            result[..., 2] = np.mod(result[..., 2] + np.pi, 2.0 * np.pi) - np.pi
            return result
        turn = small_turns(path[..., 3:7], to[..., 3:7])
        return np.concatenate(
            [to[..., :3] - path[..., :3], turn, to[..., 7:] - path[..., 7:]], axis=-1
        )

    def moved(self, starts: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Starts (W, columns) changed by (W, width); attitudes in space turn by a rotation vector in B.

        A start in space has one column more than its changes, the quaternion's.
        """
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
    """Windows (W) of one log that have equally many readings (R), as arrays (W, R, ...), SI units.

    ``starts`` (W, width) are the first readings, or a guess where one is missing: where the fit begins.
    """

    def __init__(
        self,
        number: int,
        log: FlightLog,
        thrusts: Thrust,
        windows: Sequence[slice],
    ) -> None:
        self.number = number
        self.windows = windows
        self.thrusts = thrusts
        columns = np.column_stack([log.position, log.attitude, log.velocity, log.spin])
        self.times = np.stack([log.times[part] for part in windows])
        self.begin = self.times[:, 0]
        self.readings = np.stack([columns[part] for part in windows])
        # Where no velocity was measured, windows begin at rest; the fit moves them.
        self.starts = np.nan_to_num(self.readings[:, 0])


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
    steady = [
        log
        if log.steady_times is None
        else replace(log, command_times=log.steady_times, notes=(*log.notes, _steady_note(log)))
        for log in logs
    ]
    # Commands whose departure is not known may have left at a steady rate.
    datings = [logs] if all(log.steady_times is None for log in logs) else [logs, steady]

    # Fits over short windows from several latencies; the best continues, at last over the windows asked for. Over
    # long ones the data sheet's heading may be wrong by whole turns, where the cost has other minima.
    solvers = []
    for dated in datings:
        short = _Problem(craft, dated, min(first, _SHORT))
        for beginning in _FIRST_LATENCIES:
            values = nominal.copy()
            values[latency] = beginning
            solver = _Solver(short, values)
            solver.solve(_FEW)
            solvers.append((solver.evidence(), len(solvers), solver, dated))
    _, _, near, logs = min(solvers)
    near.solve()
    if near.values[latency] <= 0.0:
        _check_order(near, craft, logs, min(first, _SHORT))
    fitted = _fitted(craft, logs, first, near.values, near.noise)
    return fitted if window is not None else _longest(fitted)


def _check_order(
    near: _Solver, craft: Spacecraft, logs: Sequence[FlightLog], window: float
) -> None:
    """Refuse (`ConfigError`) commands that act before they are: a force has no latency below 0.

    Where the latency ends at its bound, a fit with all commands a control period earlier decides, over windows of
    the same length, s.
    """
    early = [replace(log, command_times=log.command_times - log.period) for log in logs]
    solver = _Solver(_Problem(craft, early, window), near.values)
    solver.solve()
    if near.evidence() - solver.evidence() > UNLIKELY**2:
        raise ConfigError(
            f"the log {logs[0].source} explains its readings better if every command was given one control period, "
            f"{logs[0].period:.4g} s, before its time: nothing is identified. The usual cause is a column of "
            "what was applied until this row: write each command in the row from which on it holds."
        )


def _steady_note(log: FlightLog) -> str:
    """That a log's commands are dated by a steady rate, and by how much they were recorded later."""
    assert log.steady_times is not None
    late = 1e3 * (log.command_times - log.steady_times)
    period = np.median(np.diff(log.steady_times))
    return (
        f"{log.source}: the readings are explained better if commands left every {period:.4g} s and were recorded "
        f"up to {late.max():.3g} ms later, so they are dated so."
    )


def _fitted(
    craft: Spacecraft,
    logs: Sequence[FlightLog],
    window: float,
    values: np.ndarray,
    noise: dict[str, float],
) -> Fit:
    """Fit over windows of a length, s, from values (P,) and noise near those at the optimum."""
    solver = _Solver(_Problem(craft, logs, window), values, noise)
    solver.solve()
    return Fit(
        craft,
        solver.problem.parameters,
        solver.values,
        solver.covariance(),
        solver.noise,
        solver.residuals(len(logs)),
        solver.nominal_residuals(len(logs)),
        tuple(logs),
        window,
        solver.coasting(),
    )


def _longest(fitted: Fit) -> Fit:
    """The fit over the longest windows, by doubling, that the model explains.

    Every window begins with unknown velocities, so information about forces grows with its length. But over a long
    one errors of the model add up. They show in correlated residuals, or in values that differ from those over
    windows of half the length by more than the deviations of these (Hausman, Econometrica 46, 1978).
    """
    longest = max(log.duration for log in fitted.logs)
    while (window := fitted.window) < min(longest, _LONGEST) and fitted.is_white():
        longer = _fitted(fitted.craft, fitted.logs, 2.0 * window, fitted.values, fitted.noise)
        moved = np.abs(longer.values - fitted.values) / fitted.deviations
        if moved.max() > UNLIKELY or not longer.is_white():
            break
        fitted = longer
    return fitted


class _Normal:
    """Normal equations of values, in units of their prior, and of the starts of W windows, each beside its own.

    The starts are eliminated first (Schur's complement), so that the work grows with the number of windows only.
    """

    def __init__(
        self,
        rows: Sequence[np.ndarray],
        rests: Sequence[np.ndarray],
        prior: np.ndarray,
    ) -> None:
        """From weighed derivatives (W, N, P + width) and residuals (W, N) of each group, and of the prior (P,)."""
        count = len(prior)
        self.rows = [np.split(jacobian, [count], axis=-1) for jacobian in rows]
        """Derivatives by values and by starts, of each group."""
        self.corner = np.eye(count)
        self.right = prior.copy()
        sides = []
        blocks = []
        rights = []
        for (of_values, of_starts), rest in zip(self.rows, rests, strict=True):
            self.corner += np.tensordot(of_values, of_values, ((0, 1), (0, 1)))
            self.right += np.tensordot(of_values, rest, ((0, 1), (0, 1)))
            sides.append(of_values.mT @ of_starts)
            blocks.append(of_starts.mT @ of_starts)
            rights.append((of_starts.mT @ rest[..., None])[..., 0])
        self.sides = np.concatenate(sides)
        self.blocks = np.concatenate(blocks)
        self.blocks = self.blocks + np.eye(self.blocks.shape[-1]) / _FAINT**2
        self.rights = np.concatenate(rights)

    def solved(self, damping: float, at_least: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Changes of values (P,) and starts (W, width), with the diagonal increased by a factor of it.

        Of the values at their least (P,), those stay that would become smaller.
        """
        stay = np.zeros_like(at_least)
        while True:
            values, starts = self._solved(damping, stay)
            more = at_least & (values < 0.0)
            if not more.any():
                return values, starts
            stay |= more

    def _solved(self, damping: float, stay: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Changes of values (P,) and of windows' starts with a damping.

        Values that ``stay`` (P,) at a bound do not move.
        """
        corner = self.corner + damping * np.diag(np.diag(self.corner))
        extra = damping * np.einsum("wii->wi", self.blocks)
        inverse = np.linalg.inv(self.blocks + extra[..., None] * np.eye(extra.shape[-1]))
        across = self.sides @ inverse
        reduced = corner - np.tensordot(across, self.sides, ((0, 2), (0, 2)))
        right = self.right - np.tensordot(across, self.rights, ((0, 2), (0, 1)))
        values = np.zeros_like(right)
        values[~stay] = np.linalg.solve(reduced[~stay][:, ~stay], right[~stay])
        starts = inverse @ (self.rights - values @ self.sides)[..., None]
        return values, starts[..., 0]

    def reduced(self) -> np.ndarray:
        """Information (P, P) about the values, the starts integrated out."""
        across = self.sides @ np.linalg.inv(self.blocks)
        return self.corner - np.tensordot(across, self.sides, ((0, 2), (0, 2)))

    def leverages(self) -> list[np.ndarray]:
        """Derivatives (W, N) of each group's predictions by their readings: 1 where a reading is fitted exactly.

        `_Solver` divides squares of residuals by the degrees of freedom that they leave, which is the noise.
        """
        inverse = np.linalg.inv(self.blocks)
        of_values = np.linalg.inv(self.reduced())
        across = inverse @ self.sides.mT
        result = []
        begin = 0
        for by_values, by_starts in self.rows:
            part = slice(begin, begin + len(by_values))
            begin = part.stop
            rest = by_values - by_starts @ across[part]
            own = np.einsum("wni,wni->wn", by_starts @ inverse[part], by_starts)
            result.append(own + np.einsum("wnp,wnp->wn", rest @ of_values, rest))
        return result


class _Solver:
    """Gauss-Newton iterations from one set of values; `solve` changes values, starts, paths and noise together."""

    def __init__(
        self, problem: _Problem, values: np.ndarray, noise: dict[str, float] | None = None
    ) -> None:
        self.problem = problem
        self.values = values
        self.starts = [group.starts for group in problem.groups]
        self.columns = channel_columns(problem.craft)
        self.paths = self._paths(values, self.starts)
        """Predicted states of each group, for the present values and starts."""
        measured = {
            name
            for name, part in self.columns.items()
            if any(
                np.isfinite(residual[..., part]).any() for residual in self._residuals(self.paths)
            )
        }
        self.noise = {name: x for name, x in (noise or _FIRST_NOISE).items() if name in measured}
        """Standard deviations of the errors of readings."""

    def solve(self, iterations: int = _ITERATIONS) -> None:
        """Minimise the cost in at most so many steps, and estimate the noise between them.

        Changes values, starts, paths and noise.
        """
        problem = self.problem
        prior = np.array([parameter.prior for parameter in problem.parameters])
        nominal = np.array([parameter.nominal for parameter in problem.parameters])
        least = np.array([parameter.least for parameter in problem.parameters])
        damping = 1e-3
        settled = False
        for _ in range(iterations):
            normal = self._normal()
            cost = self._cost(self.values, self.paths)
            while damping < _MOST_DAMPING:
                change, moves = normal.solved(damping, self.values <= least)
                values = np.clip(self.values + change * prior, least, nominal + 20.0 * prior)
                starts = self._moved(moves)
                paths = self._paths(values, starts)
                after = self._cost(values, paths)
                if after <= cost:
                    self.values = values
                    self.starts = starts
                    self.paths = paths
                    damping = max(damping * 0.1, 1e-9)
                    changed = self._estimate_noise(normal)
                    # A last step of 0.3 deviations at most: what is left is of second order.
                    settled = cost - after < 0.1 and changed < 1e-2
                    break
                damping *= 10.0
            else:  # no step is an improvement
                break
            if settled:
                break

    def _paths(self, values: np.ndarray, starts: Sequence[np.ndarray]) -> list[np.ndarray]:
        groups = self.problem.groups
        return [
            self.problem.paths(group, values, own)
            for group, own in zip(groups, starts, strict=True)
        ]

    def _residuals(self, paths: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Readings minus predicted states of each group, (W, M, width)."""
        groups = self.problem.groups
        return [
            self.problem.difference(group.readings, path)
            for group, path in zip(groups, paths, strict=True)
        ]

    def _moved(self, moves: np.ndarray) -> list[np.ndarray]:
        """Starts of all groups, changed by (W, width) of all windows (m, rad, m/s, rad/s)."""
        ends = np.cumsum([len(starts) for starts in self.starts])[:-1]
        return [
            self.problem.moved(starts, own)
            for starts, own in zip(self.starts, np.split(moves, ends), strict=True)
        ]

    def _weights(self) -> np.ndarray:
        """1 / standard deviation of each entry of a residual."""
        weights = np.zeros(self.problem.width)
        for name, noise in self.noise.items():
            weights[self.columns[name]] = 1.0 / noise
        return weights

    def _cost(self, values: np.ndarray, paths: Sequence[np.ndarray]) -> float:
        weights = self._weights()
        total = sum(float(np.nansum((x * weights) ** 2)) for x in self._residuals(paths))
        return total + float(np.sum(self._from_prior(values) ** 2))

    def _from_prior(self, values: np.ndarray) -> np.ndarray:
        parameters = self.problem.parameters
        return np.array(
            [
                (v - parameter.nominal) / parameter.prior
                for v, parameter in zip(values, parameters, strict=True)
            ]
        )

    def _normal(self) -> _Normal:
        """Normal equations for values in units of their prior, and for starts.

        It is for the present `paths`, which must be those of the present values and starts.
        """
        problem = self.problem
        weights = self._weights()
        rows = []
        rests = []
        for group, path, residual in zip(
            problem.groups, self.paths, self._residuals(self.paths), strict=True
        ):
            # What was not measured tells nothing.
            jacobian = problem.sensitivities(group, self.values, path)
            jacobian *= (np.isfinite(residual) * weights)[..., None]
            rows.append(jacobian.reshape(len(path), -1, jacobian.shape[-1]))
            rests.append(np.nan_to_num(residual * weights).reshape(len(path), -1))
        return _Normal(rows, rests, -self._from_prior(self.values))

    def _estimate_noise(self, normal: _Normal) -> float:
        """Set standard deviations to those of the residuals, and return the largest relative change.

        What was fitted takes degrees of freedom of each channel: the sum of its leverages (the fixed point of
        restricted maximum likelihood: Patterson and Thompson, Biometrika 58, 1971).
        """
        sums = dict.fromkeys(self.columns, 0.0)
        free = dict.fromkeys(self.columns, 0.0)
        for residual, leverage in zip(self._residuals(self.paths), normal.leverages(), strict=True):
            taken = leverage.reshape(residual.shape)
            for name, part in self.columns.items():
                channel = residual[..., part]
                sums[name] += float(np.nansum(channel**2))
                free[name] += float(np.sum(np.isfinite(channel) - taken[..., part]))
        change = 0.0
        for name, old in self.noise.items():
            new = max(float(np.sqrt(sums[name] / max(free[name], 1.0))), 1e-6)
            change = max(change, abs(new / old - 1.0))
            self.noise[name] = new
        return change

    def evidence(self) -> float:
        """Minus twice the logarithm of the likelihood and the prior, up to a constant.

        It compares first latencies and ways to date commands, at windows of one length: others would have other
        starts.
        """
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
        prior = np.array([parameter.prior for parameter in self.problem.parameters])
        return np.linalg.inv(self._normal().reduced()) * np.outer(prior, prior)

    def coasting(self) -> dict[str, float]:
        """Standard deviation of each channel about coasts of the windows, which is `Fit.coasting`.

        `result.py` calls a channel explained where its noise is well below this.
        """
        squares = dict.fromkeys(self.columns, 0.0)
        free = dict.fromkeys(self.columns, 0)
        total = dict.fromkeys(self.columns, 0)
        for group in self.problem.groups:
            for times, readings in zip(group.times, group.readings, strict=True):
                # In space an attitude is its rotation from the window's first.
                first = np.broadcast_to(readings[:1], readings.shape)
                moved = self.problem.difference(readings, first)
                for name, part in self.columns.items():
                    degree = 1 if name in ("position", "attitude") else 0
                    for column in moved[:, part].T:
                        read = np.isfinite(column)
                        total[name] += int(read.sum())
                        if read.sum() <= degree + 1:
                            continue
                        values = np.unwrap(column[read]) if name == "attitude" else column[read]
                        terms = np.vander(times[read] - times[0], degree + 1)
                        line = np.linalg.lstsq(terms, values, rcond=None)[0]
                        squares[name] += float(np.sum((values - terms @ line) ** 2))
                        free[name] += int(read.sum()) - degree - 1
        return {
            name: float(np.sqrt(squares[name] / free[name]))
            for name in self.noise
            if free[name] > 0.3 * total[name]
        }

    def residuals(self, logs: int) -> tuple[np.ndarray, ...]:
        """Residuals of each log in the order of its readings."""
        return self._in_order(self.paths, logs)

    def nominal_residuals(self, logs: int) -> tuple[np.ndarray, ...]:
        """Readings minus the data sheet's prediction from the same starts, in the order of the readings."""
        nominal = np.array([parameter.nominal for parameter in self.problem.parameters])
        return self._in_order(self._paths(nominal, self.starts), logs)

    def _in_order(self, paths: Sequence[np.ndarray], logs: int) -> tuple[np.ndarray, ...]:
        """Residuals of paths by log, (rows, width) each, in the order of time whatever the groups."""
        parts: list[list[tuple[int, np.ndarray]]] = [[] for _ in range(logs)]
        for group, residual in zip(self.problem.groups, self._residuals(paths), strict=True):
            for part, own in zip(group.windows, residual, strict=True):
                parts[group.number].append((part.start, own))
        return tuple(
            np.concatenate([own for _, own in sorted(section, key=lambda pair: pair[0])])
            for section in parts
        )
