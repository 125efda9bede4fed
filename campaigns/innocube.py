"""Inertia of InnoCube from its telemetry in orbit: ``python -m campaigns.innocube FOLDER``.

InnoCube is a satellite of three units with three reaction wheels, whose learned attitude controller flew from
October to December 2025 (arXiv 2512.19576). FOLDER is a clone of the repository kdjebko/lelar-in-orbit-data: a
folder a manoeuvre with attitude.csv (quaternion, scalar first, body to inertial), rates.csv (degrees/s) and
wheel-speeds.csv (revolutions a minute, counted against the axes of the body), a row about every 2 s. It has no
licence, so that nothing of it is in this repository.

Wheels do not change the angular momentum of the whole, R (J w - s) in units of a wheel's inertia, with the speeds s
of the wheels. It is constant but for external torques. The inertia J, the momentum at the beginning and these
torques enter linearly: a constant torque, which stands for gravity gradient and drag over minutes, and a dipole
fixed in the body in a magnetic field that changes linearly in time, as nine or eighteen products of components. The
time by which speeds are read after rates is linear too. Errors are those of readings, and of their times, which the
rounded stamps and a row every 2 s leave: in proportion to the acceleration of the wheels.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
import tyro
from tyro.conf import Positional

from campaigns.command import ended
from rans.errors import ConfigError, brief
from rans.files import read_text
from rans.terminal import Terminal

_LARGEST = 2**24
"""Bytes of a file of telemetry; a manoeuvre has 30,000."""
_FEWEST = 40
"""Rows with which 31 unknowns are fitted to three equations each."""
_FILES = ("attitude", "rates", "wheel-speeds")
_COMPONENTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
_GAP = 4.5
"""s: rows farther apart are not neighbours; most are 2 s apart."""
_LEAST_ERROR = 0.2
"""rad/s of a wheel: least standard deviation of a row, two revolutions a minute, so that weights stay finite."""
_FITS = 3
"""Fits, between which the weights follow the residuals; more change nothing in three digits."""
MODELS = {
    "conserved": (False, 0),
    "torque": (True, 0),
    "dipole": (True, 1),
    "drifting field": (True, 2),
}
"""Models of the external torque: whether there is a constant one, and powers of time in the field of a dipole."""


@dataclass(frozen=True)
class Telemetry:
    """Readings of a manoeuvre at common times."""

    times: np.ndarray
    """(N,), s from the first."""
    attitude: np.ndarray
    """(N, 3, 3), rotation from body to inertial."""
    rates: np.ndarray
    """(N, 3), rad/s, in the body."""
    speeds: np.ndarray
    """(N, 3), rad/s, of the wheels against the axes of the body."""


@dataclass(frozen=True)
class Found:
    """Inertia and residuals of one manoeuvre under one model."""

    moments: np.ndarray
    """(3,), moments of inertia about the body's axes over the inertia of a wheel."""
    residual: float
    """Root mean square of the momentum that the model leaves, over the inertia of a wheel, rad/s."""
    correlation: float
    """Correlation of successive weighted residuals; 0 for white ones."""
    bound: float
    """Absolute correlation that white residuals exceed once in a thousand manoeuvres."""
    timing: float
    """Standard deviation of the times of readings, s, by which residuals grow with acceleration."""
    late: float
    """Time by which wheel speeds are older than rates, s."""


def rows_of(file: Path, columns: int) -> dict[datetime, list[float]]:
    """Numbers (columns,) of a file of telemetry by their time; units after them are left out, later rows win.

    Raises:
        ConfigError: the file cannot be read, or a row has other cells than a time and numbers.
    """
    text = read_text(file, _LARGEST, "the telemetry ")
    found = {}
    for line, row in enumerate(csv.reader(io.StringIO(text)), 1):
        if line == 1 or not row:
            continue
        try:
            time = datetime.fromisoformat(row[0])
            numbers = [float(cell.split()[0]) for cell in row[1:]]
        except (ValueError, IndexError) as error:
            raise ConfigError(
                f"the telemetry {file}, line {line}: a time and numbers are needed, got {brief(row)}."
            ) from error
        if len(numbers) != columns or not np.isfinite(numbers).all():
            raise ConfigError(
                f"the telemetry {file}, line {line}: {columns} finite numbers are needed, got {brief(row)}."
            )
        found[time] = numbers
    return found


def read_manoeuvre(folder: Path) -> Telemetry:
    """Readings of a folder at the times that all its files have.

    Raises:
        ConfigError: a file cannot be read, or too few times are in all of them.
    """
    attitude, rates, speeds = (
        rows_of(folder / f"{name}.csv", 4 if name == "attitude" else 3) for name in _FILES
    )
    times = sorted(attitude.keys() & rates.keys() & speeds.keys())
    if len(times) < _FEWEST:
        raise ConfigError(
            f"{folder} has {len(times)} times with attitude, rates and wheel speeds; {_FEWEST} are needed."
        )
    q = np.array([attitude[time] for time in times])
    w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    rotation = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return Telemetry(
        np.array([(time - times[0]).total_seconds() for time in times]),
        np.moveaxis(np.array(rotation), -1, 0),
        np.deg2rad([rates[time] for time in times]),
        np.array([speeds[time] for time in times]) * (2.0 * np.pi / 60.0),
    )


