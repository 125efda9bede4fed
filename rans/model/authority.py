"""What a spacecraft's thrusters and reaction wheels can give along each axis while nothing else moves."""

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
    """The largest force along one axis of B, or torque about it, with every other force and torque at zero."""

    axis: str
    """Such as "force x" or "torque z"."""
    unit: str
    """N or N m."""
    forwards: float
    """Along the axis."""
    backwards: float
    """The other way, as a positive number."""
    acceleration: float
    """What the smaller of both gives the craft, m/s^2 or rad/s^2, as if its axes were principal ones."""
    acceleration_unit: str
    """m/s^2 or rad/s^2."""


def authorities(craft: Spacecraft) -> tuple[Authority, ...]:
    """Of every axis: F_x, F_y and tau_z in the plane; three forces and three torques in space.

    Each is a linear programme over what commands give on average in a control period: shares of full force u
    from 0, or the least level of engines that are always lit, to the largest one, and of each wheel's torque
    from -1 to 1. Of a shared supply (``thrust_sharing = "split"``) all shares together are at most one: averages
    of F_i = F a_i / max(sum a, 1). Largest torques last for as long as wheels are not full. An axis along which
    others cannot be balanced has 0.
    """
    from scipy.optimize import linprog

    size = craft.degrees_of_freedom
    wheels = np.zeros((size, len(craft.wheels)))
    if craft.wheels:
        wheels[craft.dimension :] = np.array(craft.wheel_map).T
    table = np.column_stack([np.array(craft.wrench_map).T, wheels])
    scale = np.abs(table).max(axis=1)
    scale = np.where(scale > 0.0, scale, 1.0)
    bounds = [(one.low, one.high) for one in craft.commands]
    supply = None
    if craft.thrust_sharing == "split":
        supply = np.append(np.ones(len(craft.thrusters)), np.zeros(len(craft.wheels)))[None]
    inertia = [craft.mass] * craft.dimension
    moments = np.diag(np.array(craft.inertia)).tolist()
    inertia += moments[2:] if craft.dimension == 2 else moments

    found = []
    for index, (axis, unit, acceleration_unit) in enumerate(_AXES[craft.dimension]):
        others = [k for k in range(size) if k != index]
        ways = []
        for sign in (1.0, -1.0):
            best = linprog(
                -sign * table[index] / scale[index],
                A_ub=supply,
                b_ub=None if supply is None else [1.0],
                A_eq=(table / scale[:, None])[others],
                b_eq=np.zeros(size - 1),
                bounds=bounds,
            )
            ways.append(max(0.0, -best.fun * scale[index]) if best.success else 0.0)
        acceleration = min(ways) / inertia[index]
        found.append(Authority(axis, unit, ways[0], ways[1], acceleration, acceleration_unit))
    return tuple(found)


def authority_rows(found: Sequence[Authority]) -> list[tuple[str, str, str, str]]:
    """Axis, largest force or torque each way, and the acceleration that the smaller one gives, as text."""
    return [
        (
            one.axis,
            f"{_figure(one.forwards)} {one.unit}",
            f"{_figure(one.backwards)} {one.unit}",
            f"{one.acceleration:.3g} {one.acceleration_unit}",
        )
        for one in found
    ]


def _figure(value: float) -> str:
    """Three digits, and thousands without an exponent."""
    return f"{value:,.0f}" if value >= 1000.0 else f"{value:.3g}"
