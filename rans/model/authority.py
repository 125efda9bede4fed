"""Control authority of a spacecraft: largest pure force and pure torque along each body axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rans.model.spacecraft import Spacecraft

_AXES: dict[int, tuple[tuple[str, str, str], ...]] = {
    2: (("force x", "N", "m/s^2"), ("force y", "N", "m/s^2"), ("torque z", "N m", "rad/s^2")),
    3: (
        ("force x", "N", "m/s^2"),
        ("force y", "N", "m/s^2"),
        ("force z", "N", "m/s^2"),
        ("torque x", "N m", "rad/s^2"),
        ("torque y", "N m", "rad/s^2"),
        ("torque z", "N m", "rad/s^2"),
    ),
}


@dataclass(frozen=True)
class Authority:
    """Largest force along one axis of B, or torque about it, with every other force and torque at zero."""

    axis: str
    """Name of the axis, such as "force x" or "torque z"."""
    unit: str
    """N or N m."""
    forwards: float
    """Largest force or torque in the positive direction."""
    backwards: float
    """Largest force or torque in the negative direction, as a positive number."""
    acceleration: float
    """Acceleration by the smaller of both, m/s^2 or rad/s^2, as if the axes of B were principal axes."""
    acceleration_unit: str
    """m/s^2 or rad/s^2."""


def authorities(craft: Spacecraft) -> tuple[Authority, ...]:
    """Control authority along every axis: F_x, F_y and tau_z in the plane; three forces and three torques in space.

    Each is the optimum of a linear program over the mean outputs of the actuators in a control period. Thrusters
    give shares of full force from 0 (engines that are always lit: from their least level) to their largest
    level; wheels give shares of their torque from -1 to 1. With a shared supply (``thrust_sharing = "split"``)
    the shares of all thrusters sum to at most one: means of F_i = F a_i / max(sum a, 1). Torques of wheels last
    until the wheels are saturated. An axis has 0 if the other forces and torques cannot be balanced.
    """
    from scipy.optimize import linprog

    # Force or torque along each axis by each actuator; rows are scaled to 1 for the solver.
    size = craft.degrees_of_freedom
    wheels = np.zeros((size, craft.wheel_count))
    if craft.wheels:
        wheels[craft.dimension :] = np.array(craft.wheel_map).T
    table = np.column_stack([craft.wrenches.T, wheels])
    scale = np.abs(table).max(axis=1)
    scale = np.where(scale > 0.0, scale, 1.0)
    bounds = [(command.low, command.high) for command in craft.commands]
    # The limit of a shared supply, and the mass or moment of each axis.
    supply = None
    if craft.thrust_sharing == "split":
        supply = np.append(np.ones(craft.thruster_count), np.zeros(craft.wheel_count))[None]
    inertia = [craft.mass] * craft.dimension
    moments = np.diag(np.array(craft.inertia)).tolist()
    inertia += moments[2:] if craft.dimension == 2 else moments

    # The optimum of every axis in both directions, all other axes being balanced.
    authorities = []
    for index, (axis, unit, acceleration_unit) in enumerate(_AXES[craft.dimension]):
        others = [k for k in range(size) if k != index]
        extremes = []
        for sign in (1.0, -1.0):
            best = linprog(
                -sign * table[index] / scale[index],
                A_ub=supply,
                b_ub=None if supply is None else [1.0],
                A_eq=(table / scale[:, None])[others],
                b_eq=np.zeros(size - 1),
                bounds=bounds,
            )
            extremes.append(max(0.0, -best.fun * scale[index]) if best.success else 0.0)
        acceleration = min(extremes) / inertia[index]
        authorities.append(
            Authority(axis, unit, extremes[0], extremes[1], acceleration, acceleration_unit)
        )
    return tuple(authorities)


def authority_rows(authorities: Sequence[Authority]) -> list[tuple[str, str, str, str]]:
    """Rows of text: axis, largest force or torque in each direction, acceleration by the smaller one."""
    return [
        (
            authority.axis,
            f"{_figure(authority.forwards)} {authority.unit}",
            f"{_figure(authority.backwards)} {authority.unit}",
            f"{authority.acceleration:.3g} {authority.acceleration_unit}",
        )
        for authority in authorities
    ]


def _figure(value: float) -> str:
    """Number with three significant digits; thousands without an exponent."""
    return f"{value:,.0f}" if value >= 1000.0 else f"{value:.3g}"
