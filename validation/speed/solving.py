"""How long an optimal trajectory takes to find."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator

from rans.errors import ConfigError
from rans.model.spacecraft import Spacecraft
from rans.scenario import EVALUATION_SEED, each, scenarios
from rans.tasks import Task
from validation.speed.measurement import Measurement

_KIND = "optimal control"


def solver_rate(craft: Spacecraft, task: Task, starts: int) -> Iterator[Measurement]:
    """Relaxed least time in this process, on one core: the median solve, and solves per second.

    The latter are all solves over all their seconds, of which the slow ones take most.
    """
    name = f"least time, {craft.name}"
    try:
        from rans.optimal.trajectory.objectives import MinimumTime
        from rans.optimal.trajectory.transcription import Transcription

        begun = time.perf_counter()
        problem = Transcription(craft, task, MinimumTime())
        warm_up = time.perf_counter() - begun
    except (ImportError, ConfigError) as error:
        yield Measurement(_KIND, name, None, "ms a solve", note=str(error))
        return
    found = [
        problem.solve(one.start, one.goal)
        for one in each(scenarios(task, craft, EVALUATION_SEED, starts))
    ]
    solved = sum(t.solved for t in found)
    iterations = statistics.median(t.iterations for t in found)
    note = f"{solved} of {starts} solved, {iterations:g} iterations, {MinimumTime().intervals} intervals"
    seconds = [trajectory.seconds for trajectory in found]
    yield Measurement(
        _KIND, f"{name}, median", 1e3 * statistics.median(seconds), "ms a solve", warm_up, note
    )
    yield Measurement(
        _KIND, f"{name}, all together", starts / sum(seconds), "solves/s", warm_up, note
    )
