"""Torques of reaction wheels: within what limits a controller commands them, and which torques need them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rans.model.spacecraft import Spacecraft

_RESERVE = 0.2
"""Part of the largest momentum that a wheel keeps free where thrusters can take its torque: it is there for the
turns that follow, and a wheel at rest would otherwise be full after some minutes of one-sided disturbance."""
_DEPENDENT = 1e-9
"""Singular value, over the largest, up to which thrusters give no torque in a direction."""


class WheelTorques:
    """The commands with which reaction wheels give as much of a torque as they can.

    The command of a wheel is within -1 and 1, and takes its momentum no farther than its limit in a control period.
    Where thrusters alone can turn the craft about a wheel's axis, either way, that limit is 80 % of the largest
    momentum: a wheel beyond it slows down at once, and thrusters balance the torque (momentum unloading). Other
    wheels go to their largest momentum, and nothing unloads them.

    More wheels than axes share a torque by the pseudoinverse; what a wheel at its limit lacks is given to the
    others (redistributed pseudoinverse: Virnig and Bodden, AIAA 94-3609, 1994).

    Args:
        craft: with reaction wheels.
        period: control period, s.
    """

    def __init__(self, craft: Spacecraft, period: float) -> None:
        self.map = np.array(craft.wheel_map)
        """(wheels, 1 or 3) torque of each on the craft at command 1, in B, N m."""
        self._inverse = np.linalg.pinv(self.map)
        self._redundant = len(self.map) > np.linalg.matrix_rank(self.map)
        torques = np.array([wheel.max_torque for wheel in craft.wheels])
        self._change = torques * period
        momenta = np.array([wheel.max_momentum for wheel in craft.wheels])
        unloaded = np.array([_thrusters_turn(craft, row) for row in self.map])
        self._momentum = np.where(unloaded, (1.0 - _RESERVE) * momenta, momenta)
        self._first = int(craft.propellant is not None)

    def acceleration(self, inertia: np.ndarray) -> float:
        """Angular acceleration that wheels give about every axis of B, rad/s^2, of an inertia (1, 1) or (3, 3)."""
        reach = 1.0 / np.abs(self._inverse).max(axis=1)
        return float((reach / np.linalg.norm(inertia, axis=0)).min())

    def bounds(self, stores: Sequence[Any], rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest commands, (N, wheels) each, of craft with these stores (`rans.model.spacecraft.Store`).

        A wheel beyond its limit has bounds of one sign, but for craft that ``rest``, (N,) bool: nothing balances
        its unloading while thrusters are shut.
        """
        wheels = len(self.map)
        kept = stores[self._first : self._first + wheels]
        momenta = np.stack([np.broadcast_to(np.asarray(h, float), len(rest)) for h in kept], axis=1)
        low = np.clip((-self._momentum - momenta) / self._change, -1.0, 1.0)
        high = np.clip((self._momentum - momenta) / self._change, -1.0, 1.0)
        most = np.where(rest, 0.0, np.inf)[:, None]
        return np.minimum(low, most), np.maximum(high, -most)

    def commands(self, torque: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Commands (..., wheels) for torques on the craft in B, (..., 1 or 3), N m, within bounds (..., wheels)."""
        commands = np.clip(torque @ self._inverse, low, high)
        if not self._redundant:
            return commands
        for _ in range(len(self.map) - 1):  # at least one more is at its limit after each round
            free = (commands > low) & (commands < high)
            inverse = np.linalg.pinv(np.where(free[..., None], self.map, 0.0))
            missing = (torque - commands @ self.map)[..., None, :]
            commands = np.clip(commands + (missing @ inverse)[..., 0, :], low, high)
        return commands


def thruster_turns(craft: Spacecraft) -> np.ndarray:
    """Orthonormal directions in B about which thrusters give torques, (1 or 3, r) with r from 0 to 1 or 3."""
    torques = craft.wrenches[:, craft.dimension :]
    directions, sizes, _ = np.linalg.svd(torques.T)
    return directions[:, : int((sizes > _DEPENDENT * sizes.max(initial=1e-300)).sum())]


def _thrusters_turn(craft: Spacecraft, torque: np.ndarray) -> bool:
    """Whether open thrusters give a torque in B (1 or 3,) and its opposite, without a force."""
    if not craft.thrusters:
        return False
    from scipy.optimize import linprog

    columns = craft.wrenches.T
    size = np.abs(columns).max(axis=1)
    size[size == 0.0] = 1.0
    wanted = np.concatenate([np.zeros(craft.dimension), torque]) / size
    wanted = wanted / np.linalg.norm(wanted)
    nothing = np.zeros(columns.shape[1])
    scaled = columns / size[:, None]
    rounding = {"primal_feasibility_tolerance": 1e-6}
    return all(
        linprog(nothing, A_eq=scaled, b_eq=sign * wanted, options=rounding).success
        for sign in (1.0, -1.0)
    )
