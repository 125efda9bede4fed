"""Least-squares fit of forces, inertia, disturbances and delays to a log, with intervals.

The log is divided into windows, each with a start of its own that is fitted too, so that what the model lacks does
not add up over the flight; they are as long as the model explains the readings. The cost is that of Gaussian errors
of the readings, whose standard deviations are estimated from the residuals and their degrees of freedom, and of a
weak Gaussian prior round the data sheet, which decides what the log does not determine. SciPy minimises it over the
parameters within their bounds; starts of windows are eliminated (variable projection: Golub and Pereyra, Inverse
Problems 19, 2003). The posterior is the Gaussian of the curvature at the optimum (Ljung, System Identification, 2nd
edition, 7.2 and 9.3). Tests fit craft whose values are hidden, and count how many intervals hold them: a change may
not narrow intervals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from rans.extend import Body, ConfigError, Spacecraft, Vec2, Vec3, Wrench, around, map_leaves
from rans_robot.identify.log import FlightLog, checked_log
from rans_robot.identify.motion import (
    Physics,
    advanced,
    changes_of,
    check_identifiable,
    difference,
    integrals_of,
    loads_of,
    state_of,
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
"""m, rad, m/s and rad/s: least noise, of the size of what the steps of predictions leave of a perfect log."""
CHANNELS = ("position", "attitude", "velocity", "spin")
"""Measured quantities, in the order of the columns of a residual."""
_FACTOR_PRIOR = 0.3
"""Standard deviation of the prior of factors on force and inertia: data sheets err by a tenth to a quarter."""
_LEAST_FACTOR = 1e-3
"""Least factor on force and inertia."""
_PRODUCT_PRIOR = 0.1
"""Standard deviation of the prior of products of inertia, as a part of the largest moment."""
_CENTRE_PRIOR = 0.03
"""m: standard deviation of the prior of the centre of mass."""
_LATENCY_PRIOR = 0.2
"""s: standard deviation of the prior of the latency."""
_RISE_PRIOR = 0.03
"""s: standard deviation of the prior of the rise time, about which readings say little beside the latency."""
_FORCE_PRIOR = 0.5
"""Standard deviation of the prior of a disturbance force, as a part of the strongest thruster's force."""
_ROUNDS = 20
"""Most estimates of the noise, between which the cost is minimised; three are usual."""
_EVALUATIONS = 40
"""Most predictions of such a minimisation; it takes about five."""
_FEW = 5
"""Predictions after which the best of several beginnings goes on alone."""
_SHORT = 1.0
"""s: length of the windows of the first fits."""
_FAINT = 10.0
"""Deviation of a faint prior of windows' starts, m, rad, m/s and rad/s: it decides what nothing measured and
nothing shows."""
_FIRST_LATENCIES = (0.02, 0.1, 0.25)
"""s: where the fit begins; the cost has one minimum within a pulse of the right latency."""
_STEP = 0.1
"""s: step of predictions; what it leaves of a turn in which a valve opens is far below the noise of readings."""
_QUIET = 1e-3
"""Noise, m, rad, m/s or rad/s, below which steps are `_FINER`."""
_FINER = 0.25
"""Factor on `_STEP`, whose error goes with the cube."""
_FARTHEST = 20.0
"""Standard deviations of the prior beyond which no value is sought."""
_DIFFERENCE = 1e-4
"""Step of finite differences, in standard deviations of the prior; one step of the motion is linear in it."""
_FIRST_STEP = 5.0
"""Standard deviations of the prior that the first step of the fit may take."""
_SWEEPS = 8
"""Most sweeps of Newton's method through a window; two are usual."""
_CLOSED = 1e-7
"""m, rad, m/s and rad/s by which steps of a window may miss one another."""
_SYSTEMATIC = 0.2
"""Part of what a coast leaves of a channel, up to which errors that the next reading repeats may be. Two swapped
valves leave 0.3 at least, filters over three readings 0.1."""
_PERFECT = 2.0 * LEAST_NOISE
"""Noise (SI) below which nothing is left to explain."""
_LARGEST_ANGLE = 0.5
"""rad: noise of an attitude, above which it is none; angles that say nothing have 1.8 rad."""


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
class Channel:
    """How well one measured quantity was predicted over the windows of the logs."""

    name: str
    before: float
    """Root mean square of reading minus prediction with the data sheet, in the unit of `result.UNITS`."""
    after: float
    """Root mean square of reading minus prediction with what was identified."""
    correlation: float
    """Correlation of successive residuals; 0 for white ones."""
    bound: float
    """Correlation that white residuals exceed in one of a thousand logs at most."""
    is_explained: bool
    """Whether the model leaves nothing but independent noise, or little of what a coast leaves."""

    @property
    def is_white(self) -> bool:
        """Whether the model explains all but independent errors of the readings.

        Fitted starts of short windows make residuals unlike the ones before them, which is no fault of the model.
        """
        return self.correlation <= self.bound


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

    @property
    def deviations(self) -> np.ndarray:
        """(P,), standard deviations of the posterior."""
        return np.sqrt(np.diag(self.covariance))

    @cached_property
    def coasting(self) -> dict[str, float]:
        """Standard deviation that each channel would have if no thruster pushed."""
        shut = [replace(log, commands=np.zeros_like(log.commands)) for log in self.logs]
        values = np.array([parameter.nominal for parameter in self.parameters])
        return _Windows(self.craft, shut, self.window, values).coasting()

    def correlation(self, channel: str) -> tuple[float, float]:
        """Correlation of successive residuals of a channel, and the bound that white ones exceed in 1 of 1,000."""
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

    def channels(self) -> list[Channel]:
        """How well each measured quantity is predicted, before and after.

        The correlation of successive residuals is the part of their power that the next reading repeats: an error
        of the model, which has to be small beside what thrusters do.
        """
        columns = channel_columns(self.craft)
        result = []
        for name, noise in self.noise.items():
            before, after = (
                float(np.sqrt(np.nanmean(rows[:, columns[name]] ** 2)))
                for rows in (self.nominal_residuals, self.residuals)
            )
            correlation, bound = self.correlation(name)
            left = noise * np.sqrt(max(correlation, 0.0))
            small = left < max(_SYSTEMATIC * self.coasting[name], _PERFECT)
            is_turn = name != "attitude" or noise <= _LARGEST_ANGLE
            explained = (small or correlation <= bound) and is_turn
            result.append(Channel(name, before, after, correlation, bound, explained))
        return result

    def is_identifiable(self) -> np.ndarray:
        """(P,), whether the log halves the prior's standard deviation at least."""
        return self.deviations < 0.5 * np.array([parameter.prior for parameter in self.parameters])


