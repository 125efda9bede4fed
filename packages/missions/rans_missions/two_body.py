"""Two-body gravity: what moves a craft near a target on an orbit without linearised equations.

It shares no equation with RANS, which flies linear ones in a frame that turns with the target: target and craft
fall about the Earth in axes that do not rotate, and SciPy integrates the difference of their accelerations. The
Earth may be oblate and have an atmosphere. Nothing here may import a drift: `tests/test_two_body.py` holds it
against closed forms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from rans.extend import Body, ConfigError, Spacecraft, StepInputs, Timing, Vec3, leaves
from rans_missions.orbits.earth import EARTH
from rans_missions.orbits.elliptic import EllipticOrbit
from rans_missions.orbits.perturbed import PerturbedOrbit

J2 = 1.08262668e-3
"""Oblateness of the Earth's gravity (EGM96)."""
_EARTH_RADIUS = 6.378137e6
"""Equatorial radius of the Earth, m (WGS 84)."""
_EARTH_RATE = 7.292115e-5
"""Rate of the Earth's rotation, rad/s (WGS 84)."""
_AIR = (
    (200.0, 2.789e-10, 37.105),
    (250.0, 7.248e-11, 45.546),
    (300.0, 2.418e-11, 53.628),
    (350.0, 9.518e-12, 53.298),
    (400.0, 3.725e-12, 58.515),
    (450.0, 1.585e-12, 60.828),
    (500.0, 6.967e-13, 63.822),
    (600.0, 1.454e-13, 71.835),
    (700.0, 3.614e-14, 88.667),
    (800.0, 1.170e-14, 124.64),
    (900.0, 5.245e-15, 181.05),
    (1000.0, 3.019e-15, 268.00),
)
"""Altitude, km, density there, kg/m^3, and height in which it falls to 1/e above, km."""
_RELATIVE = 1e-12
"""Tolerance of SciPy's integrator relative to a component."""
_ABSOLUTE = 1e-10
"""Its absolute tolerance, m and m/s: two orbits are then within 1e-6 m of ones at a hundredth of both."""


