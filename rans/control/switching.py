"""Phase-plane switching: the fastest of the simple controllers, and it never throttles.

Ties between patterns decide recorded flights: the order of candidates is not free.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rans.base.errors import ConfigError, checked
from rans.control.allocation import Allocation, ThrusterPatterns, inertia
from rans.control.dead_thrusters import ExpectsDead
from rans.control.linear_motion import LinearMotion
from rans.control.regulator import (
    Deadband,
    ModelBased,
    holding,
    mass_share,
)
from rans.control.wheel_torques import WheelTorques
from rans.episode.scenario import scenarios
from rans.model.body import Body
from rans.model.coordinates import rotation_vector
from rans.model.dynamics import advance, wrench
from rans.model.fields import Vec2, Vec3, leaves
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.tasks.base import Task
from rans.tasks.settings import check_settings


@dataclass(frozen=True)
class Curve:
    """How late to brake, and what thrust is worth.

    Raises:
        ConfigError: a value is not a finite number > 0, or the weight of thrust is negative.
    """

    push_scale: float = 0.75
    """Acceleration to brake with, as a share of that along every axis at full thrust: large ones brake late,
    and leave nothing for what thrusters must do besides."""
    turn_scale: float = 0.35
    """Angular acceleration to brake with, as a share of that about every axis at full thrust."""
    norm_scale: float = 4.0
    """Power of the mean of the times that the way and the turn take: 1 hurries both, large ones only the
    slower."""
    thrust_time_weight: float = 0.1
    """Price of thrust, s per s of full thrust along an axis of B: larger values coast more. Full thrust is the
    force that is possible along every axis (`rans.control.allocation.Allocation.accelerations`), so
    that the price suits craft of any mass and force."""

    def __post_init__(self) -> None:
        check_settings(self)

    def price(self, force: float) -> float:
        """Price of impulse, s per N s, of a craft whose full thrust along every axis is a force, N."""
        return self.thrust_time_weight / force


_CURVE = Curve()
_DEADBAND = Deadband()
_LEAST_PUSH = 0.05
"""Share of the thrusters' acceleration to brake with where the drift leaves less."""
_SLOW = 0.1
"""Counts as at rest: what full thrust stops in this share of a control period."""

_SLACK = 1.5
"""Time in which wheels bring small deviations to the goal, control periods: a third is left after each."""

_PARTS = 0.5 ** np.arange(8.0)
"""Parts of a pulse that throttled and pulsed thrusters give."""


