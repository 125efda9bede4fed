"""External torques of a satellite in orbit, by what they come from: the gradient of gravity, magnetism and air.

With the direction u from the Earth's centre, that of the velocity v and the magnetic field B, all in the body, they
are

    gradient of gravity  3 mu / r^3 u x (J u),    dipole  m x B,    air  c x (-v).

Position and field of a log give u, v and B, and the inertia J is identified. So the dipole m, A m^2, and c, the
lever of the air times its force, N m, are what is left to determine: both are fixed in the body, and turn in their
own way along the orbit. Dipoles of circuits that are switched, air on an area that changes, and the turn of the air
with the Earth (4 degrees of v at most) are left to the random walk of `momentum`.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from rans.extend import ConfigError
from rans_robot.identify.log import FlightLog, turn

PARTS = 4
"""Parts of a gap between rows in integrals: of 3 s and turns of 3 degrees/s they are right to a thousandth."""

_MU = 3.986004418e14
"""Gravitational parameter of the Earth, m^3/s^2."""
DIPOLE = 0.1
"""A m^2: standard deviation of a component of the dipole before; satellites without magnets have a tenth of it."""
AIR = 1e-6
"""N m: standard deviation of a component of c before; 1e-5 N at 3 cm are 3e-7."""
_LONGEST_GAP = 120.0
"""s between positions, over which a spline is right to metres, or between fields."""
_RADII = (6.4e6, 5e7)
"""m: distances from the Earth's centre that are read, from the ground to geostationary orbit and beyond."""
_FIELDS = (1e-8, 1e-4)
"""T: magnitudes of a field in an orbit; at the poles it has 6e-5."""
_FREE_FALL = 0.05
"""Part of gravity by which positions may be accelerated otherwise. In axes that turn with the Earth it is 0.13."""
_FEWEST = 8
"""Positions, and fields, that are needed."""
_SMOOTH = 0.5
"""Part of the field's change in the body that no slow curve explains, up to which it may be so in inertial axes."""
_STEADY = 0.1
"""Part of the field that may be left of a slow curve: noise and offset of a sensor are below it."""


def has_orbit(log: FlightLog) -> bool:
    """Whether a log has positions and fields, which say what the torques come from."""
    return log.field is not None and not (np.isnan(log.field).all() or np.isnan(log.position).all())


