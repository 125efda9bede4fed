"""How long the fastest trajectories are close to their goal, which no agent beats by much.

Their thrust is relaxed, anything between shut and open, and they know the future; see
`rans.optimal.objectives.MinimumTime`. They are flown in Drake and rest at the goal once they have arrived.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rans.errors import SolverFailed
from rans.evaluation.metrics import samples
from rans.fields import map_leaves
from rans.flight import Flight, scenarios
from rans.optimal.objectives import MinimumTime
from rans.optimal.pool import solve_all
from rans.optimal.transcription import Trajectory
from rans.reference.flight import replay
from rans.spacecraft import Spacecraft
from rans.tasks import Task
from rans.timing import Timing


def time_optimal(craft: Spacecraft, task: Task, timing: Timing, seed: int, count: int,
                 workers: int | None = None) -> dict[str, np.ndarray]:
    """Every metric of the relaxed time-optimal trajectories, one value per start.

    Args:
        craft: what flies.
        task: where to; its own starts.
        timing: gives the length of an episode.
        seed: of the starts.
        count: starts 0 to count - 1 of it.
        workers: see `rans.optimal.pool.solve_all`.

    Raises:
        SolverFailed: from some start none was found.
    """
    starts = scenarios(task, craft, seed, count)
    [trajectories] = solve_all(craft, task, [MinimumTime()], starts, workers)
    lost = [k for k, trajectory in enumerate(trajectories) if not trajectory.solved]
    if lost:
        raise SolverFailed(f"no time-optimal trajectory was found from the starts {lost} of seed {seed}; the "
                           f"first ended with {trajectories[lost[0]].status}.")
    found: list[dict[str, Any]] = []
    for k, trajectory in enumerate(trajectories):
        start, goal = (map_leaves(lambda x, k=k: x[k:k + 1], state) for state in (starts.start, starts.goal))
        flight = _flown(craft, task, timing, start, goal, trajectory)
        found.append({sample.name: sample.values for sample in samples(flight)})
    return {name: np.concatenate([values[name] for values in found]) for name in found[0]}


def _flown(craft: Spacecraft, task: Task, timing: Timing, start: Any, goal: Any,
           trajectory: Trajectory) -> Flight:
    """One trajectory in Drake for a whole episode, thrusters shut once it has arrived."""
    period, planned = trajectory.control_period, len(trajectory.commands)
    steps = max(planned, math.ceil(timing.episode_steps * timing.control_period / period - 1e-9))
    commands = np.vstack([trajectory.commands, np.zeros((steps - planned, len(craft.thrusters)))])
    own = Timing(control_period=period, episode_steps=steps)
    states = replay(craft, map_leaves(lambda x: float(x[0]), start), commands, own)
    return Flight(craft, task, own, map_leaves(lambda x: x[:, None], states), goal, commands[:, None],
                  trajectory.objective, "drake")
