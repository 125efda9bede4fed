"""Phase-plane switching: the fastest of the simple controllers, and it never throttles."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rans.errors import checked
from rans.model.body import Body
from rans.model.dynamics import advance, wrench
from rans.model.fields import Vec2, Vec3, leaves
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.optimal.control.regulator import Deadband, ModelBased
from rans.optimal.trajectory.allocation import Allocation, Patterns, inertia
from rans.optimal.trajectory.guess import rotation_vector
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
    """The same of turning."""
    norm_scale: float = 4.0
    """Power of the mean of the times that the way and the turn take: 1 hurries both, large ones only the
    slower."""
    thrust_weight: float = 0.01
    """What thrust costs, s per N s: larger values coast more."""

    def __post_init__(self) -> None:
        check_settings(self)


_CURVE = Curve()
_DEADBAND = Deadband()
_SLOW = 0.1
"""Counts as at rest: what full thrust stops in this share of a control period."""


class Switching(ModelBased):
    """Opens the thrusters after whose pulse the goal is nearest in time, and none within a dead band.

    >>> from rans.optimal.control.switching import Curve
    >>> rans.Switching("floating-platform", "go-to-pose", curve=Curve(thrust_weight=0.1))
    <switching: GoToPose for floating-platform>

    Position and attitude are double integrators whose least time to rest is known in closed form, and with it
    the curve of the phase plane on which thrust changes sign (Bryson and Ho, "Applied Optimal Control", 1975,
    section 3.9). Full thrust is given by few thrusters in few directions, so it is not chosen per axis: of
    patterns of open thrusters the one is taken after which both times, and the thrust at its price, are
    least. The search goes on from the pattern before, see `Patterns.best`. Where the task has no tolerance
    for the position or the attitude, only the velocity or the spin is brought to the goal's.

    Raises:
        ConfigError: the thrusters cannot push and turn the spacecraft in every direction.
    """

    name = "switching"
    tunable: ClassVar = {
        "curve.push_scale": (0.3, 1.5),
        "curve.turn_scale": (0.1, 1.5),
        "curve.norm_scale": (1.0, 10.0),
        "curve.thrust_weight": (0.003, 0.3),
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
        craft = self._craft
        self._period = self._timing.control_period
        self._patterns = Patterns(craft)
        matrix = inertia(craft)
        force, torque = Allocation(craft).authority()
        self._push = force / craft.mass
        self._turn = torque / float(np.linalg.eigvalsh(matrix)[-1])
        wrenches = self._patterns.wrenches
        straight = craft.dimension
        self._pushes = wrenches[:, :straight] / craft.mass
        self._turns = wrenches[:, straight:]
        self._turns = self._turns @ np.linalg.inv(matrix)
        self._forces = np.array([thruster.force for thruster in craft.thrusters])
        self._last = np.zeros((0, len(wrenches)), bool)

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._last = np.zeros((count, self._last.shape[1]), bool)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; looks at the state, not at the observation."""
        rest = self._deadband.holds(self._craft, self._task, state, goal)
        now, coast = (_Gap.after(h, self._craft, state, goal) for h in (0.0, self._period))
        scales = self._bold(now, coast)

        def cost(which: np.ndarray, patterns: np.ndarray) -> np.ndarray:
            return self._cost(coast.of_episodes(which), patterns, scales[:, which])

        self._last = self._patterns.best(self._last & ~rest[:, None], cost, ~rest)
        return self._last.astype(float)

    def time_left(self, state: Any, goal: Any) -> np.ndarray:
        """The least time to the goal, (N,) s, as the curve has it, of a state and a goal of arrays (N,)."""
        gap = _Gap.after(0.0, self._craft, state, goal)
        shut = np.zeros((len(gap.p), 1, len(self._forces)), bool)
        return self._cost(gap, shut, self._scales(len(gap.p)))[:, 0]

    def _scales(self, count: int) -> np.ndarray:
        """(2, N, 1) the curve's shares of what there is to push and turn with."""
        return np.tile([[[self._curve.push_scale]], [[self._curve.turn_scale]]], (1, count, 1))

    def _bold(self, now: _Gap, coast: _Gap) -> np.ndarray:
        """Scales of push and turn, (2, N, 1): the curve's, or all there is where it would wait for ever.

        A pulse may be too long to be braked by a share of the thrusters; then waiting looks better than any,
        also a period later.
        """
        held = self._task.tolerances()
        scales = self._scales(len(now.p))
        shut = np.zeros((len(now.p), 1, len(self._forces)), bool)
        waits = (self._cost(coast, shut, scales) >= self._cost(now, shut, scales))[:, 0]
        for rate, full, kept in (
            (now.v, self._push, "position"),
            (now.spin, self._turn, "attitude"),
        ):
            waits &= (kept not in held) | (least_time(None, rate, full) < _SLOW * self._period)
        scales[:, waits] = 1.0
        return scales

    def _cost(self, gap: _Gap, patterns: np.ndarray, scales: np.ndarray) -> np.ndarray:
        """(M, C) s, of patterns (M, C, thrusters) and scales of push and turn (2, M, 1)."""
        shares = self._patterns.shares(patterns)
        held = self._task.tolerances()
        h = self._period
        push = (shares @ self._pushes) @ gap.to_world
        turn = shares @ self._turns
        way, turning = (
            least_time(
                x[:, None] + 0.5 * h * h * more if kept in held else None,
                v[:, None] + h * more,
                most,
            )
            for x, v, more, most, kept in (
                (gap.p, gap.v, push, self._push * scales[0], "position"),
                (gap.turn, gap.spin, turn, self._turn * scales[1], "attitude"),
            )
        )
        power = self._curve.norm_scale
        both = (way**power + turning**power) ** (1.0 / power)
        return both + self._curve.thrust_weight * h * (shares @ self._forces)


