"""Guidance of inspections: go round a target to where most of what has not been seen is in light."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rans.model.drift import velocity_to_reach
from rans.model.fields import Quat, Vec3, leaves, map_leaves
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.optimal.control.afterwards import Afterwards
from rans.optimal.control.arguments import craft_and_task
from rans.optimal.trajectory.allocation import rounding
from rans.tasks.base import Task
from rans.tasks.hold import Hold
from rans.tasks.inspect import Inspect

_LEAST = 1e-3
"""Length of a sum of directions, over the number of points, below which it has no direction."""

_AWAY = 1500.0
"""Time in which a craft that has seen enough goes behind the target, s: a quarter of the orbit at 500 km."""


class Visiting:
    """Flies from view to view of an inspected target, greedily, without learning.

    >>> rans.Visiting("afrl-deputy", "inspect")
    <visiting: Inspect for afrl-deputy>

    The next view is at ``distance`` from the target, in the direction of the sum of the normals of all points
    that are in light and have not been seen; where none are in light, of all that have not been seen. It is
    approached round the target, by at most ``turn`` at a time. In every control period the velocity to gain is
    that with which the craft coasts to the view in the time that the arc takes at ``speed``; it is burnt where
    it exceeds ``least``, and the craft coasts otherwise. Once enough has been seen, it goes to a point behind the
    target on its orbit, at ``distance``, and stays there (`rans.tasks.hold.Hold`).

    Args:
        craft: by name, TOML file or as such.
        task: an `rans.tasks.inspect.Inspect`, or its name.
        timing: control period, and length of the episode; None: the task's.
        distance: of views from the target's centre, m.
        speed: along the arc, m/s.
        turn: largest angle to a view, rad.
        least: smallest velocity to gain that is burnt, m/s.

    Raises:
        ConfigError: the task is no inspection.
    """

    name = "visiting"

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None = None,
        distance: float = 40.0,
        speed: float = 0.06,
        turn: float = 0.9,
        least: float = 0.05,
    ) -> None:
        self.craft, task_value = craft_and_task(craft, task)
        self.task = Inspect.expected(task_value, "visiting flies inspections")
        self._timing = self.task.timing if timing is None else timing
        self._distance = distance
        self._speed = speed
        self._turn = turn
        self._least = least
        self._hold = Hold(
            mean_motion=self.task.mean_motion,
            hold_distance=distance,
            keep_out=self.task.keep_out,
            deadline=(_AWAY, _AWAY),
        )
        self._afterwards = Afterwards(self.craft, self._hold, self._timing)
        self._rounding = rounding(
            self.craft, self._timing.control_period, np.zeros(self.craft.degrees_of_freedom, bool)
        )

    def __repr__(self) -> str:
        return f"<{self.name}: {type(self.task).__name__} for {self.craft.name}>"

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._rounding.reset(count)
        self._afterwards.reset(count)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; looks at the state and the goal's notes, not at the observation."""
        gain = self._velocity_to_gain(state, goal)
        over = np.broadcast_to(self.task.reached(state, goal), gain.shape[1])
        burns = (np.linalg.norm(gain, axis=0) > self._least) | over
        if over.any():
            gain = np.where(over, self._velocity_to_leave(state), gain)
        push = np.where(burns, gain, 0.0) * (self.craft.mass / self._timing.control_period)
        level = Quat(1.0, 0.0, 0.0, 0.0)
        force = np.array(leaves(state.attitude.to(level).rotate(Vec3(*push))))
        wrench = np.pad(force.T, ((0, 0), (0, self.craft.degrees_of_freedom - 3)))
        return self._rounding.round(wrench, ~burns, state.stores)

    def _velocity_to_leave(self, state: Any) -> np.ndarray:
        """(3, N) change of velocity in W, m/s, of craft that have seen enough."""
        zero = np.zeros(np.shape(state.p.x))
        still = Vec3(zero, zero, zero)
        behind = replace(still, y=zero - self._distance)
        # A deadline that has passed, and no arrival: a new plan is made.
        goal = replace(state, p=behind, v=still, notes=(zero, zero, zero, zero - 1.0))
        goal = self._afterwards.goal(state, goal)
        velocity = self._hold.recommended(state, goal, self._hold.arrival(goal))
        stays = self._hold.staying(state, goal)
        velocity = map_leaves(partial(np.where, self._afterwards.stays), stays, velocity)
        return np.array(leaves(velocity - state.v))

    def _velocity_to_gain(self, state: Any, goal: Any) -> np.ndarray:
        """(3, N) change of velocity in W, m/s, with which the craft coasts to the next view."""
        state_now = np.array(leaves(state.p))
        size = state_now.shape[1]
        unseen, lit = (
            np.array([np.broadcast_to(x, size) for x in leaves(v)])
            for v in self.task.directions(goal)
        )
        outward = np.where(np.linalg.norm(lit, axis=0) > _LEAST, lit, unseen)
        from_target = _unit(state_now)
        axis = outward - from_target * (outward * from_target).sum(axis=0)
        aside = _unit(axis)
        angle = np.arctan2(np.linalg.norm(axis, axis=0), (outward * from_target).sum(axis=0))
        step = np.minimum(angle, self._turn)
        view = self._distance * (from_target * np.cos(step) + aside * np.sin(step))
        arc = np.linalg.norm(view - state_now, axis=0)
        time = np.maximum(arc / self._speed, 2.0 * self._timing.control_period)
        wanted_v = velocity_to_reach(self.task.drift, state.p, Vec3(*view), time)
        return np.array([np.broadcast_to(x, size) for x in leaves(wanted_v)]) - np.array(
            [np.broadcast_to(x, size) for x in leaves(state.v)]
        )


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.maximum(np.linalg.norm(v, axis=0), 1e-12)
