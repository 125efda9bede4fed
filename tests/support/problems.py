"""Problems that the optimiser's tests solve, and what Drake makes of their solutions."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

from rans_optimal.objectives import Objective
from rans_optimal.transcription import Trajectory, Transcription
from scipy.spatial.transform import Rotation

from rans import Spacecraft, Timing
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3, map_leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.reference.flight import replay
from rans.tasks import GoToPose, Task

TASK = GoToPose(spawn_distance=(3.0, 4.0))
PLATFORM = load_spacecraft("floating-platform")
FLYER = load_spacecraft("free-flyer")
SHARED = replace(PLATFORM, thrust_sharing="split")

FORWARD = 4 * math.sqrt(0.5)
"""N: four 1 N nozzles at 45 degrees to a body axis of the platform; no direction has more."""
SOLVER = 1e-6
"""Relative accuracy of a cost: the optimiser stops at 1e-8 of scaled optimality and feasibility."""


def spatial(x: float = 0.0, attitude: Rotation | None = None) -> SpatialState:
    qx, qy, qz, qw = (float(c) for c in (attitude or Rotation.identity()).as_quat())
    rest = Vec3(0.0, 0.0, 0.0)
    return SpatialState(Vec3(x, 0.0, 0.0), Quat(qw, qx, qy, qz), rest, rest)


@cache
def transcription(craft: Spacecraft, objective: Objective, task: Task = TASK) -> Transcription:
    return Transcription(craft, task, objective)


def solved(
    craft: Spacecraft, objective: Objective, start: Any, goal: Any, task: Task = TASK
) -> Trajectory:
    trajectory = transcription(craft, objective, task).solve(start, goal)
    assert trajectory.solved, trajectory.status
    return trajectory


def replay_error(craft: Spacecraft, trajectory: Trajectory) -> float:
    """Largest distance in m between the optimised path and the one Drake flies."""
    if trajectory.control_period == 0.0:  # the start is the goal: nothing is flown
        return 0.0
    start = map_leaves(lambda x: float(x[0]), trajectory.states)
    timing = Timing(control_period=trajectory.control_period)
    flown = replay(craft, start, trajectory.commands, timing)
    return float((flown.p - trajectory.states.p).norm().max())
