"""Can a CubeSat without a thruster reach its goal in time? ``python -m campaigns dead-cubesats``.

A flight made by hand is timed: the wheels turn the craft to the goal's attitude about one axis, and partly open
thrusters then take it there from rest to rest while the wheels balance their torques within torque and momentum.
The least time of the second part is found by linear programs, without disturbances. The flight is one of many, so
that the craft needs no longer than that.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from rans.evaluation.fly.contestants import contestant
from rans.model.spacecraft import Spacecraft
from rans.scenario import EVALUATION_SEED, Scenario, each, scenarios

_AGENTS = "go-to-pose-3d-cubesat-3u", "go-to-pose-3d-cubesat-6u"
"""Agents whose craft, task and episodes are asked about."""
_STEP = 1.0
"""Time in which a thruster's share of open time is constant, s."""
_LONGEST = 200
"""Steps of the longest flight that is tried."""


class Balanced(NamedTuple):
    """What moves a craft whose attitude wheels keep, in the frame of the body."""

    accelerations: np.ndarray
    """(n, 3) by each open thruster, m/s^2."""
    torques: np.ndarray
    """(n, 3) by each open thruster, N m."""
    torque: np.ndarray
    """(3,) largest of the wheels about each axis, N m."""
    momentum: np.ndarray
    """(3,) the same of their momentum, N m s."""

    def reaches(self, displacement: np.ndarray, steps: int, step: float) -> bool:
        """Whether a flight of so many steps (s) goes from rest to rest over a displacement, m.

        Variables are the shares of every step and thruster, then the wheels' momentum after every step.
        """
        count = len(self.accelerations)
        gain = self.accelerations.T * step
        left = step * (steps - np.arange(steps) - 0.5)
        ends = np.vstack([np.tile(gain, steps), np.hstack([gain * time for time in left])])
        one_step = sparse.eye(steps)
        kept = sparse.hstack(
            [
                sparse.kron(one_step, -step * self.torques.T),
                sparse.kron(one_step - sparse.eye(steps, k=-1), sparse.eye(3)),
            ]
        )
        equal = sparse.vstack([sparse.csr_matrix(np.pad(ends, ((0, 0), (0, 3 * steps)))), kept])
        both = np.vstack([self.torques.T, -self.torques.T])
        below = sparse.hstack(
            [sparse.kron(one_step, both), sparse.csr_matrix((6 * steps, 3 * steps))]
        )
        found = linprog(
            np.zeros(steps * (count + 3)),
            A_ub=below.tocsr(),
            b_ub=np.tile(self.torque, 2 * steps),
            A_eq=equal.tocsr(),
            b_eq=np.concatenate([np.zeros(3), displacement, np.zeros(3 * steps)]),
            bounds=[(0.0, 1.0)] * (steps * count) + [(-x, x) for x in self.momentum] * steps,
            method="highs",
        )
        return found.status == 0

    def time(self, displacement: np.ndarray, step: float = _STEP) -> float:
        """Least time over a displacement in whole steps, s; infinite if even the longest flight does not do."""
        low, high = 0, _LONGEST
        if not self.reaches(displacement, high, step):
            return math.inf
        while high - low > 1:
            middle = (low + high) // 2
            if self.reaches(displacement, middle, step):
                high = middle
            else:
                low = middle
        return high * step


def turn(rotation: np.ndarray, inertia: np.ndarray, wheels: Balanced) -> float:
    """Time of a turn from rest to rest about its own axis by the wheels, s.

    All momentum is the wheels' own, so that a turn about any axis has no gyroscopic torque.

    Args:
        rotation: (3, 3) from the attitude after the turn to that before.
        inertia: (3,) about the axes of B, kg m^2.
        wheels: their torque and momentum.
    """
    vector = Rotation.from_matrix(rotation).as_rotvec()
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return 0.0
    # Momentum and torque about each axis for a rate and a slope of 1.
    load = inertia * np.abs(vector) / angle
    used = load > 0.0
    rate = float((wheels.momentum[used] / load[used]).min())
    slope = float((wheels.torque[used] / load[used]).min())
    if rate * rate / slope >= angle:
        return 2.0 * math.sqrt(angle / slope)
    return angle / rate + rate / slope


def _balanced(craft: Spacecraft) -> Balanced:
    """What moves a craft that has a wheel along each axis of B."""
    forces, torques = np.split(np.array(craft.wrench_map), [3], axis=1)
    # Wheel of every axis.
    wheels = [craft.wheels[int(np.abs(row).argmax())] for row in np.array(craft.wheel_map).T]
    return Balanced(
        forces / craft.mass,
        torques,
        np.array([wheel.max_torque for wheel in wheels]),
        np.array([wheel.max_momentum for wheel in wheels]),
    )


@dataclass(frozen=True)
class DeadCubesats:
    """Time the flight with every thruster dead in turn."""

    episodes: int = 4
    """Held-out starts."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """Times of each craft, s."""
        for name in _AGENTS:
            own = contestant(f"pretrained:{name}")
            craft = own.craft
            inertia = np.diag(np.array(craft.inertia))
            asked = scenarios(own.task.for_evaluation(), craft, EVALUATION_SEED, self.episodes)
            starts = [*each(asked)]
            lacking = [
                replace(craft, thrusters=tuple(x for k, x in enumerate(craft.thrusters) if k != n))
                for n in range(len(craft.thrusters))
            ]
            whole, *dead = (
                [_time(_balanced(one), inertia, start) for start in starts]
                for one in (craft, *lacking)
            )
            # Settled flights are within the tolerances in the last fifth.
            due = 0.8 * own.timing.episode_steps * own.timing.control_period
            times = np.array(dead)
            yield {
                "craft": craft.name,
                "whole": float(np.median(whole)),
                "dead": float(np.median(times)),
                "longest": float(times.max()),
                "in time": f"{(times <= due).sum()} of {times.size} (in {due:.0f} s)",
            }


def _time(wheels: Balanced, inertia: np.ndarray, start: Scenario) -> float:
    """Time of the turn and the translation, s."""
    before, after = (_matrix(state.attitude.columns()) for state in (start.start, start.goal))
    between = np.array(start.goal.p.columns(), float) - np.array(start.start.p.columns(), float)
    return turn(before.T @ after, inertia, wheels) + wheels.time(after.T @ between)


def _matrix(rows: object) -> np.ndarray:
    """Rotation from B to W, of its first two rows."""
    first, second = np.array(rows, float).reshape(2, 3)
    return np.vstack([first, second, np.cross(first, second)])
