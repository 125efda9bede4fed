"""Inertia of a satellite whose reaction wheels alone turn it, from attitude, rates and wheel speeds.

Wheels do not change the angular momentum of the whole in inertial axes, R (J w + the sum of a_i I_i s_i), with the
inertia J of body and locked wheels, and the axes a_i, inertias I_i and speeds s_i of the wheels; only an external
torque does. One row of a log gives this momentum without a derivative and without its time stamp, so that stamps of
whole seconds do no harm. The rate that the momentum predicts is compared with the rate that was read.

The external torque is not known, and changes along the orbit. It has two parts, whose sizes the log decides: a
torque of a lever that is fixed in the body in a field that changes slowly in inertial axes (a magnetic dipole, drag
beside the centre of mass), and a random walk of the momentum (gravity gradient, and whatever else acts).

Errors are those of rates, speeds and attitudes, and of the instants at which speeds and attitudes of one row were
read beside its rates: a mean delay, which is fitted, and a jitter, which counts in proportion to the acceleration
of the wheels and to the turn of the momentum in the body. Their standard deviations are those of restricted maximum
likelihood (Patterson and Thompson, Biometrika 58, 1971), the values those of generalised least squares at adjusted
rates and speeds: a regression on what was read would shrink inertia and wheels (errors in variables: Fuller,
Measurement Error Models, 1987). Before that `kinematics` makes rates and attitudes agree, and finds the
accelerations that a delay multiplies: differences of noisy speeds would shrink the delay, and the values take over
what it leaves. Errors of what agrees alternate from row to row, so that a slow torque sees less of them than of
independent ones: intervals of torques have their joint covariance. Arrays are (N, 3) in the axes of the first
attitudes unless said otherwise; hidden satellites in the tests hold its intervals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import get_lapack_funcs

from rans.extend import ConfigError, Spacecraft
from rans_robot.identify.kinematics import factor, likeliest, smoothed
from rans_robot.identify.log import FlightLog, rotations, turn
from rans_robot.identify.orbit_torques import AIR, DIPOLE, PARTS, OrbitTorques, has_orbit

_COMPONENTS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Entries of the inertia tensor in the order of `Body.inertia`."""
_WALK_KNOT = 45.0
"""s: least distance of the knots of the random walk."""
_MOST_WALK = 40
"""Most of its knots, so that a log of hours costs what one of minutes does."""
_FIELD_KNOT = 300.0
"""s: least distance of the knots of the field: it turns once in 47 minutes, half a low orbit."""
_MOST_FIELD = 12
"""Most of its knots."""
_FIELD_TIME = 600.0
"""s over which the field keeps its direction: a fifth of a turn."""
_FLAT = 1e3
"""Standard deviation of a momentum before, in the units of the largest one that was read."""
_ROUNDS = 6
"""Most rounds of values and standard deviations; three suffice."""
_STEPS = 30
"""Most steps for values; ten suffice."""
_OUTLIER = 5.0
"""Standard deviations (of three numbers together) from which a row is left out: one of 200,000 normal ones is."""


@dataclass(frozen=True)
class _Spread:
    """A standard deviation that the log decides."""

    name: str
    first: float
    """Where the search begins."""
    low: float
    high: float


_SPREADS = (
    _Spread("spin", 1e-3, 1e-6, 0.1),
    _Spread("wheel speed", 0.1, 1e-3, 20.0),
    _Spread("attitude", 3e-3, 1e-5, 0.2),
    _Spread("jitter of speeds", 0.1, 1e-4, 3.0),
    _Spread("jitter of attitudes", 0.1, 1e-4, 3.0),
    _Spread("walk", 1e-3, 1e-5, 1.0),
    _Spread("lever", 1e-3, 1e-6, 0.3),
)
"""rad/s, rad/s, rad, s, s; then in units of a wheel's inertia: rad/s per root of s, and rad/s^2."""
_STAMPS_OFF = 0.41
"""s: standard deviation of what all time stamps of whole seconds are off by together: half a second if they are
rounded down or up, nothing if to the nearest, and logs do not say which."""
_STAMP_APART = 0.29
"""s: standard deviation of what each of them is off by beside that, evenly within a second."""
_FIRST_WALK = 1e-2
"""Where the search of the walk begins: values that are fitted without a torque that acts explain it as noise of
rates, and then no walk is left to be searched for."""


@dataclass(frozen=True)
class Torque:
    """External torque during a log, the mean of each stretch between two knots."""

    source: str
    """The log."""
    times: np.ndarray
    """(K + 1,), s: ends of the stretches."""
    torque: np.ndarray
    """(K, 3), N m, in the inertial axes of the log's attitudes (the first of its frames)."""
    deviation: np.ndarray
    """(K, 3), standard deviation of it, N m."""


