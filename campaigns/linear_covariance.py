"""Linear covariance of a craft that LQR keeps at a point on an orbit: how far errors spread its state.

Errors are propagated linearly about the flight without errors, once and exactly, in place of thousands of flights.
Source: D. K. Geller, "Linear covariance techniques for orbital rendezvous analysis and autonomous onboard mission
planning", Journal of Guidance, Control, and Dynamics 29 (6), 2006.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rans.model.drift import Drift
from rans.model.spacecraft import Spacecraft
from rans.optimal.control.linear_motion import LinearMotion
from rans.randomization.conditions import Conditions, bounds

Array = np.ndarray
Law = Callable[[Array], Array]
"""Commands (N, thrusters) from 0 to 1 for states (N, 6) of position and velocity in W, m and m/s."""

_STEP = 1e-3
"""Step of the central differences of the law, m and m/s: within it the law of a throttled craft is linear."""
_STEP_OF_TIME = 1e-3
"""Step of the central differences in time, s."""


@dataclass(frozen=True)
class LinearCovariance:
    """Covariances of position and velocity at the beginnings of T control periods and at the end, by error."""

    nominal: Array
    """(T + 1, 6) flight without errors: position and velocity in W, m and m/s."""
    sources: dict[str, Array]
    """(T + 1, 6, 6) covariance that each error causes alone. Errors are independent: the sum is that of all."""

    @property
    def all(self) -> Array:
        """(T + 1, 6, 6) covariance of all errors together."""
        return np.sum([*self.sources.values()], axis=0)


def spread(covariance: Array) -> Array:
    """Root of the mean square of position (m) and of velocity (m/s) about their means, (..., 2)."""
    variances = np.diagonal(covariance, axis1=-2, axis2=-1)
    return np.sqrt(np.stack([variances[..., :3].sum(-1), variances[..., 3:].sum(-1)], axis=-1))


def linear_covariance(
    craft: Spacecraft,
    drift: Drift,
    law: Law,
    start: Array,
    period: float,
    steps: int,
    conditions: Conditions,
) -> LinearCovariance:
    """Propagate the errors of these conditions through a loop of motion and law.

    The craft has throttled thrusters, does not turn, and its law does not saturate. Errors are noise and bias of
    position and velocity, thrust of each thruster, command delay of less than a control period, mass and constant
    force; other conditions are ignored.

    Args:
        craft: with thrusters along the axes of W.
        drift: equations of motion between burns, linear.
        law: what flies.
        start: (6,) position and velocity in W, m and m/s.
        period: control period, s.
        steps: number of control periods T.
        conditions: what varies.
    """
    thrusters, sensors = conditions.thrusters, conditions.sensors
    forces = np.array([t.force * np.array(t.direction) for t in craft.thrusters])
    per_command = forces / craft.mass * _middle(thrusters.thrust) / _middle(conditions.body.mass)
    late = _middle(thrusters.command_delay)
    first, second, _ = _effects(drift, period, late)
    _, _, whole = _effects(drift, period, 0.0)
    motion = LinearMotion.of(drift, 3, period)
    matrix = motion.matrix

    # Flight without errors, and the gain of the law along it.
    nominal = [np.asarray(start, float)]
    commands = [np.zeros(len(forces))]
    gains = []
    for _ in range(steps):
        x = nominal[-1]
        command = law(x[None])[0]
        beside = np.concatenate([x + _STEP * np.eye(6), x - _STEP * np.eye(6)])
        ahead, behind = np.split(law(beside) @ per_command, 2)
        gains.append((ahead - behind).T / (2.0 * _STEP))
        acceleration = first @ (commands[-1] @ per_command) + second @ (command @ per_command)
        nominal.append(matrix @ x + motion.offset + acceleration)
        commands.append(command)

    # Deviations of state and last acceleration, (9,): noise as a covariance, constant errors by their columns.
    noise = np.diag(
        np.repeat([_square(sensors.position.noise), _square(sensors.velocity.noise)], 3)
    )
    biases = np.repeat([_square(sensors.position.bias), _square(sensors.velocity.bias)], 3) / 3.0
    later, _, _ = _effects(drift, period, late + _STEP_OF_TIME)
    of_noise = np.zeros((9, 9))
    columns = {
        "thrust error": np.zeros((9, len(forces))),
        "command delay": np.zeros((9, 1)),
        "mass": np.zeros((9, 1)),
        "constant force": np.zeros((9, 3)),
        "navigation bias": np.zeros((9, 6)),
    }
    variances = {
        "thrust error": np.full(len(forces), _variance(thrusters.thrust, relative=True)),
        "command delay": np.full(1, _variance(thrusters.command_delay)),
        "mass": np.full(1, _variance(conditions.body.mass, relative=True)),
        # A random direction: a third of the mean square along each axis.
        "constant force": np.full(3, _square(conditions.disturbances.force) / 3.0),
        "navigation bias": biases,
    }
    sources = {name: [np.zeros((6, 6))] for name in ("navigation noise", *columns)}
    for k in range(steps):
        gain = gains[k]
        step = np.block([[matrix + second @ gain, first], [gain, np.zeros((3, 3))]])
        reading = np.vstack([second @ gain, gain])
        of_noise = step @ of_noise @ step.T + reading @ noise @ reading.T
        last, now = commands[k], commands[k + 1]
        pushes = {
            # A thruster's error acts as its command does.
            "thrust error": first @ (last[:, None] * per_command).T
            + second @ (now[:, None] * per_command).T,
            "command delay": ((later - first) / _STEP_OF_TIME)
            @ ((last - now) @ per_command)[:, None],
            "mass": -(first @ (last @ per_command) + second @ (now @ per_command))[:, None],
            "constant force": whole / craft.mass,
        }
        for name, before in columns.items():
            new = step @ before
            if name == "navigation bias":
                new = new + reading
            else:
                new[:6] += pushes[name]
            columns[name] = new
            sources[name].append((new * variances[name]) @ new.T)
            sources[name][-1] = sources[name][-1][:6, :6]
        sources["navigation noise"].append(of_noise[:6, :6].copy())
    return LinearCovariance(np.array(nominal), {k: np.array(x) for k, x in sources.items()})


def _effects(drift: Drift, period: float, late: float) -> tuple[Array, Array, Array]:
    """Effects (6, 3) on the state after a period of the last and the new acceleration, and of both if equal."""
    whole = LinearMotion.of(drift, 3, period).effect
    rest = LinearMotion.of(drift, 3, period - late).effect
    return whole - rest, rest, whole


def _middle(values: object) -> float:
    low, high = bounds(values)  # type: ignore[arg-type]
    return 0.5 * (low + high)


def _variance(values: object, relative: bool = False) -> float:
    """Variance of a uniform distribution, relative to the square of its mean if asked."""
    low, high = bounds(values)  # type: ignore[arg-type]
    return (high - low) ** 2 / 12.0 / (_middle(values) ** 2 if relative else 1.0)


def _square(values: object) -> float:
    """Mean square of a uniform distribution."""
    low, high = bounds(values)  # type: ignore[arg-type]
    return (low * low + low * high + high * high) / 3.0