def identified(telemetry: Telemetry, constant: bool, powers: int) -> Found:
    """Weighted least squares for inertia, first momentum, external torque and lateness of the speeds.

    Args:
        telemetry: readings.
        constant: whether there is a constant torque in the inertial frame.
        powers: powers of time in the magnetic field: 0 no dipole, 1 a constant field, 2 a linear one.
    """
    t = telemetry.times
    R = telemetry.attitude
    count = len(t)
    columns = []

    # Momentum of the body, of each component of its inertia.
    for i, j in _COMPONENTS:
        unit = np.zeros((3, 3))
        unit[i, j] = unit[j, i] = 1.0
        columns.append(np.einsum("nij,jk,nk->ni", R, unit, telemetry.rates))

    # Speeds read late, and what the whole has from the beginning and from torques.
    acceleration = np.gradient(telemetry.speeds, t, axis=0)
    columns.append(-np.einsum("nij,nj->ni", R, acceleration))
    columns += [np.tile(axis, (count, 1)) for axis in np.eye(3)]
    if constant:
        columns += [np.outer(t, axis) for axis in np.eye(3)]
    for power in range(powers):
        for dipole in range(3):
            for axis in np.eye(3):
                torque = np.cross(R[:, :, dipole], axis) * ((t / t[-1]) ** power)[:, None]
                columns.append(_integral(t, torque))

    # Fit, with the variance of each row from the residuals: of the readings, and of their times.
    matrix = np.stack(columns, axis=-1)
    wheels = np.einsum("nij,nj->ni", R, telemetry.speeds)
    change = np.sum(acceleration**2, axis=1) / 3.0
    weights = np.ones(count)
    residual = wheels
    values = np.zeros(matrix.shape[-1])
    variances = np.zeros(2)
    for _ in range(_FITS):
        weighed = (matrix * weights[:, None, None]).reshape(3 * count, -1)
        values = np.linalg.lstsq(weighed, (wheels * weights[:, None]).ravel(), rcond=None)[0]
        residual = wheels - matrix @ values
        square = np.mean(residual**2, axis=1)
        both = np.stack([np.ones(count), change], axis=1)
        variances = np.linalg.lstsq(both, square, rcond=None)[0]
        variances = np.maximum(variances, [_LEAST_ERROR**2, 0.0])
        weights = 1.0 / np.sqrt(both @ variances)

    # Whether what is left is white: successive rows.
    white = residual * weights[:, None]
    near = np.diff(t) < _GAP
    product = (white[1:] * white[:-1])[near]
    return Found(
        values[:3],
        float(np.sqrt(np.mean(residual**2))),
        float(np.mean(product) / np.mean(white**2)),
        # 3.29 standard deviations: two-sided, once in a thousand.
        3.29 / np.sqrt(product.size),
        float(np.sqrt(variances[1])),
        float(values[6]),
    )


def _integral(times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Integral (N, 3) of values (N, 3) up to each time, by trapezia."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(times)[:, None]
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


@dataclass(frozen=True)
class InnoCube:
    """Identify the inertia of InnoCube from its telemetry."""

    folder: Positional[Path]
    """Clone of kdjebko/lelar-in-orbit-data."""

    def run(self) -> int:
        """Print a row for each manoeuvre and model."""
        folders = sorted(file.parent for file in self.folder.glob("*/attitude.csv"))
        if not folders:
            raise ConfigError(
                f"{self.folder} has no folder with attitude.csv: give a clone of kdjebko/lelar-in-orbit-data."
            )
        rows = []
        for folder in folders:
            try:
                telemetry = read_manoeuvre(folder)
            except ConfigError as error:
                Terminal().say(str(error))
                continue
            for name, model in MODELS.items():
                found = identified(telemetry, *model)
                rows.append(
                    (
                        folder.name,
                        name,
                        ", ".join(f"{x:.0f}" for x in found.moments),
                        f"{found.residual:.1f}",
                        f"{found.correlation:+.2f} ({found.bound:.2f})",
                        f"{found.timing:.1f}",
                    )
                )
        headings = (
            "manoeuvre",
            "external torque",
            "Jxx, Jyy, Jzz over a wheel's inertia",
            "residual, rad/s of a wheel",
            "correlation (bound)",
            "timing, s",
        )
        Terminal().show("InnoCube", headings, rows)
        return 0


if __name__ == "__main__":
    raise SystemExit(ended("innocube", lambda: tyro.cli(InnoCube).run()))
