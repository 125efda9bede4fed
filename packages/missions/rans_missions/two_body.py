"""Two-body gravity: what moves a craft near a target on an orbit without linearised equations.

It shares no equation with RANS, which flies linear ones in a frame that turns with the target: target and craft
fall about the Earth in axes that do not rotate, and SciPy integrates the difference of their accelerations. Nothing
here may import a drift but to read where a target is: `tests/test_two_body.py` holds it against closed forms.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from rans.extend import Body, ConfigError, Spacecraft, Timing, Vec3, leaves
from rans.randomization.parameters import StepInputs
from rans_missions.orbits.earth import EARTH
from rans_missions.orbits.elliptic import EllipticOrbit

_RELATIVE = 1e-12
"""Tolerance of SciPy's integrator relative to a component."""
_ABSOLUTE = 1e-10
"""Its absolute tolerance, m and m/s: two orbits are then within 1e-6 m of ones at a hundredth of both."""

Target = tuple[np.ndarray, np.ndarray]
"""Positions, m, and velocities, m/s, (N, 3) of targets, from the Earth's centre in axes that do not turn."""


def _nothing(r: np.ndarray, v: np.ndarray) -> np.ndarray:
    return 0.0 * r


@dataclass(frozen=True)
class Gravity:
    """Gravity of the Earth as a point mass, and what acts on target and craft beside it."""

    on_both: Callable[[np.ndarray, np.ndarray], np.ndarray] = _nothing
    """Acceleration (N, 3), m/s^2, at positions and velocities (N, 3) from the Earth's centre."""

    def motion(
        self,
        target: Target,
        p: np.ndarray,
        v: np.ndarray,
        times: Sequence[float] | np.ndarray,
        push: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities of N craft in the Hill frames of their targets.

        A Hill frame has x radially outwards, z along the angular momentum, and turns with its target.

        Args:
            target: targets at time 0.
            p: positions at time 0 in the Hill frame, m, (N, 3).
            v: velocities relative to it, m/s, (N, 3).
            times: increasing instants above 0, s.
            push: acceleration by thrusters, constant in the Hill frame, m/s^2, (N, 3); None: no thrust.

        Returns:
            Positions, m, and velocities, m/s, (times, N, 3).
        """
        count = len(p)
        place, along = target
        axes = _hill_axes(place, along)
        relative = np.einsum("nij,nj->ni", axes, p)
        rate = np.einsum("nij,nj->ni", axes, v) + np.cross(self._turning(place, along), relative)

        def slope(_: float, flat: np.ndarray) -> np.ndarray:
            """Derivative of the craft relative to the target, and of the target."""
            r, rate, place, along = flat.reshape(4, count, 3)
            square = np.sum(place**2, axis=1, keepdims=True)
            own = self.on_both(place, along)
            pull = _difference(r, place) + self.on_both(place + r, along + rate) - own
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
        positions = []
        velocities = []
        for flat in solution.y.T:
            r, rate, place, along = flat.reshape(4, count, 3)
            axes = _hill_axes(place, along)
            seen = rate - np.cross(self._turning(place, along), r)
            positions.append(np.einsum("nji,nj->ni", axes, r))
            velocities.append(np.einsum("nji,nj->ni", axes, seen))
        return np.array(positions), np.array(velocities)

    def _turning(self, place: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Angular velocity (N, 3), rad/s, of the Hill frames of targets in axes that do not turn."""
        momentum = np.cross(place, along)
        size = np.linalg.norm(momentum, axis=1, keepdims=True)
        # An acceleration across the plane tilts it about the radius.
        lift = np.sum(self.on_both(place, along) * momentum, axis=1, keepdims=True) / size
        return momentum / np.sum(place**2, axis=1, keepdims=True) + lift / size * place


def on_ellipse(mean_motion: float, eccentricity: float, true_anomaly: np.ndarray) -> Target:
    """Targets on an ellipse, rad/s, at true anomalies (N,), rad, with the perigee along x."""
    parameter = (EARTH / mean_motion**2) ** (1.0 / 3.0) * (1.0 - eccentricity**2)
    c, s = np.cos(true_anomaly), np.sin(true_anomaly)
    radius = parameter / (1.0 + eccentricity * c)
    speed = np.sqrt(EARTH / parameter)
    zero = 0.0 * c
    place = np.stack([radius * c, radius * s, zero], axis=1)
    return place, speed * np.stack([-s, eccentricity + c, zero], axis=1)


def _hill_axes(place: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Axes of the Hill frame of a target as columns (N, 3, 3), from its position and velocity."""
    outwards = place / np.linalg.norm(place, axis=1, keepdims=True)
    across = np.cross(place, along)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return np.stack([outwards, np.cross(across, outwards), across], axis=2)


def _difference(r: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Gravity at place + r minus that at place, m/s^2, in Battin's form, which subtracts no large numbers.

    Source: R. H. Battin, "An Introduction to the Mathematics and Methods of Astrodynamics", 1999, section 8.4.
    """
    square = np.sum(place**2, axis=1, keepdims=True)
    distance = np.linalg.norm(place + r, axis=1, keepdims=True)
    q = np.sum(r * (r + 2.0 * place), axis=1, keepdims=True) / square
    f = q * (3.0 + 3.0 * q + q * q) / (1.0 + (1.0 + q) ** 1.5)
    return EARTH / distance**3 * (f * place - r)


class TwoBodyMover:
    """Two-body gravity as what moves the craft of episodes: a `rans.episode.Mover`.

    It is for craft that nothing turns, whose thrusters point through the centre of mass, in nominal conditions:
    attitudes and spins stay as they are.

    Args:
        craft: what flies.
        timing: control period and checks.
        mean_motion: mean motion of the target's orbit, rad/s.
        eccentricity: eccentricity of the target's orbit; where the target is on it is a note of the task's goal.

    Raises:
        ConfigError: thrusters of the craft turn it.
    """

    engine = "two-body"
    gravity = Gravity()

    def __init__(
        self,
        craft: Spacecraft,
        timing: Timing,
        mean_motion: float,
        eccentricity: float = 0.0,
    ) -> None:
        thrusters = craft.thrusters
        self._forces = np.array([np.multiply(x.force, x.direction) for x in thrusters])
        levers = np.array([x.position for x in thrusters]) - craft.centre_of_mass
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
        push = attitude.apply(_rows(step_inputs.commands[0]) @ self._forces) / self._mass
        p, v = _rows(state.p.columns()), _rows(state.v.columns())
        target = self.target(step_inputs.drift, len(p))
        moved = self.gravity.motion(target, p, v, self._times, push)
        return tuple(
            replace(state, p=Vec3(*p.T.reshape(3, *shape)), v=Vec3(*v.T.reshape(3, *shape)))
            for p, v in zip(*moved, strict=True)
        )

    def target(self, drift: Any, count: int) -> Target:
        """Targets of so many craft at the beginning of a control period."""
        e = self._eccentricity
        true = np.zeros(count)
        if isinstance(drift, EllipticOrbit):
            true = true + _true_anomaly(drift.mean_anomaly, e)
        return on_ellipse(self._mean_motion, e, true)


def _true_anomaly(mean_anomaly: Any, eccentricity: float) -> np.ndarray:
    """True anomalies, rad, of mean anomalies, rad, by SciPy's root of Kepler's equation."""

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