class OrbitTorques:
    """Torques of a log, integrated from its first row.

    Between two rows the spin changes evenly by the difference of their rates. Sums over rows alone were off by a
    third of the interval of a gradient.

    Args:
        log: with position from the Earth's centre in the inertial axes of the attitude, m, and field in the body,
            T.
        index: rows that are used.
        rotation: (N, 3, 3), body to inertial axes at these rows.

    Attributes:
        times: (K,), s, `PARTS` of each gap between rows; those of the rows are every `PARTS`-th one.
        columns: (K, 3, 6), momentum of each component of the dipole and of c, in inertial axes.

    Raises:
        ConfigError: positions are no free fall around the Earth in inertial axes, fields are in other axes or
            units, or there are too few.
    """

    def __init__(self, log: FlightLog, index: np.ndarray, rotation: np.ndarray) -> None:
        assert log.field is not None
        what = f"the log {log.source}"
        self.times, self._rotation = _between(log.times[index], rotation, log.spin[index])
        position, velocity = _orbit(what, log, self.times)
        radius = np.linalg.norm(position, axis=1, keepdims=True)
        self._up = position / radius
        self._strength = 3.0 * _MU / radius[:, 0] ** 3
        along = velocity / np.linalg.norm(velocity, axis=1, keepdims=True)
        field = _field(what, log, index, rotation, self.times)
        arms = self._rotation.mT[:, :, None, :]  # (K, i, 1, 3): axes of the body
        both = np.concatenate(
            [np.cross(arms, field[:, None, None, :]), np.cross(arms, -along[:, None, None, :])], 1
        )
        self.columns = self._integrated(both[:, :, 0].mT)
        # The gradient is linear in the inertia.
        of_entries = [self._torque(entry) for entry in np.eye(9).reshape(9, 3, 3)]
        self._of_entries = self._integrated(np.stack(of_entries, axis=-1))

    def gradient(self, tensor: np.ndarray) -> np.ndarray:
        """Momentum (K, 3) of the gradient of gravity in inertial axes, in N m s for an inertia (3, 3) in kg m^2."""
        return self._of_entries @ tensor.ravel()

    def gradient_error(
        self, tensor: np.ndarray, knots: np.ndarray, early: float, apart: np.ndarray
    ) -> np.ndarray:
        """Standard deviation (M, 3) of the mean gradient between knots (M + 1,) through times and attitudes.

        Args:
            tensor: inertia, kg m^2.
            knots: times, s.
            early: standard deviation of what all instants are off by, s.
            apart: (N,), rad: standard deviation of each row's attitude about any axis.
        """
        torque = self._torque(tensor)
        at = np.stack([np.interp(knots, self.times, column) for column in torque.T], axis=1)
        shifted = (early * np.diff(at, axis=0) / np.diff(knots)[:, None]) ** 2
        # A row counts for its part of the stretch. A turn d of the attitude changes the tensor T by [d] T - T [d].
        rows = slice(None, None, PARTS)
        turned = self._rotation[rows] @ tensor @ self._rotation[rows].mT
        up = self._up[rows]
        square = np.zeros_like(up)
        for axis in np.eye(3):
            change = np.cross(axis, np.einsum("nij,nj->ni", turned, up))
            change = change - np.einsum("nij,nj->ni", turned, np.cross(axis, up))
            square += np.cross(self._strength[rows, None] * up, change) ** 2
        times = self.times[rows]
        weight = np.gradient(times)[:, None] * apart[:, None]
        inside = np.clip(np.searchsorted(knots, times, side="right") - 1, 0, len(knots) - 2)
        scattered = np.zeros_like(shifted)
        np.add.at(scattered, inside, square * weight**2)
        return np.sqrt(shifted + scattered / np.diff(knots)[:, None] ** 2)

    def _torque(self, tensor: np.ndarray) -> np.ndarray:
        """Torque (K, 3) of the gradient in inertial axes, N m."""
        turned = np.einsum("nij,jk,nlk,nl->ni", self._rotation, tensor, self._rotation, self._up)
        return self._strength[:, None] * np.cross(self._up, turned)

    def _integrated(self, density: np.ndarray) -> np.ndarray:
        steps = 0.5 * (density[1:] + density[:-1])
        steps = steps * np.diff(self.times).reshape(-1, *[1] * (density.ndim - 1))
        return np.concatenate([np.zeros_like(density[:1]), np.cumsum(steps, axis=0)])


