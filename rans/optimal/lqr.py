"""The simplest controller that solves go-to-pose: what an agent must be compared with."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rans.fields import Heading, Quat, leaves
from rans.optimal.allocation import Allocation
from rans.optimal.guess import authority, rotation_vector
from rans.optimal.rounding import SigmaDelta
from rans.spacecraft import Spacecraft
from rans.timing import Timing


@dataclass(frozen=True)
class Weights:
    """Deviations that cost as much as full thrust (Bryson and Ho, "Applied Optimal Control", 1975).

    The defaults settle soonest among 8 settings tried on 50 starts, with `rans.timing.Timing`'s
    defaults, of each of floating-platform and free-flyer; all 8 settle every start.
    """

    position: float = 0.6
    """m."""
    velocity: float = 0.6
    """m/s."""
    attitude: float = math.radians(30.0)
    """rad."""
    spin: float = 0.5
    """rad/s."""


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
        force, torque = authority(craft)
        self._mass = craft.mass
        self._inertia = np.array(craft.inertia if craft.dimension == 3 else [[craft.inertia[2][2]]])
        self._identity = Heading(0.0) if craft.dimension == 2 else Quat(1.0, 0.0, 0.0, 0.0)
        self._translation = _gains(timing.control_period, weights.position, weights.velocity,
                                   force / craft.mass)
        self._rotation = _gains(timing.control_period, weights.attitude, weights.spin,
                                torque / float(np.linalg.eigvalsh(self._inertia)[-1]))
        self._allocation = Allocation(craft)
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


def _gains(period: float, deviation: float, rate: float, acceleration: float) -> tuple[float, float]:
    """Stiffness (1/s^2) and damping (1/s) of the discrete-time LQR of a double integrator.

    Weights are the inverse squares of the deviation, its rate and the acceleration.
    """
    from scipy.linalg import solve_discrete_are

    motion, effect = np.array([[1.0, period], [0.0, 1.0]]), np.array([[0.5 * period**2], [period]])
    price, effort = np.diag([deviation**-2, rate**-2]), np.array([[acceleration**-2]])
    cost_to_go = solve_discrete_are(motion, effect, price, effort)
    gain = np.linalg.solve(effort + effect.T @ cost_to_go @ effect, effect.T @ cost_to_go @ motion)
    return float(gain[0, 0]), float(gain[0, 1])
