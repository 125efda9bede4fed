"""How long the fastest trajectories are close to their goal, which no agent beats by much.

Their thrust is relaxed, anything between shut and open, and they know the future; see
`rans.optimal.trajectory.objectives.MinimumTime`. They are flown in Drake and rest at the goal
once they have arrived.
"""

from __future__ import annotations

import numpy as np

from rans.errors import SolverFailed
from rans.evaluation.compare.optima import optima
from rans.evaluation.measure.metrics import samples
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.optimal.trajectory.objectives import MinimumTime
from rans.scenario import scenarios
from rans.tasks import Task


def time_optimal(
    craft: Spacecraft, task: Task, timing: Timing, seed: int, count: int, workers: int | None = None
) -> dict[str, np.ndarray]:
    """Every metric of the relaxed time-optimal trajectories, one value per start.

    Args:
        craft: what flies.
        task: where to; its own starts.
        timing: gives the length of an episode.
        seed: of the starts.
        count: starts 0 to count - 1 of it.
        workers: see `rans.optimal.trajectory.pool.solve_all`.

    Raises:
        SolverFailed: from some start none was found.
    """
    starts = scenarios(task, craft, seed, count)
    every = optima(craft, task, MinimumTime(), starts, workers=workers, timing=timing)
    lost = [one.start for one in every if one.flight is None]
    if lost:
        raise SolverFailed(
            f"no time-optimal trajectory was found from the starts {lost} of seed {seed}; the "
            f"first ended with {every[lost[0]].trajectory.status}."
        )
    found = [{s.name: s.values for s in samples(one.flight)} for one in every if one.flight]
    return {name: np.concatenate([values[name] for values in found]) for name in found[0]}