def parameters_of(craft: Spacecraft) -> tuple[Parameter, ...]:
    """Quantities that are identified of a spacecraft; its mass is weighed, since motion determines ratios only.

    Their order is that of all vectors of values and of the covariance; `physics_of` reads it one by one.
    """
    check_identifiable(craft)
    axes = "xyz"[: craft.dimension]
    turns = "z" if craft.dimension == 2 else axes
    forces = [thruster.force for thruster in craft.thrusters]
    moments = Body.of(craft).inertia
    names = ("zz",) if craft.dimension == 2 else ("xx", "xy", "xz", "yy", "yz", "zz")
    push = _FORCE_PRIOR * max(forces)
    # Thrusters may all push through the centre of mass: then disturbances have the radius for a lever arm.
    lever = max(float(np.linalg.norm(t.position)) for t in craft.thrusters) or craft.radius
    return (
        *(
            Parameter(f"force of thruster {k}", "N", x, _FACTOR_PRIOR * x, _LEAST_FACTOR * x)
            for k, x in enumerate(forces)
        ),
        *(
            Parameter(f"inertia {name}", "kg m^2", x, _FACTOR_PRIOR * x, _LEAST_FACTOR * x)
            if name[0] == name[1]
            else Parameter(f"inertia {name}", "kg m^2", x, _PRODUCT_PRIOR * max(moments))
            for name, x in zip(names, moments, strict=True)
        ),
        *(Parameter(f"centre {axis}", "m", 0.0, _CENTRE_PRIOR) for axis in axes),
        *(Parameter(f"disturbance {axis}", "N", 0.0, push) for axis in axes),
        *(Parameter(f"torque {axis}", "N m", 0.0, push * lever) for axis in turns),
        Parameter("latency", "s", 0.0, _LATENCY_PRIOR, 0.0),
        Parameter("rise", "s", 0.0, _RISE_PRIOR, 0.0),
    )