@dataclass(frozen=True)
class Source:
    """What a part of the external torque comes from, during a log that has positions and fields."""

    name: str
    """Such as "air"."""
    values: np.ndarray
    """(P,): the three components of the dipole, A m^2, or of the lever of the air times its force, N m; none of the
    gradient of gravity, which the inertia gives."""
    covariance: np.ndarray
    """(P, P)."""
    torque: Torque


@dataclass(frozen=True)
class MomentumFit:
    """Values, their covariance and what they leave; see `rans_robot.identify.fit.Fit` for the arrays."""

    values: np.ndarray
    """(8 + W,): moments and products of inertia, kg m^2; inertias of wheels; delays of speeds and attitudes, s."""
    covariance: np.ndarray
    spreads: dict[str, float]
    """Standard deviations of errors."""
    residuals: tuple[np.ndarray, ...]
    """(M, 3) of each log, rad/s: rates that were read minus predicted ones; NaN where a row was left out."""
    nominal_residuals: tuple[np.ndarray, ...]
    """(M, 3) of each log, rad/s: the same with the craft of the data sheet."""
    white: tuple[np.ndarray, ...]
    """(M, 3), residuals in their standard deviations."""
    torques: tuple[Torque, ...]
    sources: tuple[Source, ...]
    """Parts of the torques of logs with positions and fields."""
    outliers: int
    """Rows that were left out, since they were off by more than `_OUTLIER`."""
    outside: float
    """External torque as a part of the torque of the wheels, both root mean squares."""
    inflation: float
    """Factor by which variances are larger, since successive residuals are alike."""


