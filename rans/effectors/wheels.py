"""Reaction wheels over one control period: torques within their limits, and the momentum they hold."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from operator import add
from typing import Any

from rans.model.fields import Field, Vec3, where
from rans.model.spacecraft import Spacecraft


def motor_torques(
    craft: Spacecraft, command: Sequence[Field], momenta: Sequence[Field], period: float
) -> tuple[Field, ...]:
    """Torque of each wheel's motor on its wheel, N m, constant over the control period.

    A motor gives what it is commanded, or less where the wheel's momentum would leave its limits by the end
    of the period.

    Args:
        craft: whose wheels.
        command: of all effectors; those of the wheels come last, -1 to 1.
        momenta: of the wheels at the start of the period, N m s.
        period: s.
    """
    torques = []
    own = command[len(craft.thrusters) :]
    for wheel, share, momentum in zip(craft.wheels, own, momenta, strict=True):
        wanted = share * wheel.max_torque
        most = (wheel.max_momentum - momentum) * (1.0 / period)
        least = (-wheel.max_momentum - momentum) * (1.0 / period)
        wanted = where(wanted < most, wanted, most)
        torques.append(where(wanted > least, wanted, least))
    return tuple(torques)


def along_axes(craft: Spacecraft, amounts: Sequence[Field]) -> Any:
    """Sum of amounts about the wheels' axes, in B: a vector in space, a scalar about z in the plane."""
    if craft.dimension == 2:
        return reduce(add, (x * w.axis[2] for x, w in zip(amounts, craft.wheels, strict=True)))
    columns = []
    for k in range(3):
        pairs = zip(amounts, craft.wheels, strict=True)
        terms = [x * wheel.axis[k] for x, wheel in pairs if wheel.axis[k] != 0.0]
        columns.append(reduce(add, terms) if terms else amounts[0] * 0.0)
    return Vec3(*columns)
