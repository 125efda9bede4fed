"""Guidance of inspections: go round a target to where most of what has not been seen is in light."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rans.extend import Spacecraft, Task, Timing, Vec3, leaves, map_leaves
from rans_missions.control.afterwards import Afterwards
from rans_missions.control.velocity_guidance import VelocityGuidance
from rans_missions.orbits.reach import velocity_to_reach
from rans_missions.tasks.hold import Hold, HoldPlan
from rans_missions.tasks.inspect import Inspect

_LEAST = 1e-3
"""Length of a sum of directions, over the number of points, below which it has no direction."""

_AWAY = 1500.0
"""Time in which a craft that has seen enough goes behind the target, s: a quarter of the orbit at 500 km."""


class Visiting(VelocityGuidance[Inspect]):
    """Flies from view to view of an inspected target, greedily, without learning.

    >>> rans.Visiting("afrl-deputy", "inspect")
    <visiting: Inspect for afrl-deputy>

    The next view is at ``distance`` from the target, in the direction of the sum of the normals of all points
    that are in light and have not been seen; where none are in light, of all that have not been seen. It is
    approached round the target, by at most ``turn`` at a time. In every control period the velocity to gain is
    that with which the craft coasts to the view in the time that the straight line there takes at ``speed``; it is
    burnt where it exceeds ``least``, and the craft coasts otherwise. Once enough has been seen, it goes to a point
    behind the target on its orbit, at ``distance``, and stays there (`rans_missions.tasks.hold.Hold`).

    Args:
        craft: by name, TOML file or as such.
        task: an `rans_missions.tasks.inspect.Inspect`, or its name.
        timing: control period, and length of the episode; None: the task's.
        distance: of views from the target's centre, m.
        speed: along the straight line to a view, m/s; a coast takes two control periods or more.
        turn: largest angle to a view, rad.
        least: smallest velocity to gain that is burnt, m/s.

    Raises:
        ConfigError: the task is no inspection.
    """

    name = "visiting"
    mission = Inspect
    purpose = "visiting flies inspections"

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
        super().__init__(craft, task, timing)
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

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        super().reset(count)
        self._afterwards.reset(count)

    def velocity_change(self, state: Any, goal: Any, now: float) -> tuple[np.ndarray, np.ndarray]:
        """Changes of velocity in W, m/s, (N, 3), and which craft burn now, (N,).

        Small changes wait; craft that have seen enough go behind the target, whatever the size of the change. The
        state decides, and not the time.
        """
        change = self._change_to_next_view(state, goal)
        over = np.asarray(self.task.reached(state, goal))
        burns = (np.linalg.norm(change, axis=0) > self._least) | over
        if over.any():
            change = np.where(over, self._change_to_leave(state), change)
        return np.where(burns, change, 0.0).T, burns

    def _change_to_leave(self, state: Any) -> np.ndarray:
        """(3, N) change of velocity in W, m/s, of craft that have seen enough.

        The law of `hold` is flown with a goal behind the target, whose deadline has passed.
        """
        zero = np.zeros(np.shape(state.p.x))
        still = Vec3(zero, zero, zero)
        behind = replace(still, y=zero - self._distance)
        # A deadline that has passed, and no arrival: a new plan is made.
        goal = replace(state, p=behind, v=still, notes=HoldPlan(zero, zero, zero, held=zero - 1.0))
        goal = self._afterwards.goal(state, goal)
        velocity = self._hold.recommended(state, goal, self._hold.arrival(goal))
        stays = self._hold.staying(state, goal)
        velocity = map_leaves(partial(np.where, self._afterwards.stays), stays, velocity)
        return np.array(leaves(velocity - state.v))

    def _change_to_next_view(self, state: Any, goal: Any) -> np.ndarray:
        """(3, N) change of velocity in W, m/s, with which the craft coasts to the next view."""
        position = np.array(leaves(state.p))
        # Where most of what has not been seen is in light; without light, where most has not been seen.
        unseen, lit = (np.array(leaves(v)) for v in self.task.directions(goal))
        outward = np.where(np.linalg.norm(lit, axis=0) > _LEAST, lit, unseen)
        # The view is on the great circle from here towards that direction, at most a turn away.
        from_target = _unit(position)
        across = outward - from_target * (outward * from_target).sum(axis=0)
        angle = np.arctan2(np.linalg.norm(across, axis=0), (outward * from_target).sum(axis=0))
        step = np.minimum(angle, self._turn)
        view = self._distance * (from_target * np.cos(step) + _unit(across) * np.sin(step))
        # The coast there takes as long as the chord at the speed.
        chord = np.linalg.norm(view - position, axis=0)
        time = np.maximum(chord / self._speed, 2.0 * self._period)
        to_view = velocity_to_reach(self.task.drift, state.p, Vec3(*view), time)
        return np.array(leaves(to_view - state.v))


def _unit(v: np.ndarray) -> np.ndarray:
    """Unit vectors (3, N) of vectors (3, N); zero where a vector is zero."""
    return v / np.maximum(np.linalg.norm(v, axis=0), 1e-12)