class Switching(ExpectsDead, ModelBased):
    """Opens the thrusters after whose pulse the goal is nearest in time, and none within a dead band.

    >>> from rans.control.switching import Curve
    >>> rans.Switching("floating-platform", "go-to-pose", curve=Curve(thrust_time_weight=0.4))
    <switching: GoToPose for floating-platform>

    Position and attitude are double integrators whose least time to rest is known in closed form, and with it
    the curve of the phase plane on which thrust changes sign (Bryson and Ho, "Applied Optimal Control", 1975,
    section 3.9). Full thrust is given by few thrusters in few directions, so it is not chosen per axis: of
    patterns of open thrusters the one is taken after which both times, and the thrust at its price, are
    least. The search goes on from the pattern before, see `ThrusterPatterns.best`. Where the task has no tolerance
    for the position or the attitude, only the velocity or the spin is brought to the goal's.

    Reaction wheels give the torque that takes the craft to that curve, less what the pattern gives, as far as
    they can (`rans.control.wheel_torques`), also within the dead band.

    Throttled and pulsed thrusters give the part of a pulse after which it is nearest. In a mission on an orbit it
    stays at the goal from the arrival on (`rans.tasks.afterwards`).

    What a pulse leads to is computed with the task's drift and from where the goal will be. Thereafter the
    drift counts only as thrust that is not there for braking, so it must be weaker than the thrusters.

    Raises:
        ConfigError: the thrusters cannot push the spacecraft in every direction, cannot turn it as the task
            asks, or are no stronger than the drift where the goal is.
    """

    name = "switching"
    needs_thrusters: ClassVar[bool] = True
    tunable: ClassVar = {
        "curve.push_scale": (0.3, 1.5),
        "curve.turn_scale": (0.1, 1.5),
        "curve.norm_scale": (1.0, 10.0),
        "curve.thrust_time_weight": (0.008, 0.8),
        **Deadband.tunable,
    }
    """Bounds for `rans tune`."""

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None = None,
        curve: Curve = _CURVE,
        deadband: Deadband = _DEADBAND,
    ) -> None:
        super().__init__(craft, task, timing)
        self._deadband = checked("deadband", deadband, Deadband)
        self._curve = checked("curve", curve, Curve)
        self._settings = (curve, deadband)
        craft = self._craft
        self._period = self._timing.control_period
        self._patterns = ThrusterPatterns(craft)
        matrix = inertia(craft)
        self._push, self._turn = Allocation(craft).accelerations()
        self.price = self._curve.price(self._push * craft.mass)
        """Price of impulse, s per N s."""
        self._can_turn = craft.can_turn
        self._motion = LinearMotion.of(self._task.drift, craft.dimension, self._period)
        self._check_drift()
        wrenches = self._patterns.wrenches
        axes = craft.dimension
        self._pushes = wrenches[:, :axes] / craft.mass
        self._turns = wrenches[:, axes:]
        self._inertia = matrix
        self._inverse_inertia = np.linalg.inv(matrix)
        self._turns = self._turns @ self._inverse_inertia
        self._wheels = WheelTorques(craft, self._period) if craft.wheels else None
        self._forces = np.array([thruster.force for thruster in craft.thrusters])
        self._last = np.zeros((0, len(wrenches)), bool)
        self._parts = _PARTS if craft.actuators.is_continuous else _PARTS[:1]
        self._afterwards = self._task.afterwards(craft, self._timing)

    def _check_drift(self) -> None:
        """Refuse a drift that the thrusters cannot hold the craft against where its goal is."""
        starts = scenarios(self._task, self._craft, 0, 1)
        pull = float(_pull(self._motion, self._task, self._period, starts.start, starts.goal)[0])
        if pull >= self._curve.push_scale * self._push:
            raise ConfigError(
                f"switching control cannot fly {type(self._task).__name__}: its "
                f"{self._task.drift.name} takes {pull:.3g} m/s^2 to stay at the goal, and the control brakes "
                f"{self._craft.name} with {self._curve.push_scale * self._push:.3g} m/s^2. Fly LQR, MPC or "
                "guidance, or stronger thrusters."
            )

    def reset(self, count: int) -> None:
        """See `rans.episode.flight.Controller`."""
        self._last = np.zeros((count, self._last.shape[1]), bool)
        if self._afterwards is not None:
            self._afterwards.reset(count)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands (N, n) from the state, not the observation; remembers the last patterns."""
        rest = self._deadband.holds(self._craft, self._task, state, goal, period=self._period)
        if self._afterwards is not None:
            goal = self._afterwards.goal(state, goal)
            rest = rest | self._afterwards.stays
        # Gaps to the goal now and after a coast of the period, and what wheels would give then.
        now, coast = (self._gap(h, state, goal) for h in (0.0, self._period))
        scales = self._scales_to_move(now, coast)
        everyone = np.arange(len(rest))
        help_of = self._wheel_help(coast, scales, state, rest)

        def costs_of_parts(episodes: np.ndarray, patterns: np.ndarray) -> np.ndarray:
            """Costs (M, C, parts) of parts of the pulses of C patterns for each of M episodes."""
            gap, scale = coast.of_episodes(episodes), scales[:, episodes]

            def wheels(turn: np.ndarray) -> np.ndarray:
                return help_of(turn, episodes)[1]

            return np.stack(
                [self._cost(gap, patterns, scale, part, wheels) for part in self._parts], axis=-1
            )

        def cost(episodes: np.ndarray, patterns: np.ndarray) -> np.ndarray:
            return costs_of_parts(episodes, patterns).min(axis=-1)

        # The best pattern, from the last one on, and the best part of its pulse.
        self._last = self._patterns.best(self._last & ~rest[:, None], cost, ~rest)
        best_part = costs_of_parts(everyone, self._last[:, None])[:, 0].argmin(axis=-1)
        part = self._parts[best_part, None]
        # Wheels give the remaining angular acceleration.
        turn = (self._patterns.shares(self._last) * part) @ self._turns * coast.lighter[:, None]
        commands = np.hstack([self._last * part, help_of(turn[:, None], everyone)[0][:, 0]])
        if self._afterwards is not None:
            commands = self._afterwards.commands(state, goal, commands)
        return commands

    def _gap(self, time: float, state: Any, goal: Any) -> _Gap:
        """From where the goal will be, of a state that coasts for a time, s; fields (N,).

        Without thrust; `_cost` adds what patterns do, in the axes of the middle of the period.
        """
        shut = wrench(self._craft, (0.0,) * len(self._forces))
        body = Body.of(self._craft)
        drift = self._task.drift
        end = advance(state, shut, body, time, drift=drift)
        middle = advance(state, shut, body, 0.5 * time, drift=drift).attitude
        pull = _pull(self._motion, self._task, self._period, state, goal)
        lighter = 1.0 / mass_share(self._craft, state)
        return _Gap.between(end, self._task.later(goal, time), middle, pull, lighter)

    def _wheel_help(
        self, coast: _Gap, scales: np.ndarray, state: Any, rest: np.ndarray
    ) -> Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """Commands (M, C, wheels) and angular accelerations (M, C, 1 or 3) of the wheels.

        The result is a function of those accelerations, like them, that thrusters give, and of the numbers (M,) of
        the episodes.

        Args:
            coast: error at the end of the period without any effector.
            scales: factors of the largest accelerations along braking curves, of translation and rotation.
            state: with the stores of the wheels.
            rest: which craft leave their thrusters shut, (N,).
        """
        wheels = self._wheels
        if wheels is None:
            return lambda turn, _: (turn[..., :0], 0.0 * turn)
        low, high = wheels.bounds(state.stores, rest)
        held = "attitude" in self._task.tolerances()
        # The angular acceleration that all effectors together should give, in B.
        spin_up = _to_curve(
            coast.turn if held else None,
            coast.spin,
            self._turn * coast.lighter[:, None] * scales[1],
            self._period,
        )

        def given(turn: np.ndarray, episodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            lighter = coast.lighter[episodes, None, None]
            torque = ((spin_up[episodes, None] - turn) @ self._inertia) / lighter
            commands = wheels.commands(torque, low[episodes, None], high[episodes, None])
            return commands, commands @ wheels.map @ self._inverse_inertia * lighter

        return given

    def _scales(self, count: int) -> np.ndarray:
        """(2, N, 1) the curve's shares of what there is to push and turn with."""
        return np.tile([[[self._curve.push_scale]], [[self._curve.turn_scale]]], (1, count, 1))

    def _scales_to_move(self, now: _Gap, coast: _Gap) -> np.ndarray:
        """Scales of push and turn, (2, N, 1): the curve's, or all there is where it would wait for ever.

        A pulse may be too long to be braked by a share of the thrusters; then waiting looks better than any,
        also a period later.
        """
        held = self._task.tolerances()
        scales = self._scales(len(now.p))
        shut = np.zeros((len(now.p), 1, len(self._forces)), bool)
        waits = (self._cost(coast, shut, scales) >= self._cost(now, shut, scales))[:, 0]
        for rate, full, lowest in (
            (now.v, self._push, "position"),
            (now.spin, self._turn, "attitude"),
        ):
            if lowest == "attitude" and not self._can_turn:
                continue
            waits &= (lowest not in held) | (time_to_rest(None, rate, full) < _SLOW * self._period)
        scales[:, waits] = 1.0
        return scales

    def _cost(
        self,
        gap: _Gap,
        patterns: np.ndarray,
        scales: np.ndarray,
        part: float = 1.0,
        wheels: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> np.ndarray:
        """Time to the goal after a pulse, and the price of its thrust, (M, C) s, for C patterns and M episodes.

        Args:
            gap: of M episodes after a coast of the period.
            patterns: open thrusters, (M, C, thrusters).
            scales: scales of push and turn, (2, M, 1).
            part: part of the pulse that is given.
            wheels: angular accelerations by wheels beside those by thrusters; None: they are left out.
        """
        loads = self._patterns.shares(patterns) * part
        held = self._task.tolerances()
        h = self._period
        lighter = gap.lighter[:, None]
        # A pulse over the period moves by half of what it moves by at its end speed: h^2 a / 2 and h a. Braking
        # has what the drift leaves of the thrusters' acceleration.
        push = ((loads @ self._pushes) @ gap.to_world) * lighter[..., None]
        full = self._push * lighter
        acceleration = np.maximum(full * scales[0] - gap.pull[:, None], _LEAST_PUSH * full)
        duration = time_to_rest(
            gap.p[:, None] + 0.5 * h * h * push if "position" in held else None,
            gap.v[:, None] + h * push,
            acceleration,
        )
        turning = np.zeros_like(duration)
        if self._can_turn:
            turn = (loads @ self._turns) * lighter[..., None]
            if wheels is not None:
                turn = turn + wheels(turn)
            turning = time_to_rest(
                gap.turn[:, None] + 0.5 * h * h * turn if "attitude" in held else None,
                gap.spin[:, None] + h * turn,
                self._turn * lighter * scales[1],
            )
        # Power mean of both times, without its divisor.
        power = self._curve.norm_scale
        both = (duration**power + turning**power) ** (1.0 / power)
        return both + self.price * h * (loads @ self._forces)


@dataclass(frozen=True)
class _Gap:
    """A state relative to its goal: arrays (N, 2 or 3; a turn in the plane: 1), lengths in W, turns in B."""

    p: np.ndarray
    v: np.ndarray
    turn: np.ndarray
    spin: np.ndarray
    to_world: np.ndarray
    """(N, axis of B, axis of W) in the middle of the period."""

    pull: np.ndarray
    """(N,) m/s^2, what it takes to stay at the goal in the drift."""

    lighter: np.ndarray
    """(N,) mass with a full tank over mass."""

    @classmethod
    def between(
        cls, state: Any, goal: Any, middle: Any, pull: np.ndarray, lighter: Any = 1.0
    ) -> _Gap:
        """Gap between a state and a goal, of arrays (N,), with the attitude in the middle of the period."""
        units = (
            (Vec2(1.0, 0.0), Vec2(0.0, 1.0))
            if isinstance(state.p, Vec2)
            else (Vec3(1.0, 0.0, 0.0), Vec3(0.0, 1.0, 0.0), Vec3(0.0, 0.0, 1.0))
        )
        axes = np.array([leaves(middle.rotate(unit)) for unit in units])
        p, v = (np.array(leaves(gap)).T for gap in (state.p - goal.p, state.v - goal.v))
        turn = rotation_vector(goal.attitude.to(state.attitude))
        spin = np.array(state.spin()) - goal.spin()
        return cls(
            p,
            v,
            turn.T,
            spin.T,
            np.moveaxis(axes, 2, 0),
            pull,
            np.broadcast_to(lighter, np.shape(pull)),
        )

    def of_episodes(self, which: np.ndarray) -> _Gap:
        """Gaps of some episodes, by number."""
        return _Gap(*(x[which] for x in vars(self).values()))


def _to_curve(
    x: np.ndarray | None, v: np.ndarray, acceleration: np.ndarray, period: float
) -> np.ndarray:
    """Accelerations (N, axes) that take coasting deviations to the curve on which braking ends at rest.

    Args:
        x: deviations (N, axes) after a period without acceleration; None: rest anywhere.
        v: rates (N, axes).
        acceleration: acceleration to brake with, (N, 1).
        period: length of the period, s.
    """
    if x is None:
        return -v / period
    # Midway between now and then, so that x + h^2 a / 2 with h a = u - v is middle + h u / 2.
    middle = x - 0.5 * period * v
    distance = np.linalg.norm(middle, axis=-1, keepdims=True)
    # Far away sqrt(2 a s), near the goal s / slack: it must be above half a period, or craft would oscillate.
    slack = _SLACK * period
    speed = (
        np.sqrt(2.0 * acceleration * distance + (acceleration * slack) ** 2) - acceleration * slack
    )
    return (-middle / np.maximum(distance, 1e-12) * speed - v) / period


def _pull(motion: LinearMotion, task: Task, period: float, state: Any, goal: Any) -> np.ndarray:
    """Accelerations, (N,) m/s^2, that it takes to stay at goals in a task's drift for a period, s."""
    later = task.later(goal, period)
    held = "position" in task.tolerances()
    return np.linalg.norm(holding(motion, held, state, goal, later), axis=0)


def time_to_rest(x: np.ndarray | None, v: np.ndarray, acceleration: Any) -> np.ndarray:
    """Time to rest at the origin, or where there is no place x to go to, to rest anywhere, s.

    Along the way and across it, each as if alone, then their root of squares: exact on a line, nearly so
    elsewhere. x and v are (..., axes), the acceleration is at most ``acceleration``; returns (...).
    """
    if x is None:
        return np.linalg.norm(v, axis=-1) / acceleration
    distance = np.linalg.norm(x, axis=-1)
    direction = x / np.maximum(distance, 1e-12)[..., None]  # at the goal all is across
    along = (v * direction).sum(axis=-1)
    across = np.linalg.norm(v - along[..., None] * direction, axis=-1)
    return np.hypot(
        _on_a_line(distance, along, acceleration), _on_a_line(0.0, across, acceleration)
    )


def _on_a_line(x: Any, v: np.ndarray, acceleration: Any) -> np.ndarray:
    """Minimum time of the double integrator: thrust changes sign on x = -v |v| / 2 a (Bryson and Ho)."""
    beyond = np.where(x + v * np.abs(v) / (2.0 * acceleration) >= 0.0, 1.0, -1.0)
    root = 0.5 * (v / acceleration) ** 2 + beyond * x / acceleration
    return beyond * v / acceleration + 2.0 * np.sqrt(np.maximum(root, 0.0))
