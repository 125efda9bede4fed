"""Errors of a satellite's attitudes and rates that make them agree.

From one row to the next the attitude turns by the integral of the rate. So attitudes say the mean rate over many
rows better than noisy rates do, and a fit that takes each row by itself leaves that unused. Here errors of all
attitudes and rates of a log are the most probable ones, by one banded least-squares problem (a fixed-interval
smoother: Rauch, Tung and Striebel, AIAA Journal 3, 1965). No inertia and no torque is in it. What is left of these
errors is not independent from row to row, and the same equations have its joint covariance.

Attitudes err by noise, and by the instants at which they were read; time stamps err, too. Between two rows the spin
changes as a parabola plus Brownian motion; slopes of the parabola are those of smoothing splines, of wheels, whose
accelerations change fast, and of what they leave of the rates. Standard deviations are those of largest likelihood.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from rans_robot.identify.log import FlightLog

_SPREADS = (
    (3e-3, 1e-5, 0.2),
    (5e-4, 1e-6, 0.1),
    (0.05, 1e-4, 3.0),
    (1e-4, 1e-5, 1.0),
    (0.05, 1e-3, 3.0),
    (0.3, 1e-2, 10.0),
)
"""Median of each standard deviation before, its least and its largest value: attitude, rad; rate, rad/s; instants
of attitudes beside those of rates, s; change of the spin beside a parabola, rad/s per root of s; time stamps, s;
and the part of the parabola by which it is wrong."""
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
_WORST = 100.0
"""Rise of minus twice the log likelihood, for each reading, beyond which a search does not tell values apart."""
_WIDTH = 7
"""Unknowns of a row: errors of its attitude, a rotation vector in the body, of its rate, and of its stamp."""


def smoothed(log: FlightLog) -> tuple[FlightLog, Links]:
    """The log with most probable rates (rad/s) and attitudes, and the links between its rows as they were read.

    Rows without a reading stay as they are. Where too few links are left or none agree, it is the log as read, and
    nothing is linked; ``wheel_speeds`` must be there.
    """
    assert log.wheel_speeds is not None
    readings = np.column_stack([log.attitude, log.spin, log.wheel_speeds])
    rows = np.asarray(np.isfinite(readings).all(axis=1))
    links = Links(log, rows)
    links.leave_out(links.torn())
    for _ in range(_ROUNDS):
        if links.linked.sum() < _FEWEST:
            break
        links.fit()
        errors = links.errors(links.spreads)[1]
        bad = links.wrong(errors)
        if not bad.any():
            spin = log.spin.copy()
            spin[rows] -= errors[:, 3:6]
            attitude = log.attitude.copy()
            turned = Rotation.from_quat(attitude[rows][:, [1, 2, 3, 0]])
            turned = turned * Rotation.from_rotvec(errors[:, :3])
            attitude[rows] = turned.as_quat()[:, [3, 0, 1, 2]]
            return replace(log, spin=spin, attitude=attitude), links
        links.leave_out(bad)
    links.linked[:] = False
    return log, links


class Links:
    """Turns between the rows of a log, and what they are from those that the rates say.

    Args:
        log: attitudes and rates.
        rows: (M,), which rows have both.

    Attributes:
        rows: (M,), the same; N of them have both.
        spreads: (6,), standard deviations in the order of `_SPREADS`.
    """

    def __init__(self, log: FlightLog, rows: np.ndarray) -> None:
        # A link is one row and the next in one frame of attitudes; `linked` (N - 1,) says which count.
        self.rows = rows
        self.spreads = np.array([first for first, _, _ in _SPREADS])
        self._spin = log.spin[rows]
        attitude = Rotation.from_quat(log.attitude[rows][:, [1, 2, 3, 0]])
        self._gap = np.diff(log.times[rows])
        turn = (attitude[:-1].inv() * attitude[1:]).as_rotvec()
        before, after = self._spin[:-1], self._spin[1:]
        self._mean = 0.5 * (before + after)
        gap = self._gap[:, None]
        # The last term is that of a spin whose axis moves (Magnus): the commutator of a line.
        self._rest = turn - gap * self._mean - gap**2 / 12.0 * np.cross(before, after)
        frames = np.zeros(len(log.times)) if log.frames is None else log.frames
        self.linked = np.diff(frames[rows]) == 0.0
        self.linked &= np.linalg.norm(self._mean, axis=1) * self._gap < _LARGEST_TURN
        self._used = np.ones(len(self._spin), bool)
        # Wheels turn the craft, and accelerate it unevenly: a parabola of the spin beside its line.
        assert log.wheel_speeds is not None
        speeds = log.wheel_speeds[rows]
        self.acceleration = accelerations(log.times[rows], speeds)
        per_speed = np.linalg.lstsq(np.diff(speeds, axis=0), after - before, rcond=None)[0]
        further = 1e-3 * accelerations(log.times[rows], 1e3 * (self._spin - speeds @ per_speed))
        bend = gap**2 / 12.0 * np.diff(self.acceleration @ per_speed + further, axis=0)
        self._rest = self._rest + bend
        self._bend = np.sum(bend**2, axis=1)
        # A link changes with the errors of both of its rows.
        half = 0.5 * gap[..., None] * np.eye(3)
        along = self._mean[..., None]
        self._first = np.concatenate([-_per_turn(-turn), half, along], axis=2)
        self._second = np.concatenate([_per_turn(turn), half, -along], axis=2)

    def torn(self) -> np.ndarray:
        """Rows (N,) with two links that are far off those of others: spreads would grow until they explain them."""
        size = np.where(self.linked, np.linalg.norm(self._rest, axis=1) / self._gap, 0.0)
        far = size > _FAR * np.median(size)
        return np.append(far, False) & np.append(False, far)

    def wrong(self, errors: np.ndarray) -> np.ndarray:
        """Rows (N,) whose errors (N, 7) are no noise. Those beside them take a part, and stay."""
        spreads = self.spreads
        of_attitude = np.hypot(spreads[0], spreads[2] * np.linalg.norm(self._spin, axis=1))
        off = np.abs(errors[:, :6]) / np.repeat(
            np.stack([of_attitude, np.full_like(of_attitude, spreads[1])], axis=1), 3, axis=1
        )
        off = np.where(self._used, off.max(axis=1), 0.0)
        near = np.pad(off, _BESIDE)
        largest = np.lib.stride_tricks.sliding_window_view(near, 2 * _BESIDE + 1).max(axis=1)
        return (off > _OUTLIER) & (off == largest)

    def leave_out(self, rows: np.ndarray) -> None:
        """Cut the links of rows (N,)."""
        self._used &= ~rows
        self.linked &= self._used[:-1] & self._used[1:]

    def fit(self) -> None:
        """Set the standard deviations to those of largest likelihood."""
        self.spreads = likeliest(
            lambda spreads: self.errors(spreads)[0], _SPREADS, 6 * len(self._spin)
        )

    def errors(self, spreads: np.ndarray) -> tuple[float, np.ndarray]:
        """Minus twice the log likelihood of spreads (6,), and most probable errors (N, 7) of each row.

        `equations` has the order of the seven errors: attitude, rate, and the time stamp. ``_UNLIKELY`` ends a step
        of the search for spreads.
        """
        blocks, beside, right, square, volume = self.equations(spreads)
        try:
            lower = factor(blocks, beside)
        except LinAlgError:  # spreads of a proportion beyond sixteen digits
            return _UNLIKELY, right
        result: Any = cho_solve_banded((lower, True), right.ravel(), check_finite=False)
        square -= float(right.ravel() @ result)
        volume += 2.0 * float(np.log(lower[0]).sum())
        return square + volume, result.reshape(right.shape)

    def equations(
        self, spreads: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, float, float]:
        """Normal equations of the errors of all rows for spreads (6,).

        The errors of a row are those of attitude (3, rad) and rate (3, rad/s) in B, and of its time stamp (s).

        Returns:
            Blocks (N, 7, 7) of rows, blocks (N - 1, 7, 7) of a row (second index) and the next (first), right side
            (N, 7), the squares at no errors, and the logarithm of the determinant of the covariance.
        """
        of_attitude, of_rate, of_instant, of_spin, of_stamp, of_bend = spreads
        count = len(self._spin)
        attitude = of_attitude**2 * np.eye(3) + of_instant**2 * _outer(self._spin)
        uneven = of_spin**2 * self._gap**3 + of_bend**2 * self._bend
        link = uneven[:, None, None] * np.eye(3)
        weight = np.linalg.inv(link) * self.linked[:, None, None]

        of_readings = np.zeros((count, _WIDTH, _WIDTH))
        of_readings[:, :3, :3] = np.linalg.inv(attitude)
        of_readings[:, 3:6, 3:6] = np.eye(3) / of_rate**2
        of_readings[:, 6, 6] = 1.0 / of_stamp**2
        first, second = self._first.mT @ weight, self._second.mT @ weight
        blocks = of_readings
        blocks[:-1] += first @ self._first
        blocks[1:] += second @ self._second
        right = np.zeros((count, _WIDTH))
        right[:-1] -= (first @ self._rest[..., None])[..., 0]
        right[1:] -= (second @ self._rest[..., None])[..., 0]
        square = float(np.einsum("ni,nij,nj", self._rest, weight, self._rest))
        volume = 6.0 * count * np.log(of_rate) + 2.0 * count * np.log(of_stamp)
        volume += np.linalg.slogdet(attitude)[1].sum()
        volume += np.linalg.slogdet(link)[1][self.linked].sum()
        return blocks, second @ self._first, right, square, float(volume)


def factor(blocks: np.ndarray, beside: np.ndarray) -> np.ndarray:
    """Lower factor of Cholesky, in the diagonals of LAPACK, of a matrix of blocks.

    Args:
        blocks: (N, w, w), symmetric, on the diagonal.
        beside: (N - 1, w, w), below it.

    Raises:
        LinAlgError: the matrix is not positive.
    """
    count, width, _ = blocks.shape
    band = np.zeros((2 * width, width * count))
    for i in range(width):
        for j in range(width):
            band[width + i - j, j:-width:width] = beside[:, i, j]
            if j <= i:
                band[i - j, j::width] = blocks[:, i, j]
    return np.asarray(cholesky_banded(band, lower=True, check_finite=False))


def accelerations(times: np.ndarray, speeds: np.ndarray) -> np.ndarray:
    """Most probable accelerations (N, W) of wheels, rad/s^2, from their speeds (N, W) at times (N,), s.

    An acceleration is a Brownian motion, and speeds err by noise: a smoothing spline, whose two standard deviations
    are those of largest likelihood. Differences of noisy speeds are wrong where a delay multiplies them.
    """
    found = likeliest(lambda spreads: _spline(times, speeds, *spreads)[0], _OF_WHEELS, speeds.size)
    return _spline(times, speeds, *found)[1]


def likeliest(
    unlikelihood: Callable[[np.ndarray], float],
    table: Sequence[tuple[float, float, float]],
    count: int,
    begin: np.ndarray | None = None,
    tolerance: float = 1e-5,
) -> np.ndarray:
    """Standard deviations (S,) that are most likely.

    Args:
        unlikelihood: minus twice the log likelihood of standard deviations (S,).
        table: of each, its median before (the standard deviation of its logarithm is `_PRIOR_SPREAD`), and bounds.
        count: readings in it. The search divides by it, since its first step is as long as the slope.
        begin: (S,), where the search begins; None: at the medians.
        tolerance: part by which a step must lessen the cost.
    """
    first, low, high = np.log(table).T
    start = first if begin is None else np.log(begin)
    # A line search that comes to a huge value goes back to where it began.
    worst = unlikelihood(np.exp(start)) + _WORST * count

    def cost(logarithms: np.ndarray) -> float:
        before = float(np.sum((logarithms - first) ** 2)) / _PRIOR_SPREAD**2
        return (min(unlikelihood(np.exp(logarithms)), worst) + before) / count

    found = minimize(
        cost,
        start,
        method="L-BFGS-B",
        bounds=list(zip(low, high, strict=True)),
        options={"maxiter": 30, "ftol": tolerance},
    )
    return np.exp(found.x)


def _spline(
    times: np.ndarray, speeds: np.ndarray, noise: float, change: float
) -> tuple[float, np.ndarray]:
    """Minus twice the log likelihood of both standard deviations, and accelerations (N, W).

    Unknowns of a row are speed and acceleration; all wheels share the factor.
    """
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
    lower = factor(blocks, weighed.mT)
    right = np.zeros((2 * count, speeds.shape[1]))
    right[::2] = speeds / noise**2
    result: Any = cho_solve_banded((lower, True), right, check_finite=False)
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
