"""Rates of a satellite that agree with the attitudes between which they turn it.

From one row to the next the attitude turns by the integral of the rate. So attitudes say the mean rate over many
rows better than noisy rates do, and a fit that takes each row by itself leaves that unused. Here errors of all
attitudes and rates of a log are the most probable ones, by one banded least-squares problem (a fixed-interval
smoother: Rauch, Tung and Striebel, AIAA Journal 3, 1965). No inertia and no torque is in it.

Attitudes err by noise, and by the instants at which they were read. Between two rows the spin changes as a line
plus Brownian motion, and the time between them errs by their stamps. The standard deviations of all are those of
largest likelihood.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from rans_robot.identify.log import FlightLog

_SPREADS = (
    (3e-3, 1e-5, 0.2),
    (5e-4, 1e-6, 0.1),
    (0.05, 1e-4, 3.0),
    (1e-3, 3e-5, 1.0),
    (0.05, 1e-3, 3.0),
)
"""Where the search of each standard deviation begins, its least and its largest value: attitude, rad; rate, rad/s;
instants of attitudes, s; change of the spin beside a line, rad/s per root of s^3; time between two rows, s."""
_OF_WHEELS = ((0.3, 1e-3, 20.0), (0.3, 1e-4, 100.0))
"""Where the search of two standard deviations begins, its least and its largest value: of a wheel's speed, rad/s,
and of the change of its acceleration, rad/s^2 per root of s."""
_LARGEST_ACCELERATION = 1e3
"""rad/s^2: standard deviation of an acceleration before, far above those of motors."""
_PRIOR_SPREAD = 3.0
"""Standard deviation of the logarithm of each before: a factor of 20."""
_LARGEST_TURN = 1.0
"""rad: turn between two rows, above which they are not linked: the rule of the trapezium is for small turns."""
_OUTLIER = 5.0
"""Standard deviations of a reading's error from which its row is not linked."""
_ROUNDS = 8
"""Most rounds of rows that are not linked, after which the rates stay as read; two suffice."""
_FAR = 20.0
"""Medians of what links leave, from which a row is not linked before there are standard deviations."""
_BESIDE = 2
"""Rows on each side to which the error of a wrong row spreads."""
_FEWEST = 8
"""Links that are needed for five standard deviations."""
_UNLIKELY = 1e30
"""Minus twice the log likelihood of spreads with which the equations cannot be solved; differences stay finite."""
_WIDTH = 6
"""Unknowns of a row: errors of its attitude, a rotation vector in the body, and of its rate."""


def with_smooth_rates(log: FlightLog) -> FlightLog:
    """The log with most probable rates; attitudes stay as read."""
    rows = np.all(np.isfinite(np.column_stack([log.attitude, log.spin])), axis=1)
    links = _Links(log, rows)
    links.leave_out(links.torn())
    for _ in range(_ROUNDS):
        if links.linked.sum() < _FEWEST:
            break
        spreads = links.fitted()
        errors = links.errors(spreads)[1]
        bad = links.wrong(spreads, errors)
        if not bad.any():
            spin = log.spin.copy()
            spin[rows] = links.spin - np.where(links.used[:, None], errors[:, 3:], 0.0)
            return replace(log, spin=spin)
        links.leave_out(bad)
    return log


