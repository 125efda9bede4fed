"""The simplest controller that solves every task: what an agent must be compared with."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rans.errors import checked
from rans.model.fields import Heading, Quat, leaves
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.optimal.control.regulator import Deadband, ModelBased, Regulator, Weights
from rans.optimal.trajectory.allocation import SigmaDelta, inertia
from rans.optimal.trajectory.guess import rotation_vector
from rans.tasks.base import Task

_WEIGHTS = Weights()
_DEADBAND = Deadband()

SWEEP = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0)
"""Factors on the default weights: from twice as stiff to four times as lazy."""


class LQR(ModelBased):
    """Linear-quadratic regulator, allocation to the thrusters, sigma-delta rounding.

    >>> rans.LQR("floating-platform", "go-to-pose")
    <LQR: GoToPose for floating-platform>

    Position in W and attitude in B are taken for double integrators, one per axis, which they are for small
    angles and spins; the gain of each is the discrete-time optimum for the control period. Where the task has
    no tolerance for the position or the attitude, only the velocity or the spin is brought to the goal's.

    Raises:
        ConfigError: the thrusters cannot push and turn the spacecraft in every direction.
    """

    name = "LQR"
    tunable: ClassVar = {**Weights.tunable, **Deadband.tunable}
    """Bounds for `rans tune`."""

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None = None,
        weights: Weights = _WEIGHTS,
        deadband: Deadband = _DEADBAND,
    ) -> None:
        super().__init__(craft, task, timing)
        craft = self._craft
        self._deadband = checked("deadband", deadband, Deadband)
        self._inertia = inertia(craft)
        self._identity = Heading(0.0) if craft.dimension == 2 else Quat(1.0, 0.0, 0.0, 0.0)
        self._regulator = Regulator.of(craft, self._task, self._timing, weights)
        self._rounding = SigmaDelta(craft, self._regulator.carried(craft))

    @classmethod
    def sweep(cls, craft: Spacecraft, task: Task, timing: Timing) -> dict[str, LQR]:
        """One for every factor of `SWEEP` on its weights, by name."""
        weights = asdict(_WEIGHTS)
        return {
            f"{cls.name} x {factor:g}": cls(
                craft,
                task,
                timing,
                Weights(**{name: factor * value for name, value in weights.items()}),
            )
            for factor in SWEEP
        }

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._rounding.reset(count)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; looks at the state, not at the observation."""
        rest = self._deadband.holds(self._craft, self._task, state, goal)
        return self._rounding.round(self.wrench(state, goal), rest)

    def wrench(self, state: Any, goal: Any) -> np.ndarray:
        """The regulator's force and torque on B, (N, 3 or 6), N and N m."""
        stiffness, damping = self._regulator.translation.gain * self._craft.mass
        force = (goal.p - state.p).scale(stiffness) + (goal.v - state.v).scale(damping)
        stiffness, damping = self._regulator.rotation.gain
        turn = rotation_vector(state.attitude.to(goal.attitude))
        spin_up = stiffness * turn + damping * (np.array(goal.spin()) - np.array(state.spin()))
        to_body = state.attitude.to(self._identity)
        return np.vstack([leaves(to_body.rotate(force)), self._inertia @ spin_up]).T