class _Rows:
    """Readings of a log in which everything was measured, and the momenta that external torques give.

    N rows, SI units; momenta are in ``unit`` (kg m^2). ``weight`` and both errors are changed by the fit.
    """

    def __init__(self, as_read: FlightLog, unit: float) -> None:
        # What `index` has is the rows with everything; `t` counts from the first of these, s.
        log, self.links = smoothed(as_read)
        assert log.wheel_speeds is not None
        read = self.links.rows
        self.log = log
        self.index = np.flatnonzero(read)
        self.t = log.times[read] - log.times[read][0]
        self.rates = log.spin[read]
        self.smoothed = as_read.spin[read] - self.rates
        """(N, 3), rad/s: errors of rates that the attitudes beside them show."""
        self.speeds = log.wheel_speeds[read]
        self.rotation = rotations(log.attitude[read])
        frames = log.frames
        self.frame = np.zeros(len(self.t), int) if frames is None else frames[read]
        self.acceleration = self.links.acceleration
        self.jerk = np.gradient(self.acceleration, self.t, axis=0)
        self.weight = np.ones(len(self.t))
        """(N,), 0 for rows that are left out."""
        self.rate_errors = np.zeros_like(self.rates)
        self.speed_errors = np.zeros_like(self.speeds)
        """(N, 3) and (N, W), rad/s: errors of readings as the present values say, most probable ones."""
        # Axes of all frames are those of the first, so that a field keeps its direction when a goal changes.
        aligned = self._aligned()
        count = len(self.t)
        own = [np.where(self.frame == number, 1.0, 0.0) for number in np.unique(self.frame)]
        self.starts = np.stack(own, axis=1)

        # Random walk: each stretch between two knots adds a momentum.
        length = max(self.t[-1], 1.0)
        stretches = int(np.clip(np.ceil(length / _WALK_KNOT), 1, _MOST_WALK))
        self.knots = np.linspace(0.0, length, stretches + 1)
        self.stretch = length / stretches
        ramps = np.clip((self.t[:, None] - self.knots[:-1]) / self.stretch, 0.0, 1.0)

        # What is fixed in the body: a dipole and air where the orbit is measured, else a lever in an unknown field.
        self.orbit: OrbitTorques | None = None
        if has_orbit(log):
            self.orbit = OrbitTorques(log, self.index, aligned)
            self.lever = self.orbit.columns[::PARTS]
            prior = np.repeat([DIPOLE / unit, AIR / unit], 3)
            self.field_information = np.diag(1.0 / prior**2)
            self.field_log_volume = 0.0
        else:
            self._in_unknown_field(aligned)
        walk = np.einsum("nk,xy->nxky", ramps, np.eye(3)).reshape(count, 3, -1)
        # Momenta are compared in the frame in which they were read.
        turned = np.concatenate([walk, self.lever], axis=2)
        self._back = aligned.mT
        turned = self._turned(turned)
        starts = np.einsum("nf,xy->nxfy", self.starts, np.eye(3)).reshape(count, 3, -1)
        self.columns = np.concatenate([starts, turned], axis=2)
        """(N, 3, P), momentum in the frame of its row of each unknown of this log."""

    def _in_unknown_field(self, aligned: np.ndarray) -> None:
        """A lever fixed in the body in a field of hats: the integral of (R e_i) x e_c.

        `aligned` is (N, 3, 3); it sets `lever` and the field's prior.
        """
        count = len(self.t)
        length = max(self.t[-1], 1.0)
        fields = int(np.clip(np.ceil(length / _FIELD_KNOT), 1, _MOST_FIELD)) + 1
        knots = np.linspace(0.0, length, fields)
        hats = np.stack([np.interp(self.t, knots, row) for row in np.eye(fields)], axis=1)
        across = np.cross(aligned.mT[:, :, None, :], np.eye(3))  # (N, i, c, 3)
        density = np.einsum("nl,nicx->nxlic", hats, across).reshape(count, 3, -1)
        steps = 0.5 * (density[1:] + density[:-1]) * np.diff(self.t)[:, None, None]
        self.lever = np.concatenate([np.zeros_like(steps[:1]), np.cumsum(steps, axis=0)])
        apart = (knots[:, None] - knots) / _FIELD_TIME
        near = np.exp(-0.5 * apart**2) + 1e-6 * np.eye(fields)
        self.field_information = np.kron(np.linalg.inv(near), np.eye(9))  # pyrefly: ignore[bad-assignment]
        self.field_log_volume = -9.0 * float(np.linalg.slogdet(near)[1])

    def gradient(self, tensor: np.ndarray) -> np.ndarray:
        """Momentum (N, 3) of the gradient of gravity in the frame of its row; 0 where the orbit is not known."""
        if self.orbit is None:
            return np.zeros_like(self.rates)
        return self._turned(self.orbit.gradient(tensor)[::PARTS, :, None])[..., 0]

    def _turned(self, momenta: np.ndarray) -> np.ndarray:
        """Momenta (N, 3, P) in the axes of the first frame, in the frame of their row."""
        return self.rotation @ self._back @ momenta

    def _aligned(self) -> np.ndarray:
        """Attitudes in the axes of the first frame; rates carry them over the change of a frame."""
        result = self.rotation.copy()
        for k in np.flatnonzero(np.diff(self.frame)) + 1:
            mean = 0.5 * (self.rates[k - 1] + self.rates[k])
            before = result[k - 1] @ turn((mean * (self.t[k] - self.t[k - 1]))[None])[0]
            result[k:] = before @ self.rotation[k].T @ self.rotation[k:]
        return result

    def information(self, walk: float, lever: float, largest: float) -> tuple[np.ndarray, float]:
        """Information (P, P) about the unknowns before, and its log determinant.

        Unknowns are momenta at the starts of frames, steps of the random walk, then what is fixed in the body, as
        `columns`.
        """
        starts = 3 * self.starts.shape[1]
        walks = 3 * (len(self.knots) - 1)
        size = self.columns.shape[2]
        result = np.zeros((size, size))
        result[:starts, :starts] = np.eye(starts) / (_FLAT * largest) ** 2
        part = slice(starts, starts + walks)
        result[part, part] = np.eye(walks) / (walk**2 * self.stretch)
        scale = 1.0 if self.orbit else lever
        result[starts + walks :, starts + walks :] = self.field_information / scale**2
        volume = -walks * np.log(walk**2 * self.stretch) + self.field_log_volume
        volume -= len(self.field_information) * np.log(scale**2)
        return result, volume


