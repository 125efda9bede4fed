"""Control authority of a spacecraft: largest pure force and pure torque along each body axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rans.model.spacecraft import Spacecraft


@dataclass(frozen=True)
class Authority:
    """Largest force along one axis of B, or torque about it, with every other force and torque at zero."""

    axis: str
    """Name of the axis, such as "force x" or "torque z"."""
    forwards: float
    """Largest force, N, or torque, N m, in the positive direction."""
    backwards: float
    """Largest force or torque in the negative direction, as a positive number."""
    acceleration: float
    """Acceleration by the smaller of both, m/s^2 or rad/s^2, as if the axes of B were principal axes."""


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
    table = np.vstack([craft.wrenches, np.zeros((craft.wheel_count, craft.degrees_of_freedom))]).T
    if craft.wheels:
        table[craft.dimension :, craft.thruster_count :] = np.array(craft.wheel_map).T
    scale = np.abs(table).max(axis=1)
    scale = np.where(scale > 0.0, scale, 1.0)
    bounds = [(command.low, command.high) for command in craft.commands]
    # The limit of a shared supply, and the mass or moment of each axis.
    shared = craft.thrust_sharing == "split"
    supply = np.append(np.ones(craft.thruster_count), np.zeros(craft.wheel_count))[None]
    moments = np.diag(np.array(craft.inertia)).tolist()
    if craft.dimension == 2:
        axes = ("force x", "force y", "torque z")
        inertia = [craft.mass, craft.mass, moments[2]]
    else:
        axes = ("force x", "force y", "force z", "torque x", "torque y", "torque z")
        inertia = [craft.mass] * 3 + moments

    # The optimum of every axis in both directions, all other axes being balanced.
    authorities = []
    for index, axis in enumerate(axes):
        extremes = []
        for sign in (1.0, -1.0):
            best = linprog(
                -sign * table[index] / scale[index],
                A_ub=supply if shared else None,
                b_ub=[1.0] if shared else None,
                A_eq=np.delete(table / scale[:, None], index, axis=0),
                b_eq=np.zeros(len(axes) - 1),
                bounds=bounds,
            )
            extremes.append(max(0.0, -best.fun * scale[index]) if best.success else 0.0)
        forwards, backwards = extremes
        authorities.append(Authority(axis, forwards, backwards, min(extremes) / inertia[index]))
    return tuple(authorities)


def authority_rows(authorities: Sequence[Authority]) -> list[tuple[str, str, str, str]]:
    """Rows of text: axis, largest force or torque in each direction, acceleration by the smaller one."""
    rows = []
    for authority in authorities:
        turns = authority.axis.startswith("torque")
        unit, of_acceleration = ("N m", "rad/s^2") if turns else ("N", "m/s^2")
        forwards, backwards = (
            f"{_figure(size)} {unit}" for size in (authority.forwards, authority.backwards)
        )
        acceleration = f"{authority.acceleration:.3g} {of_acceleration}"
        rows.append((authority.axis, forwards, backwards, acceleration))
    return rows


def _figure(value: float) -> str:
    """Number with three significant digits; thousands without an exponent."""
    return f"{value:,.0f}" if value >= 1000.0 else f"{value:.3g}"