@dataclass(frozen=True)
class _Gap:
    """A state seen from the goal: arrays (N, 2 or 3; a turn in the plane: 1), lengths in W, turns in B."""

    p: np.ndarray
    v: np.ndarray
    turn: np.ndarray
    spin: np.ndarray
    to_world: np.ndarray
    """(N, axis of B, axis of W) in the middle of the period."""

    @classmethod
    def after(cls, period: float, craft: Spacecraft, state: Any, goal: Any) -> _Gap:
        """Of a state and a goal of arrays (N,) that coast for a period, s."""
        shut = wrench(craft, (0.0,) * len(craft.thrusters))
        body = Body.of(craft)
        end, there = (advance(s, shut, body, period) for s in (state, goal))
        middle = advance(state, shut, body, 0.5 * period).attitude
        units = (
            (Vec2(1.0, 0.0), Vec2(0.0, 1.0))
            if craft.dimension == 2
            else (Vec3(1.0, 0.0, 0.0), Vec3(0.0, 1.0, 0.0), Vec3(0.0, 0.0, 1.0))
        )
        axes = np.array([leaves(middle.rotate(unit)) for unit in units])
        p, v = (np.array(leaves(gap)).T for gap in (end.p - there.p, end.v - there.v))
        turn = rotation_vector(there.attitude.to(end.attitude))
        spin = np.array(end.spin()) - there.spin()
        return cls(p, v, turn.T, spin.T, np.moveaxis(axes, 2, 0))

    def of_episodes(self, which: np.ndarray) -> _Gap:
        """Those of some episodes, by number."""
        return _Gap(*(x[which] for x in vars(self).values()))


def least_time(x: np.ndarray | None, v: np.ndarray, most: Any) -> np.ndarray:
    """Time to rest at the origin, or where there is no place x to go to, to rest anywhere, s.

    Along the way and across it, each as if alone, then their root of squares: exact on a line, nearly so
    elsewhere. x and v are (..., axes), the acceleration is at most ``most``; returns (...).
    """
    if x is None:
        return np.linalg.norm(v, axis=-1) / most
    distance = np.linalg.norm(x, axis=-1)
    direction = x / np.maximum(distance, 1e-12)[..., None]  # at the goal all is across
    along = (v * direction).sum(axis=-1)
    across = np.linalg.norm(v - along[..., None] * direction, axis=-1)
    return np.hypot(_on_a_line(distance, along, most), _on_a_line(0.0, across, most))


def _on_a_line(x: Any, v: np.ndarray, most: Any) -> np.ndarray:
    """Minimum time of the double integrator: thrust changes sign on x = -v |v| / 2 a (Bryson and Ho)."""
    beyond = np.where(x + v * np.abs(v) / (2.0 * most) >= 0.0, 1.0, -1.0)
    root = 0.5 * (v / most) ** 2 + beyond * x / most
    return beyond * v / most + 2.0 * np.sqrt(np.maximum(root, 0.0))
