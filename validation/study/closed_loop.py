"""The same feedback controller in both engines: decisions, and so flights, must stay the same."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rans.base.errors import ConfigError
from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.evaluation.measure.metrics import final_errors, solved
from rans.evaluation.measure.statistics import share
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.reference.flight import fly_in_drake
from rans.tasks import GoToPose
from rans.tasks.quantities import QUANTITIES
from validation.study.checks import Check, Skipped

_ALLOWED = {"position": 1e-3, "attitude": math.radians(0.1)}
"""Largest differences of the medians, m and rad."""


def closed_loop_checks(craft: Spacecraft, seed: int, count: int) -> Sequence[Check | Skipped]:
    """An LQR that goes to a pose: the share of flights that are solved, and medians of the final errors."""
    from rans.control.lqr import LQR

    timing = Timing()
    task = GoToPose().for_evaluation()
    try:
        controller = LQR(craft, task, timing)
    except ConfigError as error:
        return [Skipped("closed loop", str(error))]
    starts = scenarios(task, craft, seed, count)
    ours, drakes = (by(craft, task, controller, starts, timing) for by in (fly, fly_in_drake))
    rates, drake_rates = (share(solved(flight)).scaled(100.0) for flight in (ours, drakes))
    checks = [
        Check(
            "closed loop, LQR: solved",
            drake_rates.value - rates.value,
            max(rates.value - rates.low, rates.high - rates.value),
            "%",
            f"Half of the 95 % interval of a share of {count} flights.",
        )
    ]
    # Errors at the end.
    drake_errors = final_errors(drakes)
    for name, error in final_errors(ours).items():
        factor, unit = QUANTITIES[name].display
        checks.append(
            Check(
                f"closed loop, LQR: {name} error",
                factor * float(np.median(drake_errors[name]) - np.median(error)),
                factor * _ALLOWED[name],
                unit,
                "A fiftieth of the task's tolerance.",
            )
        )
    return checks
