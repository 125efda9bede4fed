"""Path-integral control with on/off thrusters: plans are drawn, flown, and weighed by what they cost."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rans.errors import ConfigError, checked, whole
from rans.model.body import Body
from rans.model.dynamics import advance, wrench
from rans.model.fields import map_leaves
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.optimal.control.regulator import Deadband, ModelBased
from rans.optimal.control.switching import Curve, Switching
from rans.optimal.trajectory.allocation import ThrusterPatterns, check_thrusters_alone
from rans.tasks.base import Task

PERIODS = 2
"""Control periods of a plan: what follows is left to the least time, which knows how to brake. Two settle from
all of 64 starts of go-to-pose on the floating platform; three spend 5 % less thrust, but do not settle from
one."""
_FIRST = 0.25
"""Chance of a thruster to be open where nothing is known."""
_VIOLATED = 10.0
_VIOLATION = 100.0
"""Cost of a negative margin of a constraint after a period, s, and what it grows by per unit (SI)."""
_DOUBT = 0.04
"""Least chance of a thruster to be drawn open, or shut."""
_PARTS = 0.5 ** np.arange(8.0)
"""Parts of a pulse that throttled and pulsed thrusters give: a whole one may be too fast for a speed limit."""


@dataclass(frozen=True)
class Sampling:
    """How plans are drawn and weighed.

    Raises:
        ConfigError: a count is not a whole number >= 1, or the temperature not a finite number > 0.
    """

    samples: int = 128
    """Plans a round."""
    rounds: int = 2
    """Rounds a control period, each about what the one before found good."""
    temperature: float = 0.05
    """Cost, s, that makes a plan e times less likely."""

    def __post_init__(self) -> None:
        for key in ("samples", "rounds"):
            whole(f"MPPI: {key}", getattr(self, key))
        if not (math.isfinite(self.temperature) and self.temperature > 0):
            raise ConfigError(
                f"MPPI: temperature must be finite and > 0 s, got {self.temperature!r}."
            )


_CURVE = Curve(thrust_time_weight=0.085)
_DEADBAND = Deadband()
_DRAWS = Sampling()


class MPPI(ModelBased):
    """Plans patterns of open thrusters for the next seconds by sampling, and flies the first of the best.

    >>> from rans.optimal.control.sampling import MPPI, Sampling
    >>> MPPI("floating-platform", "go-to-pose", draws=Sampling(samples=64))
    <MPPI: GoToPose for floating-platform>

    A plan is a chance of every thruster to be open in each of the next `PERIODS`. Plans are drawn from it and
    flown by the engines' equations in the task's drift, all at once; those that cost less count more in the
    new chances (after Williams, Aldrich and Theodorou, J. Guidance Control Dynamics 40, 2017: bits, no normal
    deviates). Throttled and pulsed thrusters also draw which part of its pulses each period of a plan gives. A plan
    costs its thrust, and the mean over its time of the least time that is left by the
    `Curve` of `Switching`: what is left at its end alone could be had by waiting first. Negative margins of the
    task's constraints cost more than any way round; they are seen no farther ahead than a plan is long. In missions
    on an orbit it stays at the goal from the arrival on (`rans.tasks.afterwards`).

    Raises:
        ConfigError: the craft has effectors besides thrusters, or see `Switching`.
    """

    name = "MPPI"
    heeds_constraints = True
    slow = True
    """Many episodes are flown by many processes."""
    tunable: ClassVar = {**Switching.tunable, "draws.temperature": (0.005, 0.5)}
    """Bounds for `rans tune`."""

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None = None,
        curve: Curve = _CURVE,
        deadband: Deadband = _DEADBAND,
        draws: Sampling = _DRAWS,
    ) -> None:
        super().__init__(craft, task, timing)
        check_thrusters_alone(self._craft, "plans of open thrusters")
        self._deadband = deadband
        self._draws = checked("draws", draws, Sampling)
        with warnings.catch_warnings(action="ignore"):  # it need not know the constraints
            self._value = Switching(self._craft, self._task, self._timing, curve, deadband)
        craft = self._craft
        self._period = self._timing.control_period
        self._body = Body.of(craft)
        self._price = self._value.price
        self._patterns = ThrusterPatterns(craft)
        self._forces = np.array([thruster.force for thruster in craft.thrusters])
        self._parts = _PARTS if craft.actuators.is_continuous else _PARTS[:1]
        self._afterwards = self._task.afterwards(craft, self._timing)
        self.reset(0)

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`; what is drawn is the same after every reset."""
        if self._afterwards is not None:
            self._afterwards.reset(count)
        self._random = np.random.default_rng(0)
        self._chances = np.full((count, PERIODS, len(self._forces)), _FIRST)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands (N, n) from the state, not the observation; remembers each episode's chances of opening."""
        rest = self._deadband.holds(self._craft, self._task, state, goal, period=self._period)
        if self._afterwards is not None:
            goal = self._afterwards.goal(state, goal)
            rest = rest | self._afterwards.stays
        commands = np.zeros((len(rest), len(self._forces)))
        awake = np.flatnonzero(~rest)
        if len(awake):
            state_now, goal_now = (map_leaves(lambda x: x[awake], s) for s in (state, goal))
            commands[awake] = self._planned(state_now, goal_now, awake)
        self._chances[rest] = _FIRST
        if self._afterwards is not None:
            commands = self._afterwards.commands(state, goal, commands)
        return commands

    def _planned(self, state: Any, goal: Any, which: np.ndarray) -> np.ndarray:
        """First patterns of the best plans of some episodes, (M, thrusters); their chances go on in time.

        Draws are in one order for all awake episodes: who rests changes the draws of the others.
        """
        chances = self._chances[which]
        shape = len(which), self._draws.samples, *chances.shape[1:]
        best = np.zeros(chances.shape)
        part = np.ones(chances.shape[:2])
        least = np.full(len(which), np.inf)
        for _ in range(self._draws.rounds):
            plans = self._random.random(shape) < np.clip(chances, _DOUBT, 1.0 - _DOUBT)[:, None]
            parts = np.ones(shape[:3])
            if len(self._parts) > 1:
                parts = self._random.choice(self._parts, shape[:3])
            plans[:, 0] = best > 0.5  # in the first round: to coast
            parts[:, 0] = part
            costs = self._costs(state, goal, plans, parts)
            lowest = costs.argmin(axis=1)
            episodes = np.arange(len(which))
            better = costs[episodes, lowest] < least
            best = np.where(better[:, None, None], plans[episodes, lowest], best)
            part = np.where(better[:, None], parts[episodes, lowest], part)
            least = np.minimum(least, costs[episodes, lowest])
            weights = np.exp((least[:, None] - costs) / self._draws.temperature)
            chances = np.einsum("nk,nkst->nst", weights / weights.sum(axis=1, keepdims=True), plans)
        self._chances[which] = np.concatenate(
            [chances[:, 1:], np.full_like(chances[:, :1], _FIRST)], axis=1
        )
        return best[:, 0] * part[:, :1]

    def _costs(self, state: Any, goal: Any, plans: np.ndarray, parts: np.ndarray) -> np.ndarray:
        """(M, samples) s, of plans (M, samples, periods, thrusters) of bits and the parts of their pulses given.

        The parts are (M, samples, periods).
        """
        samples = plans.shape[1]
        drift = self._task.drift
        left, spent = np.zeros((2, len(plans) * samples))
        state, goal = (map_leaves(lambda x: np.repeat(x, samples), s) for s in (state, goal))
        periods = plans.shape[2]
        bits = plans.reshape(-1, *plans.shape[2:])
        sizes = parts.reshape(-1, periods)
        for k in range(1, periods + 1):
            pattern, size = bits[:, k - 1], sizes[:, k - 1]
            applied = wrench(self._craft, tuple((pattern * size[:, None]).T))
            state = advance(state, applied, self._body, self._period, drift=drift)
            goal_then = self._task.later(goal, k * self._period)
            left = left + self._value.time_left(state, goal_then) / PERIODS
            for margin in self._task.constraints(state, goal_then).values():
                left = left + np.where(margin < 0.0, _VIOLATED - _VIOLATION * margin, 0.0)
            spent = spent + self._period * size * (self._patterns.shares(pattern) @ self._forces)
        return (left + self._price * spent).reshape(plans.shape[:2])
