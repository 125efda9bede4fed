"""Impulse against time of a mission in the plane: proven bounds, and optimal trajectories beside them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from rans_missions.bounds.ports import least_to_dock_at
from rans_missions.bounds.zones import least_to_stay

from rans.api.limits import optimal_trajectory
from rans.files import number
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import EVALUATION_SEED, Scenario, scenario
from rans.tasks import TASKS

_CRAFT = "floating-platform"


_LEAST: dict[str, Callable[[Spacecraft, Any, Scenario, float], float]] = {
    "avoid": lambda craft, task, one, time: least_to_stay(craft, task, one, task.timing, time),
    "dock-port": lambda craft, task, one, time: least_to_dock_at(
        craft, task, one, task.timing, time
    ),
}
"""Bound on the impulse, N s, of craft, task, start and time, s, by the name of the task."""


@dataclass(frozen=True)
class Front:
    """Impulse against time: bound, and the best of optimal trajectories; it fails where one is below it."""

    mission: Annotated[Literal["avoid", "dock-port"], tyro.conf.Positional]
    """Name of the task."""
    times: tuple[float, ...]
    """Lengths of the trajectories, s."""
    starts: int = 4
    """The first starts of the evaluation."""
    guesses: int = 8
    """Guesses of each trajectory; the best counts."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """Bound and trajectory of every time and start."""
        task = TASKS[self.mission]().for_evaluation()
        craft = load_spacecraft(_CRAFT)
        for time in self.times:
            for k in range(self.starts):
                one = scenario(task, craft.dimension, EVALUATION_SEED, k)
                found = optimal_trajectory(
                    self.mission, craft, start=k, horizon=time, guesses=self.guesses
                )
                spent = found.trajectory.cost if found.trajectory.solved else math.inf
                bound = _LEAST[self.mission](craft, task, one, time)
                yield {"time": time, "start": k, "bound": bound, "flight": spent}

    def failed(self, evidence: Any) -> bool:
        """Whether a trajectory is below its bound."""
        return any(row["flight"] < row["bound"] for row in evidence["rows"])


def means(evidence: Any) -> Iterator[dict[str, Any]]:
    """Rows of the table: means over the starts that have a trajectory."""
    found: dict[float, list[tuple[float, float]]] = {}
    for row in evidence["rows"]:
        found.setdefault(row["time"], []).append((row["bound"], number(row["flight"])))
    for time, pairs in found.items():
        solved = np.array([pair for pair in pairs if math.isfinite(pair[1])])
        bound, flight = solved.mean(axis=0)
        yield {
            "time": time,
            "solved": len(solved),
            "starts": len(pairs),
            "bound": bound,
            "flight": flight,
            "mean": bound / flight,
            "least": (solved[:, 0] / solved[:, 1]).min(),
        }