class _Links:
    """Turns between the rows of a log, and what they are from those that the rates say.

    Args:
        log: attitudes and rates.
        rows: (M,), which rows have both.
    """

    def __init__(self, log: FlightLog, rows: np.ndarray) -> None:
        self.spin = log.spin[rows]
        attitude = Rotation.from_quat(log.attitude[rows][:, [1, 2, 3, 0]])
        self._gap = np.diff(log.times[rows])
        turn = (attitude[:-1].inv() * attitude[1:]).as_rotvec()
        before, after = self.spin[:-1], self.spin[1:]
        self._mean = 0.5 * (before + after)
        gap = self._gap[:, None]
        # The last term is that of a spin whose axis moves (Magnus): the commutator of a line.
        self._rest = turn - gap * self._mean - gap**2 / 12.0 * np.cross(before, after)
        frames = np.zeros(len(log.times)) if log.frames is None else log.frames
        self.linked = np.diff(frames[rows]) == 0.0
        self.linked &= np.linalg.norm(self._mean, axis=1) * self._gap < _LARGEST_TURN
        self.used = np.ones(len(self.spin), bool)
        """(N,): rows that are linked."""
        # A link changes with the errors of both of its rows.
        half = 0.5 * gap[..., None] * np.eye(3)
        self._first = np.concatenate([-_per_turn(-turn), half], axis=2)
        self._second = np.concatenate([_per_turn(turn), half], axis=2)

    def torn(self) -> np.ndarray:
        """Rows (N,) with two links that are far off those of others: spreads would grow until they explain them."""
        size = np.where(self.linked, np.linalg.norm(self._rest, axis=1) / self._gap, 0.0)
        far = size > _FAR * np.median(size)
        return np.append(far, False) & np.append(False, far)

    def wrong(self, spreads: np.ndarray, errors: np.ndarray) -> np.ndarray:
        """Rows (N,) whose errors (N, 6) are no noise. Those beside them take a part, and stay."""
        of_attitude = np.hypot(spreads[0], spreads[2] * np.linalg.norm(self.spin, axis=1))
        off = np.abs(errors) / np.repeat(
            np.stack([of_attitude, np.full_like(of_attitude, spreads[1])], axis=1), 3, axis=1
        )
        off = np.where(self.used, off.max(axis=1), 0.0)
        near = np.pad(off, _BESIDE)
        largest = np.lib.stride_tricks.sliding_window_view(near, 2 * _BESIDE + 1).max(axis=1)
        return (off > _OUTLIER) & (off == largest)

    def leave_out(self, rows: np.ndarray) -> None:
        """Cut the links of rows (N,)."""
        self.used &= ~rows
        self.linked &= self.used[:-1] & self.used[1:]

    def fitted(self) -> np.ndarray:
        """Standard deviations of largest likelihood, in the order of `_SPREADS`."""
        first, low, high = np.log(_SPREADS).T

        def cost(logarithms: np.ndarray) -> float:
            before = float(np.sum((logarithms - first) ** 2)) / _PRIOR_SPREAD**2
            return self.errors(np.exp(logarithms))[0] + before

        found = minimize(
            cost,
            first,
            method="L-BFGS-B",
            bounds=list(zip(low, high, strict=True)),
            options={"maxiter": 30, "ftol": 1e-7},
        )
        return np.exp(found.x)

    def errors(self, spreads: np.ndarray) -> tuple[float, np.ndarray]:
        """Minus twice the log likelihood of spreads (5,), and most probable errors (N, 6) of each row."""
        of_attitude, of_rate, of_instant, of_spin, of_gap = spreads
        count = len(self.spin)
        attitude = of_attitude**2 * np.eye(3) + of_instant**2 * _outer(self.spin)
        link = (of_spin**2 * self._gap**3)[:, None, None] * np.eye(3)
        link = link + of_gap**2 * _outer(self._mean)
        weight = np.linalg.inv(link) * self.linked[:, None, None]

        # Normal equations: blocks of rows, and of rows beside the next one.
        blocks = np.zeros((count, _WIDTH, _WIDTH))
        blocks[:, :3, :3] = np.linalg.inv(attitude)
        blocks[:, 3:, 3:] = np.eye(3) / of_rate**2
        first, second = self._first.mT @ weight, self._second.mT @ weight
        blocks[:-1] += first @ self._first
        blocks[1:] += second @ self._second
        beside = second @ self._first
        right = np.zeros((count, _WIDTH))
        right[:-1] -= (first @ self._rest[..., None])[..., 0]
        right[1:] -= (second @ self._rest[..., None])[..., 0]
        band = np.zeros((2 * _WIDTH, _WIDTH * count))
        for i in range(_WIDTH):
            for j in range(_WIDTH):
                band[_WIDTH + i - j, j:-_WIDTH:_WIDTH] = beside[:, i, j]
                if j <= i:
                    band[i - j, j::_WIDTH] = blocks[:, i, j]
        try:
            lower = cholesky_banded(band, lower=True, check_finite=False)
        except LinAlgError:  # spreads of a proportion beyond sixteen digits
            return _UNLIKELY, right
        result = cho_solve_banded((lower, True), right.ravel(), check_finite=False)

        square = np.einsum("ni,nij,nj", self._rest, weight, self._rest) - right.ravel() @ result
        volume = 2.0 * np.log(lower[0]).sum() + 6.0 * count * np.log(of_rate)
        volume += np.linalg.slogdet(attitude)[1].sum()
        volume += np.linalg.slogdet(link)[1][self.linked].sum()
        return float(square + volume), result.reshape(count, _WIDTH)