class _Momentum:
    """The model of `fit_momentum` for all logs of one satellite: momenta by values, and their derivatives.

    Values are 6 entries of the inertia and W of wheels, in ``unit`` (kg m^2), then 2 delays, s; `free` leaves the
    sum of the moments as it is.
    """

    def __init__(
        self, craft: Spacecraft, logs: Sequence[FlightLog], nominal: np.ndarray, prior: np.ndarray
    ) -> None:
        self.axes = np.array([wheel.axis for wheel in craft.wheels]).T
        """(3, W)."""
        self.unit = float(np.mean([wheel.inertia for wheel in craft.wheels]))
        """kg m^2: momenta are in units of it."""
        units = np.full(len(nominal), self.unit)
        units[-2:] = 1.0
        self.nominal = nominal / units
        self.prior = prior / units
        self.rows = [_Rows(log, self.unit) for log in logs]
        # The scale of everything is that of the file: the sum of the moments stays, so that zz follows from xx, yy.
        count = len(self.nominal)
        self.free = np.delete(np.eye(count), 5, axis=1)
        self.free[5, 0] = self.free[5, 3] = -1.0
        """(8 + W, 7 + W): values from free ones."""
        self.count = self.free.shape[1]
        self.prior_information = self.free.T @ np.diag(1.0 / self.prior**2) @ self.free

    def tensor(self, values: np.ndarray) -> np.ndarray:
        """Inertia (3, 3) of body and locked wheels."""
        result = np.zeros((3, 3))
        for value, (i, j) in zip(values[:6], _COMPONENTS, strict=True):
            result[i, j] = result[j, i] = value
        return result + self.axes * values[6:-2] @ self.axes.T

    def momentum(self, rows: _Rows, values: np.ndarray) -> tuple[np.ndarray, ...]:
        """In the body (N, 3): momentum as read, its change by a delay of speeds and of attitudes, and their sum.

        Delays are those of ``values[-2:]``; `derivatives` differentiates these very terms, so that both change
        together.
        """
        rotors = values[6:-2]
        read = rows.rates @ self.tensor(values) + (rows.speeds * rotors) @ self.axes.T
        change = rows.acceleration + 0.5 * values[-2] * rows.jerk
        by_speeds = (change * rotors) @ self.axes.T
        by_attitudes = np.cross(rows.rates, read)
        return (
            read,
            by_speeds,
            by_attitudes,
            read + values[-2] * by_speeds + values[-1] * by_attitudes,
        )

    def whitening(
        self, rows: _Rows, values: np.ndarray, spread: dict[str, float]
    ) -> tuple[np.ndarray, np.ndarray]:
        """What makes momenta (N, 3) in the frame of their row white, (N, 3, 3), and log det of rates' errors.

        Rows that are left out become zeros, and do not count in the determinant.
        """
        tensor = self.tensor(values)
        read, by_speeds, by_attitudes, _ = self.momentum(rows, values)
        of_wheels = self.axes * values[6:-2] ** 2 @ self.axes.T
        covariance = tensor @ tensor * spread["spin"] ** 2 + of_wheels * spread["wheel speed"] ** 2
        square = np.sum(read**2, axis=1)[:, None, None] * np.eye(3)
        covariance = covariance + spread["attitude"] ** 2 * (square - _outer(read))
        covariance += spread["jitter of speeds"] ** 2 * _outer(by_speeds)
        covariance += spread["jitter of attitudes"] ** 2 * _outer(by_attitudes)
        lower = np.linalg.cholesky(covariance)
        volume = 2.0 * np.log(np.einsum("nii->ni", lower)).sum(axis=1)
        volume -= 2.0 * np.linalg.slogdet(tensor)[1]
        whitening = np.linalg.inv(lower) @ rows.rotation.mT
        return whitening * rows.weight[:, None, None], volume * rows.weight

    def derivatives(self, rows: _Rows, values: np.ndarray) -> np.ndarray:
        """Derivatives (N, 3, 7 + W) of momenta in the body by free values, at adjusted rates and speeds.

        Those of `momentum`, in the order of the values, then mapped to free ones.
        """
        rates = rows.rates - rows.rate_errors
        speeds = rows.speeds - rows.speed_errors
        columns = []
        for i, j in _COMPONENTS:
            unit = np.zeros((3, 3))
            unit[i, j] = unit[j, i] = 1.0
            columns.append(rates @ unit)
        changes = rows.acceleration + 0.5 * values[-2] * rows.jerk
        for axis, speed, change in zip(self.axes.T, speeds.T, changes.T, strict=True):
            whole = speed + rates @ axis + values[-2] * change
            columns.append(whole[:, None] * axis)
        _, by_speeds, by_attitudes, _ = self.momentum(rows, values)
        further = 0.5 * values[-2] * (rows.jerk * values[6:-2]) @ self.axes.T
        columns += [by_speeds + further, by_attitudes]
        return np.stack(columns, axis=-1) @ self.free


def _outer(vectors: np.ndarray) -> np.ndarray:
    return vectors[:, :, None] * vectors[:, None, :]


