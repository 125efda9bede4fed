"""One episode of a flight as something to look at: poses, arrows and flames, instant by instant."""

# Drake's stubs write NumPy's array types with their two parameters exchanged.
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from rans.drawing import columns, rotations
from rans.flight import Flight
from rans.model.fields import map_leaves
from rans.model.spacecraft import Spacecraft


@dataclass(frozen=True)
class Motion:
    """K instants of one spacecraft, up to the end of its episode or its failure."""

    craft: Spacecraft
    controller: str
    wanted: frozenset[str]
    """Errors that the task bounds: "position", "attitude", "velocity", "spin"."""
    times: np.ndarray
    """(K,) s."""
    poses: list[RigidTransform]
    """X_WB at every instant."""
    velocities: np.ndarray
    """(K, 3) m/s in W."""
    firing: np.ndarray
    """(K, thrusters) bool: open from this instant on; at the last none is."""
    goals: list[RigidTransform]
    """The goal's pose in W at every instant; where the task bounds no position, only its rotation counts."""
    goal_velocities: np.ndarray
    """(K, 3) m/s in W."""

    @classmethod
    def of(cls, flight: Flight, episode: int) -> Motion:
        """Of one episode of a flight, by its index in the batch."""
        states = map_leaves(lambda x: x[:, episode], flight.states)
        instants = np.zeros(len(flight.times))
        goal = map_leaves(lambda x: x[..., episode] + instants, flight.goals)
        failed = np.asarray(flight.task.failed(states, goal))
        end = int(failed.argmax()) + 1 if failed.any() else len(failed)
        firing = np.zeros((end, len(flight.craft.thrusters)), dtype=bool)
        firing[:-1] = flight.commands[:end - 1, episode] > 0.0
        return cls(flight.craft, flight.controller, frozenset(flight.task.tolerances()), flight.times[:end],
                   _poses(states)[:end], columns(states.v)[:end], firing, _poses(goal)[:end],
                   columns(goal.v)[:end])

    @property
    def way(self) -> np.ndarray:
        """Positions in W, (K, 3) m."""
        return np.array([pose.translation() for pose in self.poses])

    def goal_at(self, instant: int) -> RigidTransform:
        """Where to draw the goal: at its place, or else where the spacecraft is."""
        if "position" in self.wanted:
            return self.goals[instant]
        return RigidTransform(self.goals[instant].rotation(), self.poses[instant].translation())

    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner in W, (3,) m, of all that is drawn."""
        goals = [goal.translation() for goal in self.goals] if "position" in self.wanted else []
        points = np.array([*self.way, *goals])
        margin = 2.0 * self.craft.radius
        return points.min(axis=0) - margin, points.max(axis=0) + margin


def _poses(states: Any) -> list[RigidTransform]:
    """Poses in W of planar or spatial states whose fields are arrays (K,)."""
    return [RigidTransform(RotationMatrix.ProjectToRotationMatrix(R), p)
            for R, p in zip(rotations(states), columns(states.p), strict=True)]
