"""Offset-free control: what pushes and turns besides the thrusters is estimated, and countered."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rans.errors import ConfigError, checked
from rans.model.body import Body
from rans.model.drift import FREE, Drift
from rans.model.dynamics import Wrench, advance, wrench
from rans.model.fields import Heading, Quat, Vec2, Vec3, leaves
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.optimal.control.mpc import MPC, MPCSettings
from rans.optimal.control.regulator import Deadband, Weights
from rans.optimal.trajectory.allocation import check_thrusters_alone, inertia
from rans.randomization.conditions import Conditions
from rans.tasks.base import Task


@dataclass(frozen=True)
class Trust:
    """How fast an estimate follows what is seen.

    Raises:
        ConfigError: the share is not within 0 and 1.
    """

    share: float = 0.1
    """Share of what a control period shows beyond the estimate: 0 never learns, 1 forgets all before. A reading of
    1 cm/s noise then moves the estimated force on a 5 kg platform by 0.04 N."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.share) and 0.0 <= self.share <= 1.0):
            raise ConfigError(f"observer: share must be from 0 to 1, got {self.share!r}.")


class Observer:
    """Estimates a force and a torque, constant in W, from predicted and seen velocities.

    Predicts by the nominal craft and the estimate where the commands lead; what is missed, as a wrench, goes
    into the estimate by a share (a Luenberger observer of one state an axis). Another mass or weak thrusters
    look like a force while they push.
    """

    def __init__(
        self, craft: Spacecraft, timing: Timing, trust: Trust, drift: Drift = FREE
    ) -> None:
        self._craft = craft
        self._drift = drift
        self._period = timing.control_period
        self._trust = trust
        self._body = Body.of(craft)
        self._inertia = inertia(craft)
        self.reset(0)

    def reset(self, count: int) -> None:
        """Nothing acts and nothing is expected: ``count`` new episodes start."""
        axes = self._craft.dimension
        self.force, self.torque = np.zeros((axes, count)), np.zeros((len(self._inertia), count))
        self._expected: Any = None

    def see(self, state: Any) -> None:
        """Learn from the state (fields (N,)) that followed what `expect` was told.

        It adds to `force` and `torque`; one call a period, after `expect` of the period before.
        """
        if self._expected is None:
            return
        rate = self._trust.share / self._period
        missed = np.array(leaves(state.v - self._expected.v))
        self.force = self.force + rate * self._craft.mass * missed
        spin = np.array(state.spin()) - np.array(self._expected.spin())
        self.torque = self.torque + rate * self._turned(self._inertia @ spin, state.attitude)

    def expect(self, state: Any, commands: np.ndarray) -> None:
        """Predict what follows from commands (N, thrusters) in this state."""
        applied = wrench(self._craft, tuple(commands.T))
        self._expected = advance(
            state, applied, self._body, self._period, disturbance=self.acting(), drift=self._drift
        )

    def acting(self) -> Wrench:
        """The estimate, as the equations take it."""
        if self._craft.dimension == 2:
            return Wrench(Vec2(*self.force), self.torque[0])
        return Wrench(Vec3(*self.force), Vec3(*self.torque))

    def in_body(self, state: Any) -> np.ndarray:
        """The estimate as a wrench on B, (N, 3 or 6)."""
        to_body = state.attitude.to(
            Heading(0.0) if self._craft.dimension == 2 else Quat(1.0, 0.0, 0.0, 0.0)
        )
        force = np.array(leaves(to_body.rotate(self.acting().force)))
        return np.vstack([force, self._turned(self.torque, to_body)]).T

    def _turned(self, torque: np.ndarray, by: Any) -> np.ndarray:
        """A torque (1 or 3, N) expressed in another frame; about z it is the same in all."""
        return torque if self._craft.dimension == 2 else np.array(leaves(by.rotate(Vec3(*torque))))


_WEIGHTS = Weights()
_DEADBAND = Deadband()
_SETTINGS = MPCSettings()
_TRUST = Trust()


class ObserverMPC(MPC):
    """An `MPC` that counters what an `Observer` estimates, and knows of it when it rests.

    >>> from rans.optimal.control.observer import ObserverMPC, Trust
    >>> ObserverMPC("floating-platform", "go-to-pose", trust=Trust(share=0.05))
    <MPC + observer: GoToPose for floating-platform>

    It plans for a craft on which nothing but the task's drift acts, and takes the estimate off the wrench it
    wants (Ohnishi's disturbance observer). It is told nothing but readings: no condition, no true body.

    Raises:
        ConfigError: the craft has effectors besides thrusters, or see `MPC`.
    """

    name = "MPC + observer"

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None = None,
        weights: Weights = _WEIGHTS,
        deadband: Deadband = _DEADBAND,
        settings: MPCSettings = _SETTINGS,
        trust: Trust = _TRUST,
    ) -> None:
        super().__init__(craft, task, timing, weights, deadband, settings)
        check_thrusters_alone(self._craft, "estimates of disturbances")
        self._observer = Observer(
            self._craft, self._timing, checked("trust", trust, Trust), self._task.drift
        )

    def expecting(self, conditions: Conditions | None) -> ObserverMPC:
        """The controller itself: a dead thruster is among what it estimates."""
        return self

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        super().reset(count)
        self._observer.reset(count)

    def memory(self) -> np.ndarray:
        """Refused (`ConfigError`): the estimate depends on commands that only one flight really gives."""
        raise ConfigError(
            f"{self.name} cannot look ahead: it estimates forces from what its own commands lead to, and "
            "would mistake a changed command for a force; use mpc."
        )

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands (N, n) from the state, not the observation, which the observer learns from.

        The order counts: it sees, plans, then expects what was rounded, not what was planned.
        """
        self._observer.see(state)
        rest = self._deadband.holds(
            self._craft,
            self._task,
            state,
            goal,
            self._observer.acting(),
            self._timing.control_period,
        )
        planned = self._planned(state, goal, rest) - self._observer.in_body(state)
        commands = self._rounding.round(planned, rest, state.stores)
        self._observer.expect(state, commands)
        return commands