class _Linear:
    """Linear problem at values: weighed columns of free values and of each log's own unknowns."""

    def __init__(
        self,
        model: _Momentum,
        values: np.ndarray,
        spread: dict[str, float],
        derivatives: Sequence[np.ndarray],
    ) -> None:
        self.spread = spread
        self.volume = 0.0
        self.square = 0.0
        corner = model.prior_information.copy()
        offset = np.linalg.lstsq(model.free, values - model.nominal, rcond=None)[0]
        right = -model.prior_information @ offset
        self.square += float(offset @ model.prior_information @ offset)
        self.parts = []
        for rows, change in zip(model.rows, derivatives, strict=True):
            whitening, volume = model.whitening(rows, values, spread)
            momentum = model.momentum(rows, values)[3]
            largest = float(np.abs(momentum).max()) + 1e-9
            momentum = (rows.rotation @ momentum[..., None])[..., 0]
            momentum = momentum - rows.gradient(model.tensor(values))
            y = (whitening @ momentum[..., None]).ravel()
            D = (whitening @ (rows.rotation @ change)).reshape(len(y), -1)
            X = (whitening @ rows.columns).reshape(len(y), -1)
            before, before_volume = rows.information(spread["walk"], spread["lever"], largest)
            block = X.T @ X + before
            lower = np.linalg.cholesky(block)
            side = np.linalg.solve(lower, X.T @ D)
            own = np.linalg.solve(lower, X.T @ y)
            corner += D.T @ D - side.T @ side
            right -= D.T @ y - side.T @ own
            self.square += float(y @ y - own @ own)
            self.volume += float(volume.sum()) - before_volume
            self.volume += 2.0 * float(np.log(np.diag(lower)).sum())
            self.parts.append((y, D, X, lower, side, own))
        self.corner = corner
        self.change = np.linalg.solve(corner, right)
        """(7 + W,): change of the free values that minimises the squares."""

    def evidence(self) -> float:
        """Minus twice the log likelihood of the spreads, values and unknowns integrated out, up to a constant."""
        square = self.square - float(self.change @ self.corner @ self.change)
        return square + self.volume + float(np.linalg.slogdet(self.corner)[1])

    def unknowns(self, number: int, change: np.ndarray) -> np.ndarray:
        """Unknowns (P,) of a log for a change of the free values."""
        _, _, _, lower, side, own = self.parts[number]
        return np.linalg.solve(lower.T, own + side @ change)


def fit_momentum(
    craft: Spacecraft, logs: Sequence[FlightLog], nominal: np.ndarray, prior: np.ndarray
) -> MomentumFit:
    """Inertia, wheels and delays of a satellite without thrusters, from logs of attitude, rates and wheel speeds.

    Args:
        craft: data sheet, with reaction wheels.
        logs: flights of it.
        nominal: (8 + W,), values of the data sheet in the order of `MomentumFit.values`.
        prior: (8 + W,), their standard deviations before.
    """
    model = _Momentum(craft, logs, nominal, prior)
    spread = {one.name: one.first for one in _SPREADS} | {"walk": _FIRST_WALK}
    table = [(one.first, one.low, one.high) for one in _SPREADS]
    readings = 3 * sum(len(rows.t) for rows in model.rows)
    values = model.nominal.copy()
    outliers = 0
    for number in range(_ROUNDS):
        # First all errors are those of rates: the equation is homogeneous, and with errors of a wrong proportion an
        # axis with its wheel shrinks to nothing.
        values, adjusted = _solved(model, values, spread, number == 0)
        # Rows that no error of reading explains.
        left_out = _leave_out(model, adjusted) if number else 0
        outliers += left_out

        # Standard deviations, at these values.
        derivatives = [model.derivatives(rows, values) for rows in model.rows]

        def unlikelihood(spreads: np.ndarray) -> float:
            return _Linear(model, values, _named(spreads), derivatives).evidence()  # noqa: B023

        before = np.array(list(spread.values()))
        found = likeliest(unlikelihood, table, readings, before, 1e-7)
        spread = _named(found)
        if number and not left_out and np.max(np.abs(np.log(found / before))) < 0.05:
            break
    values, adjusted = _solved(model, values, spread)
    _refuse_reversed(craft, model, values)
    return _result(model, values, spread, adjusted, outliers)


def _named(spreads: np.ndarray) -> dict[str, float]:
    """Standard deviations of `_SPREADS` by their names."""
    return {one.name: float(x) for one, x in zip(_SPREADS, spreads, strict=True)}


