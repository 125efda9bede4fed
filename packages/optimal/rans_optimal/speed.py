"""How long an optimal trajectory takes to find."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator
from typing import Any

from rans.extend import EVALUATION_SEED, ConfigError, Spacecraft, Task, each, scenarios

_KIND = "optimal control"
Row = tuple[Any, ...]
"""Kind, name, value (or None), unit, seconds of preparation, note."""


def solver_rate(craft: Spacecraft, task: Task, starts: int) -> Iterator[Row]:
    """Relaxed least time in this process, on one core: the median solve, and solves per second.

    The latter are all solves over all their seconds, of which the slow ones take most.
    """
    name = f"least time, {craft.name}"
    try:
        from rans_optimal.objectives import MinimumTime
        from rans_optimal.transcription import Transcription

        begun = time.perf_counter()
        problem = Transcription(craft, task, MinimumTime())
        warm_up = time.perf_counter() - begun
    except (ImportError, ConfigError) as error:
        yield _KIND, name, None, "ms a solve", 0.0, str(error)
        return
    found = [
        problem.solve(one.start, one.goal)
        for one in each(scenarios(task, craft, EVALUATION_SEED, starts))
    ]
    solved = sum(t.solved for t in found)
    iterations = statistics.median(t.iterations for t in found)
    note = f"{solved} of {starts} solved, {iterations:g} iterations, {MinimumTime().intervals} intervals"
    seconds = [trajectory.seconds for trajectory in found]
    middle = 1e3 * statistics.median(seconds)
    yield _KIND, f"{name}, median", middle, "ms a solve", warm_up, note
    yield _KIND, f"{name}, all together", starts / sum(seconds), "solves/s", warm_up, note