def _between(
    times: np.ndarray, rotation: np.ndarray, rates: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Times (K,) and attitudes (K, 3, 3) of `PARTS` of each gap; rates (N, 3) of the rows are in the body."""
    gaps = np.diff(times)
    part = (np.arange(PARTS) / PARTS)[:, None]
    turns = Rotation.from_matrix(rotation[:-1].mT @ rotation[1:]).as_rotvec()
    # With an even acceleration the turn is a parabola, whose slopes at both ends differ by the change of the rate.
    bend = 0.5 * (rates[:-1] - rates[1:]) * gaps[:, None]
    vectors = part * turns[:, None] + part * (1.0 - part) * bend[:, None]
    between = rotation[:-1, None] @ turn(vectors.reshape(-1, 3)).reshape(*vectors.shape, 3)
    instants = times[:-1, None] + part[:, 0] * gaps[:, None]
    return (
        np.append(instants.ravel(), times[-1]),
        np.concatenate([between.reshape(-1, 3, 3), rotation[-1:]]),
    )


def _orbit(what: str, log: FlightLog, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (m) and velocities (m/s), (N, 3), at times (s), of a free fall, which they are checked to be.

    A cubic spline through the positions; the check is of the mean acceleration in the middle ten minutes at most.
    """
    rows = np.isfinite(log.position).all(axis=1)
    _check_dense(what, "positions", log.times[rows], times)
    position = log.position[rows]
    radius = np.linalg.norm(position, axis=1)
    if not ((radius > _RADII[0]) & (radius < _RADII[1])).all():
        raise ConfigError(
            f"{what}: the satellite is {radius.min():.4g} to {radius.max():.4g} m from the centre of the Earth, "
            f"and {_RADII[0]:g} to {_RADII[1]:g} m are read: are its positions in km, or from another origin?"
        )
    spline = CubicSpline(log.times[rows], position)
    # A polynomial over the whole has the acceleration without the noise of single positions.
    t = log.times[rows] - log.times[rows].mean()
    half = 0.5 * min(float(np.ptp(t)), 600.0)
    near = np.abs(t) <= half + 1e-9
    fit = np.polynomial.polynomial.polyfit(t[near] / half, position[near], 6)
    pull = 2.0 * fit[2] / half**2
    expected = -_MU * fit[0] / np.linalg.norm(fit[0]) ** 3
    off = float(np.linalg.norm(pull - expected) / np.linalg.norm(expected))
    if half > 60.0 and off > _FREE_FALL:
        raise ConfigError(
            f"{what}: its positions are accelerated by {100.0 * off:.0f} % of gravity otherwise than a free fall: "
            "do their axes turn with the Earth, as those of ITRF or WGS 84 do, or are the times not in s?"
        )
    return spline(times), spline(times, 1)


def _field(
    what: str, log: FlightLog, index: np.ndarray, rotation: np.ndarray, instants: np.ndarray
) -> np.ndarray:
    """Field (K, 3) in inertial axes at instants; between readings of the rows it is that of a line there."""
    assert log.field is not None
    read = np.isfinite(log.field[index]).all(axis=1)
    times = log.times[index]
    _check_dense(what, "fields", times[read], times)
    own = log.field[index][read]
    size = np.linalg.norm(own, axis=1)
    if not ((size > _FIELDS[0]) & (size < _FIELDS[1])).all():
        raise ConfigError(
            f"{what}: its magnetic field is {size.min():.3g} to {size.max():.3g} T, and {_FIELDS[0]:g} to "
            f"{_FIELDS[1]:g} T are read: is it in nT, or damaged?"
        )
    turned = np.einsum("nij,nj->ni", rotation[read], own)
    rough, before = _roughness(times[read], turned), _roughness(times[read], own)
    if rough > max(_SMOOTH * before, _STEADY):
        raise ConfigError(
            f"{what}: after its attitudes have turned the magnetic field to inertial axes, {100.0 * rough:.0f} % "
            f"of it change otherwise than along an orbit, and {100.0 * before:.0f} % before: bx, by and bz must be "
            "in the axes of the body. Are they in inertial axes, or in those of the sensor?"
        )
    return np.stack([np.interp(instants, times[read], column) for column in turned.T], axis=1)


def _roughness(times: np.ndarray, vectors: np.ndarray) -> float:
    """What a polynomial of one bend in 10 minutes leaves of vectors (N, 3), root mean square over theirs."""
    degree = int(np.clip(np.ceil(np.ptp(times) / 600.0), 1, 12)) + 2
    t = 2.0 * (times - times[0]) / np.ptp(times) - 1.0
    columns = np.polynomial.legendre.legvander(t, degree)
    left = vectors - columns @ np.linalg.lstsq(columns, vectors, rcond=None)[0]
    return float(np.sqrt(np.mean(left**2) / np.mean(vectors**2)))


def _check_dense(what: str, name: str, times: np.ndarray, wanted: np.ndarray) -> None:
    """Refuse (`ConfigError`) times of readings (s) that are too few or too far apart for those wanted."""
    ends = [wanted[0], *times, wanted[-1]]
    gap = float(np.max(np.abs(np.diff(ends))))
    if len(times) < _FEWEST or gap > _LONGEST_GAP:
        raise ConfigError(
            f"{what} has {len(times)} {name} with gaps of up to {gap:.3g} s, and at least {_FEWEST} with gaps of "
            f"at most {_LONGEST_GAP:g} s say what the torques come from: leave out their columns, or fill them."
        )
