"""The simplest controller that solves go-to-pose: what an agent must be compared with."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rans.fields import Heading, Quat, leaves
from rans.optimal.allocation import Allocation
from rans.optimal.guess import rotation_vector
from rans.optimal.rounding import SigmaDelta
from rans.spacecraft import Spacecraft
from rans.timing import Timing


@dataclass(frozen=True)
class Weights:
    """Deviations that cost as much as full thrust (Bryson and Ho, "Applied Optimal Control", 1975).

    The speed that costs as much follows from the deviation s and the acceleration a at full thrust:
    sqrt(a s). On its way in from far away the regulator then keeps to speeds that it can brake from as
    long as it starts within 6 s: see `_gains`.
    """

    position: float = 0.6
    """m; a sixth of 3.6 m."""
    attitude: float = math.radians(30.0)
    """rad; a sixth of half a turn."""


_DEFAULT = Weights()


class LQR:
    """Linear-quadratic regulator, allocation to the thrusters, sigma-delta rounding.

    Position in W and attitude in B are taken for double integrators, one per axis, which they are for
    small angles and spins; the gain of each is the discrete-time optimum for the control period.

    Args:
        craft: what flies.
        timing: gives the control period.
        weights: what to trade.

    Raises:
        ConfigError: the thrusters cannot push and turn the spacecraft in every direction.
    """

    name = "LQR"

    def __init__(self, craft: Spacecraft, timing: Timing, weights: Weights = _DEFAULT) -> None:
        self._allocation = Allocation(craft)
        force, torque = self._allocation.authority()
        self._mass = craft.mass
        self._inertia = np.array(craft.inertia if craft.dimension == 3 else [[craft.inertia[2][2]]])
        self._identity = Heading(0.0) if craft.dimension == 2 else Quat(1.0, 0.0, 0.0, 0.0)
        self._translation = _gains(timing.control_period, weights.position, force / craft.mass)
        self._rotation = _gains(timing.control_period, weights.attitude,
                                torque / float(np.linalg.eigvalsh(self._inertia)[-1]))
        self._rounding = SigmaDelta(craft)

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._rounding.reset(count)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; looks at the state, not at the observation."""
        return self._rounding.round(self._allocation.within_reach(self.wrench(state, goal)))

    def wrench(self, state: Any, goal: Any) -> np.ndarray:
        """The regulator's force and torque on B, (N, 3 or 6), N and N m."""
        stiffness, damping = self._translation
        pull = (goal.p - state.p).scale(stiffness * self._mass)
        force = pull + (goal.v - state.v).scale(damping * self._mass)
        stiffness, damping = self._rotation
        turn = rotation_vector(state.attitude.to(goal.attitude))
        spin_up = stiffness * turn - damping * np.array(state.spin())
        to_body = state.attitude.to(self._identity)
        return np.vstack([leaves(to_body.rotate(force)), self._inertia @ spin_up]).T


def _gains(period: float, deviation: float, acceleration: float) -> tuple[float, float]:
    """Stiffness (1/s^2) and damping (1/s) of the discrete-time LQR of a double integrator.

    With deviation s and acceleration a they tend to k = a / s and d = sqrt(3 k) for short periods: a
    damping ratio of 0.87. From a distance e the approach is then at most k e / d fast, and braking takes
    (k e / d)^2 / (2 a) = e^2 / (6 s): less than e as long as e < 6 s.
    """
    from scipy.linalg import solve_discrete_are

    motion, effect = np.array([[1.0, period], [0.0, 1.0]]), np.array([[0.5 * period**2], [period]])
    price = np.diag([1.0 / deviation**2, 1.0 / (acceleration * deviation)])
    effort = np.array([[1.0 / acceleration**2]])
    cost_to_go = solve_discrete_are(motion, effect, price, effort)
    gain = np.linalg.solve(effort + effect.T @ cost_to_go @ effect, effect.T @ cost_to_go @ motion)
    return float(gain[0, 0]), float(gain[0, 1])