def physics_of(craft: Spacecraft, values: np.ndarray) -> Physics:
    """Physics of values (P,) in the order of `parameters_of`, or of K sets of them (K, P) as fields (K, 1, 1)."""
    fields = values.T[(..., *(None, None) * (values.ndim - 1))]
    d = craft.dimension
    turns = craft.degrees_of_freedom - d
    sizes = (craft.thruster_count, 1 if d == 2 else 6, d, d, turns)
    forces, inertia, centre, push, torque, delays = np.split(fields, np.cumsum(sizes))
    gain = [force / one.force for force, one in zip(forces, craft.thrusters, strict=True)]
    body = Body(craft.mass, tuple(inertia), tuple(centre), tuple(gain))
    wrench = Wrench(Vec2(*push), torque[0]) if d == 2 else Wrench(Vec3(*push), Vec3(*torque))
    return Physics(body, wrench, *delays)


def channel_columns(craft: Spacecraft) -> dict[str, np.ndarray]:
    """Columns of each measured quantity in a residual of 6 entries, or 12 in space."""
    half = [craft.dimension, craft.degrees_of_freedom]
    columns = np.arange(2 * half[1])
    return dict(zip(CHANNELS, np.split(columns, [*half, sum(half)]), strict=True))


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
    nominal = [parameter.nominal for parameter in parameters_of(craft)]

    # Fits over short windows from several latencies; the best continues, at last over the windows asked for. Over
    # long ones the data sheet's heading may be wrong by whole turns, where the cost has other minima.
    begun = []
    for beginning in _FIRST_LATENCIES:
        values = np.array([*nominal[:-2], beginning, 0.0])
        begun.append(_Windows(craft, logs, min(first, _SHORT), values))
        begun[-1].solve(1, _FEW)
    near = min(begun, key=_Windows.evidence)
    near.solve()
    *_, latency, rise = near.values
    if latency <= 0.0:
        _check_order(near)
    # The mean delay stays. Readings change with the square of the rise: a fit that comes to none stays there.
    delays = max(latency - 0.5 * _RISE_PRIOR, 0.0), rise + _RISE_PRIOR
    values = np.array([*near.values[:-2], *delays])
    fitted = _Windows(craft, logs, first, values, near.noise).fit()
    return fitted if window is not None else _longest(fitted)


def _check_order(near: _Windows) -> None:
    """Refuse (`ConfigError`) a solved fit without latency whose logs are explained by commands a period earlier.

    No force acts before its command: such logs have each command one control period late.
    """
    logs = near.logs
    early = [replace(log, command_times=log.command_times - log.period) for log in logs]
    solver = _Windows(near.craft, early, near.window, near.values)
    fitted = solver.fit()
    if near.evidence() - solver.evidence() > UNLIKELY**2 and all(
        channel.is_explained for channel in fitted.channels()
    ):
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
        longer = _Windows(fitted.craft, fitted.logs, 2.0 * window, *start).fit()
        moved = np.abs(longer.values - fitted.values) / fitted.deviations
        if moved.max() > UNLIKELY or not longer.is_white():
            break
        fitted = longer
    return fitted