def accelerations(times: np.ndarray, speeds: np.ndarray) -> np.ndarray:
    """Most probable accelerations (N, W) of wheels, rad/s^2, from their speeds (N, W) at times (N,), s.

    An acceleration is a Brownian motion, and speeds err by noise: a smoothing spline, whose two standard deviations
    are those of largest likelihood. Differences of noisy speeds are wrong where a delay multiplies them.
    """
    first, low, high = np.log(_OF_WHEELS).T

    def cost(logarithms: np.ndarray) -> float:
        before = float(np.sum((logarithms - first) ** 2)) / _PRIOR_SPREAD**2
        return _spline(times, speeds, *np.exp(logarithms))[0] + before

    found = minimize(
        cost,
        first,
        method="L-BFGS-B",
        bounds=list(zip(low, high, strict=True)),
        options={"maxiter": 30, "ftol": 1e-7},
    )
    return _spline(times, speeds, *np.exp(found.x))[1]


def _spline(
    times: np.ndarray, speeds: np.ndarray, noise: float, change: float
) -> tuple[float, np.ndarray]:
    """Minus twice the log likelihood of both standard deviations, and accelerations (N, W)."""
    gap = np.diff(times)
    count = len(times)
    # Between two rows speed and acceleration change by this covariance, whose inverse is written out.
    inverse = np.empty((count - 1, 2, 2))
    inverse[:, 0, 0] = 12.0 / gap**3
    inverse[:, 0, 1] = inverse[:, 1, 0] = -6.0 / gap**2
    inverse[:, 1, 1] = 4.0 / gap
    inverse /= change**2
    step = np.zeros((count - 1, 2, 2))
    step[:, 0, 0] = step[:, 1, 1] = -1.0
    step[:, 0, 1] = -gap
    weighed = step.mT @ inverse
    blocks = np.zeros((count, 2, 2))
    blocks[:, 0, 0] = 1.0 / noise**2
    blocks[:, 1, 1] = 1.0 / _LARGEST_ACCELERATION**2
    blocks[:-1] += weighed @ step
    blocks[1:] += inverse
    beside = weighed.mT
    band = np.zeros((4, 2 * count))
    for i in range(2):
        for j in range(2):
            band[2 + i - j, j:-2:2] = beside[:, i, j]
            if j <= i:
                band[i - j, j::2] = blocks[:, i, j]
    lower = cholesky_banded(band, lower=True, check_finite=False)
    right = np.zeros((2 * count, speeds.shape[1]))
    right[::2] = speeds / noise**2
    result = cho_solve_banded((lower, True), right, check_finite=False)
    square = float(np.sum(speeds**2) / noise**2 - np.sum(right * result))
    volume = 2.0 * np.log(lower[0]).sum() + 2.0 * count * np.log(noise)
    volume += 4.0 * (count - 1) * np.log(change)
    return square + speeds.shape[1] * float(volume), result[1::2]


def _outer(vectors: np.ndarray) -> np.ndarray:
    return vectors[:, :, None] * vectors[:, None, :]


def _per_turn(turn: np.ndarray) -> np.ndarray:
    """Change (N, 3, 3) of rotation vectors (N, 3), of 1 rad at most, by a small rotation in the body after them.

    To the second order: the next term is a^4 / 720.
    """
    x, y, z = turn.T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    return np.eye(3) + 0.5 * cross + cross @ cross / 12.0
