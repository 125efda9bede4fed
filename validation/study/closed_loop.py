"""The same feedback controller in both engines: decisions, and so flights, must stay the same."""

from __future__ import annotations

from collections.abc import Sequence

from rans.errors import ConfigError
from rans.evaluation.measure.agreement import compare_engines
from rans.flight import fly
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.reference.flight import fly_in_drake
from rans.scenario import scenarios
from rans.tasks import GoToPose
from validation.study.checks import Check, Skipped


def closed_loop_checks(craft: Spacecraft, seed: int, count: int) -> Sequence[Check | Skipped]:
    """An LQR that goes to a pose; `rans evaluate --engine both` does the same with an agent."""
    from rans.optimal.control.lqr import LQR

    timing = Timing()
    task = GoToPose().for_evaluation()
    try:
        controller = LQR(craft, task, timing)
    except ConfigError as error:
        return [Skipped("closed loop", str(error))]
    starts = scenarios(task, craft, seed, count)
    comparison = compare_engines(
        fly(craft, task, controller, starts, timing),
        fly_in_drake(craft, task, controller, starts, timing),
    )
    reason = {
        "solved": f"Half of the 95 % interval of a share of {count} flights.",
        "position error": "A fiftieth of the task's tolerance.",
        "attitude error": "A fiftieth of the task's tolerance.",
    }
    asked = [pair for pair in comparison.pairs if pair.bound is not None]
    return [
        Check(
            f"closed loop, LQR: {pair.name}",
            pair.difference,
            max(map(abs, pair.bound or ())),
            pair.unit,
            reason[pair.name],
        )
        for pair in asked
    ]
