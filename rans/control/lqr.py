"""The simplest controller that solves every task: what an agent must be compared with."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rans.base.errors import checked
from rans.control.allocation import Rounding, inertia
from rans.control.dead_thrusters import ExpectsDead
from rans.control.regulator import (
    Deadband,
    ModelBased,
    Regulator,
    Weights,
    mass_share,
)
from rans.model.coordinates import rotation_vector
from rans.model.fields import Heading, Quat, leaves
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.tasks.base import Task


class LQR(ExpectsDead, ModelBased):
    """Linear-quadratic regulator, allocation to the thrusters, sigma-delta rounding.

    >>> rans.LQR("floating-platform", "go-to-pose")
    <LQR: GoToPose for floating-platform>

    Position in W moves as the task's drift says, attitude in B as a double integrator per axis, which it is
    for small angles and spins; the gains are the discrete-time optimum for the control period, and what the
    drift does at the goal, or the goal's own motion, is made up for. Where the task has no tolerance for the
    position or the attitude, only the velocity or the spin is brought to the goal's. Thrusters that are
    throttled or pulsed are given shares of their thrust instead of rounded commands.

    Raises:
        ConfigError: the thrusters cannot push the spacecraft in every direction, or cannot turn it as the task
            asks.
    """

    name = "LQR"
    tunable: ClassVar = {**Weights.tunable, **Deadband.tunable}
    """Bounds for `rans tune`."""
    weights: ClassVar = Weights()
    deadband: ClassVar = Deadband()
    """Settings by default."""

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None = None,
        weights: Weights = weights,
        deadband: Deadband = deadband,
    ) -> None:
        super().__init__(craft, task, timing)
        craft = self._craft
        self._settings = (weights, deadband)
        self._deadband = checked("deadband", deadband, Deadband)
        self._inertia = inertia(craft)
        self._identity = Heading(0.0) if craft.dimension == 2 else Quat(1.0, 0.0, 0.0, 0.0)
        self._regulator = Regulator.of(craft, self._task, self._timing, weights)
        self._rounding = Rounding(
            craft, self._timing.control_period, self._regulator.carried(craft)
        )

    def reset(self, count: int) -> None:
        """See `rans.episode.flight.Controller`."""
        self._rounding.reset(count)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.episode.flight.Controller`; looks at the state, not at the observation."""
        period = self._timing.control_period
        rest = self._deadband.holds(self._craft, self._task, state, goal, period=period)
        return self._rounding.round(self._demanded(state, goal, rest), rest, state.stores)

    def _demanded(self, state: Any, goal: Any, rest: np.ndarray) -> np.ndarray:
        """Wrench on B, (N, 3 or 6), of craft of which some rest."""
        return self.wrench(state, goal)

    def wrench(self, state: Any, goal: Any) -> np.ndarray:
        """The regulator's force and torque on B, (N, 3 or 6), N and N m, for the mass that is left.

        What it asks for is before allocation and rounding, so that it may exceed what thrusters give.
        """
        later = self._task.later(goal, self._timing.control_period)
        regulator = self._regulator
        # Force: feedback and feed-forward in W, expressed in B's axes at the start of the period.
        position, velocity = (np.array(leaves(gap)) for gap in (state.p - goal.p, state.v - goal.v))
        push = regulator.translation.acceleration(position, velocity)
        push = push + regulator.holding(state, goal, later)
        force = type(state.p)(*(self._craft.mass * push))
        to_body = state.attitude.to(self._identity)
        # Torque: feedback in B.
        turn = -rotation_vector(state.attitude.to(goal.attitude))
        spin = np.array(state.spin()) - np.array(goal.spin())
        spin_up = regulator.rotation.acceleration(turn, spin)
        body_wrench = np.vstack([leaves(to_body.rotate(force)), self._inertia @ spin_up])
        return (body_wrench * mass_share(self._craft, state)).T