def relative_motion(
    mean_motion: float,
    p: np.ndarray,
    v: np.ndarray,
    times: Sequence[float] | np.ndarray,
    push: np.ndarray | None = None,
    mu: float = EARTH,
    eccentricity: float = 0.0,
    true_anomaly: np.ndarray | float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities of N craft in the Hill frame of a target on an orbit.

    The Hill frame has x radially outwards, y along the track and z across it, and turns with the target. A
    target on an ellipse is integrated beside its craft.

    Args:
        mean_motion: mean motion n of the target, rad/s; its orbit has the semi-major axis (mu / n^2)^(1/3).
        p: positions at time 0 in the Hill frame, m, (N, 3).
        v: velocities relative to it, m/s, (N, 3).
        times: increasing instants above 0, s.
        push: acceleration by thrusters, constant in the Hill frame, m/s^2, (N, 3); None: no thrust.
        mu: gravitational parameter, m^3/s^2.
        eccentricity: eccentricity of the target's orbit.
        true_anomaly: true anomaly of the target at time 0, rad, a number or (N,).

    Returns:
        Positions, m, and velocities, m/s, (times, N, 3).
    """
    count = len(p)
    size = (mu / mean_motion**2) ** (1.0 / 3.0)
    # The target at time 0, on the x axis of axes that do not turn: radius, and both components of its velocity.
    anomaly = np.broadcast_to(np.asarray(true_anomaly, float), count)
    parameter = size * (1.0 - eccentricity**2)
    radius = parameter / (1.0 + eccentricity * np.cos(anomaly))
    outwards = np.sqrt(mu / parameter) * eccentricity * np.sin(anomaly)
    along = np.sqrt(mu * parameter) / radius

    # Positions in axes that do not turn; the target beside its craft on an ellipse.
    def turned(vectors: np.ndarray, angle: np.ndarray) -> np.ndarray:
        """Vectors (N, 3) about z by angles (N,), rad."""
        c, s = np.cos(angle), np.sin(angle)
        x, y, z = vectors.T
        return np.stack([c * x - s * y, s * x + c * y, z], axis=1)

    def target(t: float, flat: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position of the target (N, 3), angle of its Hill frame (N,) and the rate of that (N,).

        At a time t (s), from SciPy's flat state.
        """
        if eccentricity == 0.0:
            angle = np.full(count, mean_motion * t)
            place = size * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
            return place, angle, np.full(count, mean_motion)
        place, rate = flat.reshape(4, count, 3)[2:]
        x, y, _ = place.T
        square = np.sum(place**2, axis=1)
        return place, np.arctan2(y, x), (x * rate[:, 1] - y * rate[:, 0]) / square

    def slope(t: float, flat: np.ndarray) -> np.ndarray:
        """Derivative of the flat state at a time t (s).

        Of craft relative to the target, and on an ellipse of the target.
        """
        r, rate = flat.reshape(-1, count, 3)[:2]
        place, angle, _ = target(t, flat)
        square = np.sum(place**2, axis=1, keepdims=True)
        distance = np.linalg.norm(place + r, axis=1, keepdims=True)
        pull = _difference(r, place, mu, square, distance)
        if push is not None:
            pull = pull + turned(push, angle)
        parts = [rate, pull]
        if eccentricity != 0.0:
            parts += [flat.reshape(4, count, 3)[3], -mu / square**1.5 * place]
        return np.concatenate(parts).ravel()

    def rotation(vectors: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """Velocity (N, 3) of points that rest in the Hill frame."""
        x, y, z = vectors.T
        return np.stack([-rate * y, rate * x, 0.0 * z], axis=1)

    # Integrated in the axes that do not turn, and turned back into the Hill frame.
    begin = [p, v + rotation(p, along / radius)]
    if eccentricity != 0.0:
        zero = 0.0 * radius
        begin += [np.stack([radius, zero, zero], 1), np.stack([outwards, along, zero], 1)]
    solution = solve_ivp(
        slope,
        (0.0, times[-1]),
        np.concatenate(begin).ravel(),
        "DOP853",
        t_eval=times,
        rtol=_RELATIVE,
        atol=_ABSOLUTE,
    )
    positions, velocities = [], []
    for t, flat in zip(solution.t, solution.y.T, strict=True):
        r, rate = flat.reshape(-1, count, 3)[:2]
        _, angle, turning = target(t, flat)
        positions.append(turned(r, -angle))
        velocities.append(turned(rate - rotation(r, turning), -angle))
    return np.array(positions), np.array(velocities)


@dataclass(frozen=True)
class Perturbations:
    """What acts on target and craft besides the gravity of a sphere, on an orbit around the Earth.

    The oblate Earth is the term J2 of its gravity. The density of the air falls exponentially with the
    altitude, from the values of D. A. Vallado, "Fundamentals of Astrodynamics and Applications", 4th edition,
    table 8-4; the air turns with the Earth.
    """

    inclination: float
    """Inclination of the target's orbit, rad."""
    latitude: np.ndarray
    """Argument of latitude of the target at time 0, rad, (N,)."""
    oblate: bool = True
    """Whether there is J2."""
    target_drag: float = 0.0
    """Drag coefficient times area over mass of the target, m^2/kg."""
    craft_drag: float = 0.0
    """Drag coefficient times area over mass of the craft, m^2/kg."""

    def near_circle(self, mean_motion: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Start of a target on the orbit that is nearest to a circle of mean radius (mu / n^2)^(1/3), of each (N,).

        Its radius only has the short-period term of J2 (D. A. Vallado, section 9.6), k/6 sin(i)^2 cos 2u, k = 3/2
        J2 (R / a)^2, which no choice of the start removes.

        Returns:
            Radius, m, its rate, m/s, and the rate of the angle in the plane of the orbit, rad/s.
        """
        size = (EARTH / mean_motion**2) ** (1.0 / 3.0)
        k = 1.5 * J2 * (_EARTH_RADIUS / size) ** 2 if self.oblate else 0.0
        tilt = np.sin(self.inclination) ** 2
        swing = k / 6.0 * tilt * np.cos(2.0 * self.latitude)
        rate = -k / 3.0 * tilt * np.sin(2.0 * self.latitude)
        angular = 1.0 + 0.5 * k * (1.0 - 1.5 * tilt) + swing
        return size * (1.0 + swing), size * mean_motion * rate, mean_motion * angular

    def acceleration(self, r: np.ndarray, v: np.ndarray, drag: float) -> np.ndarray:
        """Acceleration (N, 3), m/s^2, at positions and velocities (N, 3), z along the Earth's axis.

        `drag` is in m^2/kg.
        """
        square = np.sum(r**2, axis=1, keepdims=True)
        result = np.zeros_like(r)
        if self.oblate:
            height = 5.0 * r[:, 2:] ** 2 / square
            factors = np.concatenate([height - 1.0, height - 1.0, height - 3.0], axis=1)
            result += 1.5 * J2 * EARTH * _EARTH_RADIUS**2 / square**2.5 * factors * r
        if drag > 0.0:
            wind = v - np.cross([0.0, 0.0, _EARTH_RATE], r)
            speed = np.linalg.norm(wind, axis=1, keepdims=True)
            altitude = np.sqrt(square) - _EARTH_RADIUS
            result -= 0.5 * drag * density(altitude) * speed * wind
        return result


def density(altitude: np.ndarray) -> np.ndarray:
    """Density of the air, kg/m^3, at an altitude, m; zero above 1,500 km."""
    bases, values, heights = np.array(_AIR).T
    row = np.clip(np.searchsorted(bases, altitude / 1e3, side="right") - 1, 0, len(bases) - 1)
    air = values[row] * np.exp((bases[row] - altitude / 1e3) / heights[row])
    return np.where(altitude > 1.5e6, 0.0, air)


def perturbed_motion(
    mean_motion: float,
    p: np.ndarray,
    v: np.ndarray,
    times: Sequence[float] | np.ndarray,
    perturbations: Perturbations,
    push: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities of N craft in the Hill frame of a target on a nearly circular orbit.

    Target and the difference between craft and target are integrated in axes that do not turn. The frame is
    that of the target's perturbed orbit: x radially outwards, z along its angular momentum.

    Args:
        mean_motion: mean motion n of the target, rad/s.
        p: positions at time 0 in the Hill frame, m, (N, 3).
        v: velocities relative to it, m/s, (N, 3).
        times: increasing instants above 0, s.
        perturbations: what acts besides.
        push: acceleration by thrusters, constant in the Hill frame, m/s^2, (N, 3); None: no thrust.

    Returns:
        Positions, m, and velocities, m/s, (times, N, 3).
    """
    count = len(p)
    # Axes of the Hill frame at time 0 as columns (N, 3, 3).
    turn = Rotation.from_euler(
        "ZXZ",
        np.stack(
            [np.zeros(count), np.full(count, perturbations.inclination), perturbations.latitude], 1
        ),
    )
    axes = turn.as_matrix()
    radius, outwards, angular = perturbations.near_circle(mean_motion)
    place = radius[:, None] * axes[:, :, 0]
    along = outwards[:, None] * axes[:, :, 0] + (radius * angular)[:, None] * axes[:, :, 1]
    relative = np.einsum("nij,nj->ni", axes, p)
    # The frame turns as the target does, and tilts with its orbital plane.
    twist = _frame_rate(place, along, perturbations)
    rate = np.einsum("nij,nj->ni", axes, v) + np.cross(twist, relative)

    def slope(_: float, flat: np.ndarray) -> np.ndarray:
        """Derivative of SciPy's flat state (4 * count * 3,).

        Positions and velocities (m, m/s) of craft relative to the target, then the target's own, in inertial axes.
        """
        r, rate, place, along = flat.reshape(4, count, 3)
        square = np.sum(place**2, axis=1, keepdims=True)
        distance = np.linalg.norm(place + r, axis=1, keepdims=True)
        own = perturbations.acceleration(place, along, perturbations.target_drag)
        craft = perturbations.acceleration(place + r, along + rate, perturbations.craft_drag)
        pull = _difference(r, place, EARTH, square, distance) + craft - own
        if push is not None:
            pull = pull + np.einsum("nij,nj->ni", _hill_axes(place, along), push)
        return np.concatenate([rate, pull, along, own - EARTH / square**1.5 * place]).ravel()

    solution = solve_ivp(
        slope,
        (0.0, times[-1]),
        np.concatenate([relative, rate, place, along]).ravel(),
        "DOP853",
        t_eval=times,
        rtol=_RELATIVE,
        atol=_ABSOLUTE,
    )
    positions, velocities = [], []
    for flat in solution.y.T:
        r, rate, place, along = flat.reshape(4, count, 3)
        basis = _hill_axes(place, along)
        twist = _frame_rate(place, along, perturbations)
        positions.append(np.einsum("nji,nj->ni", basis, r))
        velocities.append(np.einsum("nji,nj->ni", basis, rate - np.cross(twist, r)))
    return np.array(positions), np.array(velocities)


def _hill_axes(place: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Axes of the Hill frame of a target as columns (N, 3, 3), from its position and velocity."""
    outwards = place / np.linalg.norm(place, axis=1, keepdims=True)
    across = np.cross(place, along)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return np.stack([outwards, np.cross(across, outwards), across], axis=2)


def _frame_rate(place: np.ndarray, along: np.ndarray, perturbations: Perturbations) -> np.ndarray:
    """Angular velocity (N, 3), rad/s, of the Hill frame of a target in axes that do not turn."""
    momentum = np.cross(place, along)
    square = np.sum(place**2, axis=1, keepdims=True)
    own = perturbations.acceleration(place, along, perturbations.target_drag)
    normal = momentum / np.linalg.norm(momentum, axis=1, keepdims=True)
    # An acceleration across the plane tilts it about the radius.
    lift = np.sum(own * normal, axis=1, keepdims=True)
    return momentum / square + lift / np.linalg.norm(momentum, axis=1, keepdims=True) * place


def _difference(
    r: np.ndarray, place: np.ndarray, mu: float, square: np.ndarray, distance: np.ndarray
) -> np.ndarray:
    """Gravity at place + r minus that at place, m/s^2, in Battin's form, which subtracts no large numbers.

    Source: R. H. Battin, "An Introduction to the Mathematics and Methods of Astrodynamics", 1999, section 8.4.
    """
    q = np.sum(r * (r + 2.0 * place), axis=1, keepdims=True) / square
    f = q * (3.0 + 3.0 * q + q * q) / (1.0 + (1.0 + q) ** 1.5)
    return mu / distance**3 * (f * place - r)


class TwoBodyMover:
    """Two-body gravity as what moves the craft of episodes: a `rans.episode.Mover`.

    It is for craft that nothing turns, whose thrusters point through the centre of mass, in nominal conditions:
    attitudes and spins stay as they are.

    Args:
        craft: what flies.
        timing: control period and checks.
        mean_motion: mean motion of the target's orbit, rad/s.
        mu: gravitational parameter, m^3/s^2.
        eccentricity: eccentricity of the target's orbit; where the target is on it is a note of the task's goal.
        perturbations: what acts besides; the latitude is a note of the task's goal. None: nothing.

    Raises:
        ConfigError: thrusters of the craft turn it.
    """

    engine = "two-body"

    def __init__(
        self,
        craft: Spacecraft,
        timing: Timing,
        mean_motion: float,
        mu: float = EARTH,
        eccentricity: float = 0.0,
        perturbations: Perturbations | None = None,
    ) -> None:
        self._perturbations = perturbations
        self._forces = np.array(
            [thruster.force * np.array(thruster.direction) for thruster in craft.thrusters]
        )
        levers = (
            np.array([thruster.position for thruster in craft.thrusters]) - craft.centre_of_mass
        )
        torque = np.abs(np.cross(levers, self._forces)).max()
        # Directions are decimals that were normalised.
        if craft.dimension != 3 or craft.wheels or torque > 1e-9:
            raise ConfigError(
                f"two-body gravity moves craft in space that nothing turns, but {craft.name} is in the plane, has "
                f"wheels, or thrusters with a torque of up to {torque:.3g} N m."
            )
        self._mass = craft.mass
        self._designed = leaves(Body.of(craft))
        self._mean_motion = mean_motion
        self._mu = mu
        self._eccentricity = eccentricity
        self._times = timing.control_period / timing.checks * np.arange(1, timing.checks + 1)

    def __call__(self, state: Any, step_inputs: StepInputs) -> tuple[Any, ...]:
        """States at the checks of one control period, the last one at its end.

        Raises:
            ConfigError: there are conditions that change thrust or disturb the craft.
        """
        flying = leaves(step_inputs.body)
        is_designed = len(flying) == len(self._designed) and all(
            np.all(x == designed) for x, designed in zip(flying, self._designed, strict=True)
        )
        if step_inputs.lag or step_inputs.disturbance or step_inputs.failing or not is_designed:
            raise ConfigError(
                "two-body gravity moves craft in nominal conditions only: leave out randomization of masses and "
                "thrusters, delays of valves, faults and disturbances."
            )
        shape = np.shape(state.p.x)
        q = state.attitude
        # A quaternion of SciPy has its scalar last.
        attitude = Rotation.from_quat(_rows((q.x, q.y, q.z, q.w)))
        true = 0.0
        if isinstance(step_inputs.drift, EllipticOrbit):
            true = _true_anomaly(step_inputs.drift.mean_anomaly, self._eccentricity)
        push = attitude.apply(_rows(step_inputs.commands[0]) @ self._forces) / self._mass
        begin = self._mean_motion, _rows(state.p.columns()), _rows(state.v.columns()), self._times
        if self._perturbations is None:
            moved = relative_motion(*begin, push, self._mu, self._eccentricity, true)
        else:
            assert isinstance(step_inputs.drift, PerturbedOrbit)
            latitude = np.broadcast_to(step_inputs.drift.latitude, shape).ravel()
            now = replace(self._perturbations, latitude=latitude)
            moved = perturbed_motion(*begin, now, push)
        return tuple(
            replace(state, p=Vec3(*p.T.reshape(3, *shape)), v=Vec3(*v.T.reshape(3, *shape)))
            for p, v in zip(*moved, strict=True)
        )


def _true_anomaly(mean_anomaly: Any, eccentricity: float) -> np.ndarray:
    """True anomaly, rad, in the shape of the mean anomaly (rad), by SciPy's root of Kepler's equation."""

    def solved(mean: float) -> float:
        root: Any = brentq(
            lambda x: x - eccentricity * np.sin(x) - mean, mean - 1.0, mean + 1.0, xtol=1e-14
        )
        return root

    anomaly = np.array([solved(float(x)) for x in np.ravel(mean_anomaly)])
    half = np.sqrt((1.0 + eccentricity) / (1.0 - eccentricity)) * np.tan(0.5 * anomaly)
    return 2.0 * np.arctan(half)


def _rows(fields: Sequence[Any]) -> np.ndarray:
    """Rows of plain numbers, (N, fields), from fields of one number or of N."""
    return np.column_stack([np.ravel(x) for x in np.broadcast_arrays(*fields)])