def _solved(
    model: _Momentum, values: np.ndarray, spread: dict[str, float], of_rates: bool = False
) -> tuple[np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    """Values that minimise the squares for these standard deviations, and the errors of momenta (`_adjust`).

    With ``of_rates`` it replaces the rows' errors of rates and speeds.

    `_Momentum.derivatives` reads these errors, so that a call depends on the ones before it.
    """
    adjusted = []
    for _ in range(_STEPS):
        derivatives = [model.derivatives(rows, values) for rows in model.rows]
        linear = _Linear(model, values, spread, derivatives)
        step = model.free @ linear.change
        # A step of a standard deviation of the prior at most: far away the weights are wrong.
        step /= max(1.0, float(np.max(np.abs(step) / model.prior)))
        adjusted = _adjust(model, values, spread, linear, np.zeros_like(linear.change))
        if of_rates:
            inverse = np.linalg.inv(model.tensor(values))
            for rows, (error, _) in zip(model.rows, adjusted, strict=True):
                rows.rate_errors = error @ inverse
                rows.speed_errors = np.zeros_like(rows.speed_errors)
        values = values + step
        if np.max(np.abs(step) / np.sqrt(np.diag(_covariance(model, linear)))) < 0.01:
            break
    return values, adjusted


def _covariance(model: _Momentum, linear: _Linear) -> np.ndarray:
    """Covariance (8 + W, 8 + W); a value that is fixed has a least variance, so that one may divide by it."""
    result = model.free @ np.linalg.inv(linear.corner) @ model.free.T
    return result + 1e-18 * np.diag(model.prior**2)


def _refuse_reversed(craft: Spacecraft, model: _Momentum, values: np.ndarray) -> None:
    """Refuse (`ConfigError`) speeds of wheels that the values (P,) show to be counted against their axes."""
    for k, rotor in enumerate(values[6:-2]):
        if rotor < 0.0:
            raise ConfigError(
                f"the speeds of wheel {k} turn {craft.name!r} as if the wheel had a negative inertia "
                f"({rotor * model.unit:.3g} kg m^2); the usual cause is a speed that is counted against the axis "
                "in the spacecraft's file, or another order of the wheels."
            )


def _adjust(
    model: _Momentum,
    values: np.ndarray,
    spread: dict[str, float],
    linear: _Linear,
    change: np.ndarray,
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Errors of momenta (N, 3) in the body of each log, and the same white; readings' errors are set by them.

    Of an error e of the momentum with the covariance C, the rate has S J C^-1 e, where S is the variance of its
    errors, and speeds alike.

    It replaces `rate_errors` and `speed_errors` of every log, from which `_Momentum.derivatives` goes on.
    """
    result = []
    for number, rows in enumerate(model.rows):
        whole = rows.columns @ linear.unknowns(number, change)
        whole = whole + rows.gradient(model.tensor(values))
        momentum = model.momentum(rows, values)[3]
        error = momentum - (rows.rotation.mT @ whole[..., None])[..., 0]
        whitening, _ = model.whitening(rows, values, spread)
        whitening = whitening @ rows.rotation
        white = (whitening @ error[..., None])[..., 0]
        weighed = (whitening.mT @ white[..., None])[..., 0]
        rows.rate_errors = spread["spin"] ** 2 * weighed @ model.tensor(values)
        rows.speed_errors = spread["wheel speed"] ** 2 * (weighed @ model.axes) * values[6:-2]
        # An instant that is off by a time has speeds that are off by their acceleration times it.
        _, by_speeds, _, _ = model.momentum(rows, values)
        off = spread["jitter of speeds"] ** 2 * np.sum(by_speeds * weighed, axis=1)
        accelerations = rows.acceleration + 0.5 * values[-2] * rows.jerk
        rows.speed_errors = rows.speed_errors + off[:, None] * accelerations
        result.append((error, white))
    return result


def _leave_out(model: _Momentum, adjusted: Sequence[tuple[np.ndarray, np.ndarray]]) -> int:
    """Leave out rows beyond `_OUTLIER`, and count them."""
    count = 0
    for rows, (_, white) in zip(model.rows, adjusted, strict=True):
        beyond = (np.linalg.norm(white, axis=1) > _OUTLIER) & (rows.weight > 0.0)
        rows.weight[beyond] = 0.0
        count += int(beyond.sum())
    return count


def _result(
    model: _Momentum,
    values: np.ndarray,
    spread: dict[str, float],
    adjusted: Sequence[tuple[np.ndarray, np.ndarray]],
    outliers: int,
) -> MomentumFit:
    """The fit in SI units, with the torque along each log; intervals are inflated by correlation."""
    derivatives = [model.derivatives(rows, values) for rows in model.rows]
    linear = _Linear(model, values, spread, derivatives)
    none = np.zeros_like(linear.change)
    unit = np.full(len(values), model.unit)
    unit[-2:] = 1.0
    white = [part for _, part in adjusted]
    smoothed = [rows.smoothed for rows in model.rows]
    inverse = np.linalg.inv(model.tensor(values))
    left = [error @ inverse + part for (error, _), part in zip(adjusted, smoothed, strict=True)]
    # The data sheet, with the momenta that fit it best.
    at_sheet = _Linear(model, model.nominal, spread, derivatives)
    inverse = np.linalg.inv(model.tensor(model.nominal))
    by_sheet = _adjust(model, model.nominal, spread, at_sheet, none)
    sheet = [error @ inverse + part for (error, _), part in zip(by_sheet, smoothed, strict=True)]
    inflation = _inflation(model, white)
    covariance = inflation * _covariance(model, linear)
    torques: list[Torque] = []
    sources: list[Source] = []
    for number in range(len(model.rows)):
        own = _torques_of(model, values, linear, number, inflation)
        torques.append(own[0])
        sources.extend(own[1])

    def whole(parts: list[np.ndarray]) -> tuple[np.ndarray, ...]:
        result = []
        for rows, part in zip(model.rows, parts, strict=True):
            full = np.full((len(rows.log.times), 3), np.nan)
            full[rows.index[rows.weight > 0.0]] = part[rows.weight > 0.0]
            result.append(full)
        return tuple(result)

    return MomentumFit(
        values * unit,
        covariance * np.outer(unit, unit),
        spread,
        whole(left),
        whole(sheet),
        whole(white),
        tuple(torques),
        tuple(sources),
        outliers,
        _outside(model, values * unit, torques),
        inflation,
    )


def _torques_of(
    model: _Momentum, values: np.ndarray, linear: _Linear, number: int, inflation: float
) -> tuple[Torque, list[Source]]:
    """External torque along a log, and its parts where it has positions and fields; variances are inflated."""
    rows = model.rows[number]
    starts = 3 * rows.starts.shape[1]
    stretches = len(rows.knots) - 1
    walks = slice(starts, starts + 3 * stretches)
    unknown = linear.unknowns(number, np.zeros_like(linear.change))
    _, _, _, lower, side, _ = linear.parts[number]
    # Covariance of the log's own unknowns, with that of the values, and of both.
    of_values = np.linalg.inv(linear.corner)
    carried = np.linalg.solve(lower.T, side)
    inverse = np.linalg.inv(lower)
    count = len(unknown)
    both = np.zeros((count + len(of_values),) * 2)
    both[:count, :count] = inverse.T @ inverse + carried @ of_values @ carried.T
    both[:count, count:] = carried @ of_values
    both[count:, :count] = both[:count, count:].T
    both[count:, count:] = of_values
    both = both + both @ _joint(model, values, linear, number) @ both

    # Momenta are known between rows, too, where there is an orbit.
    instants = rows.t if rows.orbit is None else rows.orbit.times - rows.orbit.times[0]
    lever = rows.lever if rows.orbit is None else rows.orbit.columns

    def gained(momenta: np.ndarray) -> np.ndarray:
        """Momenta (K, 3, P) that each stretch between two knots adds, (stretches, 3, P)."""
        parts = [
            np.stack([np.interp(rows.knots, instants, one) for one in axis.T], axis=-1)
            for axis in np.moveaxis(momenta, 1, 0)
        ]
        return np.diff(np.stack(parts, axis=1), axis=0)

    def torque(of_unknowns: np.ndarray, of_free: np.ndarray, mean: np.ndarray) -> Torque:
        """Torque by momenta gained (stretches, 3), from changes with the log's unknowns and with free values.

        Momenta are in ``model.unit`` in inertial axes, torques in N m.
        """
        columns = np.concatenate([of_unknowns, of_free], axis=2)
        variance = np.einsum("kxp,pq,kxq->kx", columns, both, columns)
        scale = model.unit / rows.stretch
        return Torque(
            rows.log.source,
            rows.log.times[rows.index[0]] + rows.knots,
            scale * mean,
            scale * np.sqrt(inflation * variance),
        )

    # The walk, what is fixed in the body, and the gradient of gravity, which is linear in the values.
    whole = np.zeros((stretches, 3, count))
    whole[:, :, walks.stop :] = gained(lever)
    for k in range(stretches):
        whole[k, :, starts + 3 * k : starts + 3 * k + 3] = np.eye(3)
    gradients = np.zeros((stretches, 3, model.count))
    fall = np.zeros((stretches, 3))
    if rows.orbit is not None:
        tensors = [model.tensor(column) for column in model.free.T]
        each = np.stack([rows.orbit.gradient(tensor) for tensor in tensors], axis=-1)
        gradients = gained(each)
        fall = gained(rows.orbit.gradient(model.tensor(values))[..., None])[..., 0]
    external = torque(whole, gradients, whole @ unknown + fall)
    if rows.orbit is None:
        return external, []
    nothing = np.zeros_like(whole)
    fallen = torque(nothing, gradients, fall)
    by_times = model.unit * _gradient_error(rows, model.tensor(values), linear.spread)
    fallen = replace(fallen, deviation=np.hypot(fallen.deviation, by_times))
    sources = [Source("gravity gradient", np.empty(0), np.empty((0, 0)), fallen)]
    for part, name in enumerate(("magnetic dipole", "air")):
        place = slice(walks.stop + 3 * part, walks.stop + 3 * part + 3)
        own = np.zeros_like(whole)
        own[:, :, place] = whole[:, :, place]
        sources.append(
            Source(
                name,
                model.unit * unknown[place],
                model.unit**2 * inflation * both[place, place],
                torque(own, np.zeros_like(gradients), own @ unknown),
            )
        )
    return external, sources


def _joint(model: _Momentum, values: np.ndarray, linear: _Linear, number: int) -> np.ndarray:
    """What products of columns (unknowns, free values), (P + F, P + F), lack of those of the errors that are.

    The fit takes errors of attitudes and rates as independent from row to row. Those of smoothed ones alternate,
    and the links between rows have their joint covariance. With the weights of the fit, the covariance of its
    result is the sandwich of both (Huber, Proc. 5th Berkeley Symposium 1, 1967).
    """
    rows = model.rows[number]
    _, D, X, _, _, _ = linear.parts[number]
    if not rows.links.linked.any():  # rates are as they were read
        return np.zeros((X.shape[1] + D.shape[1],) * 2)
    read = model.momentum(rows, values)[0]
    whitening, _ = model.whitening(rows, values, linear.spread)
    zero = np.zeros(len(read))
    x, y, z = read.T
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    tensor = np.broadcast_to(model.tensor(values), cross.shape)
    by_readings = np.concatenate([cross, tensor, np.zeros((len(read), 3, 1))], axis=2)
    columns = np.concatenate([X, -D], axis=1).reshape(len(read), 3, -1)
    sides = (whitening @ rows.rotation @ by_readings).mT @ columns
    spread = linear.spread
    turns = spread["attitude"] ** 2 * np.eye(3) + spread["jitter of attitudes"] ** 2 * _outer(
        rows.rates
    )
    taken = np.einsum("nap,nab,nbq->pq", sides[:, :3], turns, sides[:, :3])
    taken += spread["spin"] ** 2 * np.einsum("nap,naq->pq", sides[:, 3:6], sides[:, 3:6])
    blocks, beside, _, _, _ = rows.links.equations(rows.links.spreads)
    band = factor(blocks, beside)
    (solve,) = get_lapack_funcs(("tbtrs",), (band,))
    left, _ = solve(band, sides.reshape(-1, sides.shape[2]), uplo="L")
    return left.T @ left - taken


def _gradient_error(rows: _Rows, tensor: np.ndarray, spread: dict[str, float]) -> np.ndarray:
    """Standard deviations (stretches, 3) of the gradient through times and attitudes.

    They count here only: inertia is known to a fraction of a percent, dipole and air are not.
    """
    assert rows.orbit is not None
    stamps_are_whole = bool((rows.log.times == np.floor(rows.log.times)).all())
    late = spread["jitter of attitudes"] ** 2 + (_STAMP_APART**2 if stamps_are_whole else 0.0)
    apart = np.sqrt(spread["attitude"] ** 2 + np.sum(rows.rates**2, axis=1) * late)
    knots = rows.orbit.times[0] + rows.knots
    early = _STAMPS_OFF if stamps_are_whole else 0.0
    return rows.orbit.gradient_error(tensor, knots, early, apart)


def _outside(model: _Momentum, values: np.ndarray, torques: Sequence[Torque]) -> float:
    """Root mean square of external torques over that of wheels' means on the same stretches.

    See `MomentumFit.outside`.
    """
    of_wheels = []
    for rows in model.rows:
        at = np.stack([np.interp(rows.knots, rows.t, column) for column in rows.speeds.T], axis=1)
        of_wheels.append(np.diff(at * values[6:-2], axis=0).ravel() / rows.stretch)
    inside = np.sqrt(np.mean(np.concatenate(of_wheels) ** 2))
    outside = np.sqrt(np.mean(np.concatenate([one.torque.ravel() for one in torques]) ** 2))
    return float(outside / max(inside, 1e-300))


def _inflation(model: _Momentum, white: list[np.ndarray]) -> float:
    """Factor of variances by which fewer samples count, if successive white residuals are alike.

    Of N samples with the correlation rho of successive ones, N (1 - rho) / (1 + rho) count (Bartlett, 1946).
    """
    pairs = []
    power = []
    for rows, part in zip(model.rows, white, strict=True):
        used = rows.weight > 0.0
        both = used[1:] & used[:-1]
        pairs.append((part[1:] * part[:-1])[both])
        power.append(part[used] ** 2)
    rho = float(np.mean(np.concatenate(pairs)) / np.mean(np.concatenate(power)))
    return (1.0 + rho) / (1.0 - rho) if rho > 0.0 else 1.0