class _Windows:
    """Least squares over the windows (W) of logs, whose readings (M) are those of the longest.

    Shorter ones repeat their last instant, at which nothing is measured. `solve` changes ``offset``, the values as
    standard deviations of the prior from the data sheet, the starts, the path and the noise together. Between two
    readings are as many steps in every window, in all S, which the engine takes at once from the nodes before them.
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
        self.logs = logs
        self.window = window
        self.parameters = parameters_of(craft)
        self.prior, self.nominal, self.least = np.array(
            [(one.prior, one.nominal, one.least) for one in self.parameters]
        ).T
        self.offset = (values - self.nominal) / self.prior
        # The windows of all logs, with times since their begin.
        noise = noise or _FIRST_NOISE
        longest = _STEP * (_FINER if min(noise.values()) < _QUIET else 1.0)
        tables = []
        self.thrusts = []
        for log in logs:
            rows = np.column_stack([log.times, log.position, log.attitude, log.velocity, log.spin])
            changes = changes_of(craft, log)
            for part in windows_of(log, window):
                tables.append(rows[part])
                self.thrusts.append(integrals_of(changes, *tables[-1][[0, -1], 0]))
        counts = np.array([len(table) for table in tables])
        rows = np.stack(
            [
                np.pad(table, ((0, more), (0, 0)), mode="edge")
                for table, more in zip(tables, counts.max() - counts, strict=True)
            ]
        )
        self.own = np.arange(counts.max()) < counts[:, None]
        """(W, M), whether a reading is the window's own."""
        times, columns = rows[..., 0], rows[..., 1:]
        self.readings = state_of(np.where(self.own[..., None], columns, np.nan))
        # Steps, and the nodes that are readings.
        gaps = np.diff(times, axis=1)
        counts = np.maximum(1, np.ceil(np.max(gaps, axis=0) / longest - 1e-9).astype(int))
        self.spans = np.repeat(gaps / counts, counts, axis=1)
        self.times = np.cumsum(np.pad(self.spans, ((0, 0), (1, 0))), axis=1)
        self.nodes_read = np.append(0, np.cumsum(counts))
        # Where no velocity was measured, windows begin at rest; the fit moves them.
        self.starts = map_leaves(lambda x: np.nan_to_num(x[:, 0]), self.readings)
        self.near: Any = None
        """Slopes of steps by their begins (W, S, width, width), and the nodes after them at which they are."""
        self.linear: Any = None
        """See `_derivatives`."""
        self.read = np.isfinite(difference(self.readings, self.readings))
        """(W, M, width), what was measured."""
        self._fly(values)
        columns = channel_columns(craft)
        self.channel = np.repeat(np.arange(len(columns)), [len(part) for part in columns.values()])
        """Channel of each entry of a residual."""
        self.count = self.read.sum((0, 1))
        """Readings of each entry."""
        self.spread = np.array([noise.get(name, np.inf) for name in CHANNELS])
        """Standard deviations of the errors of readings; infinite of what was not measured."""
        self.spread[np.bincount(self.channel, self.count) == 0] = np.inf

    @property
    def noise(self) -> dict[str, float]:
        """Standard deviations of the errors of readings of what was measured."""
        spread = zip(CHANNELS, self.spread.tolist(), strict=True)
        return {name: noise for name, noise in spread if np.isfinite(noise)}

    @property
    def values(self) -> np.ndarray:
        """(P,), present values."""
        return self.nominal + self.prior * self.offset

    def solve(self, rounds: int = _ROUNDS, evaluations: int = _EVALUATIONS) -> None:
        """Minimise the cost, and estimate the noise, until neither changes."""
        low = (self.least - self.nominal) / self.prior
        high = np.full(len(low), _FARTHEST)
        for _ in range(rounds):
            # A step too far may end in no number; SciPy then takes a shorter one.
            with np.errstate(over="ignore", invalid="ignore"):
                found = least_squares(
                    self._errors,
                    np.clip(self.offset, low, high),
                    self._derivatives,
                    (low, high),
                    method="dogbox",
                    # A last step of 0.3 deviations at most: what is left is of second order.
                    ftol=0.1 / self.count.sum(),
                    xtol=1e-6,
                    gtol=None,
                    x_scale=1.0 / _FIRST_STEP,
                    max_nfev=evaluations,
                )
            self._errors(found.x)
            if self._estimate_noise() < 1e-2:
                break

    def _loads(self, physics: Physics) -> Any:
        """Wrenches at both ends of the steps."""
        return loads_of(self.craft, physics, self.thrusts, self.times)

    def _after(self, values: np.ndarray, states: Any) -> Any:
        """States after the steps, from states before them."""
        physics = physics_of(self.craft, values)
        return advanced(physics, states, self._loads(physics), self.spans)

    def _fly(self, values: np.ndarray) -> None:
        """Set the nodes (W, S + 1) of values, and the residuals (W, M, width), from the present starts.

        A residual is a reading minus the predicted state; NaN where nothing was measured.
        """
        self.nodes = self._closed(values) or self._stepped(values)
        path = map_leaves(lambda x: x[:, self.nodes_read], self.nodes)
        self.residuals = difference(self.readings, path)

    def _stepped(self, values: np.ndarray) -> Any:
        """Nodes, one step after the other."""
        physics = physics_of(self.craft, values)
        loads = self._loads(physics)
        nodes = [self.starts]
        for k, span in enumerate(self.spans.T):
            load = map_leaves(lambda x, k=k: x[:, k], loads)
            nodes.append(advanced(physics, nodes[-1], load, span))
        return map_leaves(lambda *x: np.stack(x, axis=1), *nodes)

    def _closed(self, values: np.ndarray) -> Any:
        """Nodes by Newton's method from those nearby, with all steps at once; None where it does not converge."""
        if self.near is None:
            return None
        slopes, ends = self.near
        for _ in range(_SWEEPS):
            moves = difference(
                self._after(values, map_leaves(lambda x: x[:, :-1], self._nodes(ends))), ends
            )
            for k in range(1, moves.shape[1]):
                moves[:, k] += (slopes[:, k] @ moves[:, k - 1, :, None])[..., 0]
            ends = around(ends, np.moveaxis(moves, -1, 0))
            if np.abs(moves).max() < _CLOSED:
                return self._nodes(ends)
        return None

    def _nodes(self, ends: Any) -> Any:
        """Nodes of the present starts and of the states after steps."""
        return map_leaves(lambda a, x: np.column_stack([a, x]), self.starts, ends)

    def _sensitivities(self) -> np.ndarray:
        """Derivatives (W, M, width, P + width) of the path by values, in units of prior, and by starts.

        Those of each step are differences between sets of values and states, as they are and with one entry
        changed; the chain rule joins the steps.
        """
        count = len(self.prior)
        width = len(self.channel)
        changes = _DIFFERENCE * np.eye(1 + count + width, count + width, -1)
        begins = map_leaves(lambda x: x[:, :-1], self.nodes)
        ends = self._after(
            self.values + changes[:, :count] * self.prior,
            around(begins, changes.T[count:, :, None, None]),
        )
        change = difference(ends, map_leaves(lambda x: x[:1], ends))[1:]
        steps = np.moveaxis(change, 0, -1) / _DIFFERENCE
        of_begins = steps[..., count:]
        self.near = of_begins, map_leaves(lambda x: x[:, 1:], self.nodes)
        chain = [np.eye(width, count + width, count) + np.zeros((len(steps), 1, 1))]
        for k in range(steps.shape[1]):
            chain.append(of_begins[:, k] @ chain[-1])
            chain[-1][..., :count] += steps[:, k, :, :count]
        return np.stack([chain[k] for k in self.nodes_read], axis=1)

    def _weighed(self) -> np.ndarray:
        """Residuals in standard deviations, (W, M width); 0 of what was not measured."""
        weighed = np.where(self.read, self.residuals, 0.0) / self.spread[self.channel]
        return weighed.reshape(len(weighed), -1)

    def _errors(self, offset: np.ndarray) -> np.ndarray:
        """Numbers whose squares are summed: weighed residuals, and the offsets. The starts follow the values."""
        self.offset = offset
        if self.linear is not None:
            before, starts, rest, of_values, r, q, _ = self.linear
            left = rest - of_values @ (offset - before)
            self.starts = around(starts, np.linalg.solve(r, q.mT @ left[..., None])[..., 0].T)
        self._fly(self.values)
        return np.concatenate([self._weighed().ravel(), offset])

    def _derivatives(self, offset: np.ndarray) -> np.ndarray:
        """Derivatives of `_errors`, to which the starts are fitted: work grows with the number of windows only.

        A faint prior of starts stands below the rows of each window.
        """
        rest = self._weighed()
        weights = self.read / self.spread[self.channel]
        slopes = (self._sensitivities() * weights[..., None]).reshape(*rest.shape, -1)
        of_values, of_starts = np.split(slopes, [len(offset)], axis=-1)
        width = of_starts.shape[-1]
        faint = np.eye(width) / _FAINT + np.zeros((len(rest), 1, 1))
        q, r = np.linalg.qr(np.concatenate([of_starts, faint], axis=1))
        q = q[:, :-width]
        own = of_values - q @ (q.mT @ of_values)
        self.linear = offset, self.starts, rest, of_values, r, q, own
        return np.concatenate([-own.reshape(-1, len(offset)), np.eye(len(offset))])

    def _covariance(self) -> np.ndarray:
        """(P, P) of the offsets, the starts integrated out."""
        rows = self.linear[-1].reshape(-1, len(self.prior))
        return np.linalg.inv(rows.T @ rows + np.eye(len(self.prior)))

    def _estimate_noise(self) -> float:
        """Set standard deviations to those of the residuals, and return the largest relative change.

        What was fitted takes degrees of freedom of each channel: the sum of its leverages (the fixed point of
        restricted maximum likelihood: Patterson and Thompson, Biometrika 58, 1971).
        """
        old = self.spread
        *_, q, own = self.linear
        leverages = np.sum(q**2, axis=-1) + np.sum(own @ self._covariance() * own, axis=-1)
        free = self.count - leverages.reshape(self.residuals.shape).sum((0, 1))
        squares = np.nansum(self.residuals**2, (0, 1))
        free, squares = (np.bincount(self.channel, x) for x in (free, squares))
        noise = np.maximum(np.sqrt(squares / np.maximum(free, 1.0)), LEAST_NOISE)
        read = np.isfinite(old)
        self.spread = np.where(read, noise, old)
        return float(np.max(np.abs(noise / old - 1.0)[read]))

    def evidence(self) -> float:
        """Minus twice the logarithm of the likelihood and the prior, up to a constant.

        It compares first latencies, at windows of one length: others would have other starts.
        """
        spread = np.where(self.count > 0, self.spread[self.channel], 1.0)
        errors = np.append(self._weighed(), self.offset)
        return float(errors @ errors + 2.0 * self.count @ np.log(spread))

    def coasting(self) -> dict[str, float]:
        """Standard deviation of each channel about paths of the present values, whose starts alone are fitted."""
        for _ in range(2):
            self._derivatives(self.offset)
            self._errors(self.offset)
        self._estimate_noise()
        return self.noise

    def fit(self) -> Fit:
        """The result of `solve`."""
        self.solve()
        residuals = self.residuals
        # The data sheet's, from the same starts.
        self._fly(self.nominal)
        before, self.residuals = self.residuals, residuals
        return Fit(
            self.craft,
            self.parameters,
            self.values,
            self._covariance() * np.outer(self.prior, self.prior),
            self.noise,
            residuals[self.own],
            before[self.own],
            tuple(self.logs),
            self.window,
        )
