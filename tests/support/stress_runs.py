"""A stress campaign so small that it takes seconds."""

from __future__ import annotations

from dataclasses import replace

from rans_assurance.stress.run import Stress, prepared

from rans.evaluation.compare.entrants import contest_of
from rans.randomization.conditions_file import load_conditions

FIRST = "pretrained:go-to-pose-2d"


def small(
    *specs: str,
    episodes: int = 4,
    conditions: tuple[str, ...] = (),
    only: tuple[str, ...] = ("latency",),
    slow: int = 2,
) -> Stress:
    """Without failed thrusters, and at the first sizes only."""
    specs = specs or (FIRST, "lqr")
    sets = {name: load_conditions(name) for name in conditions}
    stress = prepared(contest_of(specs[0], episodes, 7), specs, sets, only, slow)
    stress.named = stress.named[: 1 + len(conditions)]
    stress.effects = [replace(effect, sizes=effect.sizes[:3]) for effect in stress.effects]
    return stress
